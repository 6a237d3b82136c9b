"""Robots from files and dictionaries."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from soro_core.config import find_config, parse, read_yaml
from soro_core.errors import ConfigError
from soro_core.robot.collapse import collapsing
from soro_core.robot.description import Robot
from soro_core.robot.mode_files import with_samples

# What a reference case (a robot with a state and the right answers) holds besides the robot.
_CASE_KEYS = frozenset(
    ("kind", "q", "qd", "inertia_matrix", "coriolis_force", "gravity_force", "elastic_force", "tip_pose")
)

# Key of a file that changes some keys of another one.
BASED_ON = "based_on"


def load_robot(name_or_path: str | Path) -> Robot:
    """Read a robot file, or a shipped robot by its name; log a range of pressures that can collapse a link.

    Files of modes (basis pod) are read with it, relative to its folder. A file with the key `based_on`, which
    names a robot file beside it or a shipped robot, has the keys of that robot; its own take precedence.

    Parameters
    ----------
    name_or_path : str or Path
        Path ending in .yaml, or the name of a file in config/robots.

    Raises
    ------
    ConfigError
        One line with file, key, what was found and what is allowed.
    """
    path = find_config(name_or_path, "robots")
    return _warned(parse({"name": path.stem, **_keys_of(path)}, Robot, where=str(path)), str(path))


def _keys_of(path: Path) -> dict[str, Any]:
    """Return the keys of a robot file, with those of the robot that it is based on."""
    own = with_samples(read_yaml(path), path.parent, str(path))
    based_on = own.pop(BASED_ON, None)
    if based_on is None:
        return own
    if not isinstance(based_on, str):
        raise ConfigError(str(path), BASED_ON, based_on, "a robot file, or the name of a shipped one")
    beside = path.parent / based_on
    file = beside if beside.suffix and beside.is_file() else find_config(based_on, "robots")
    others = with_samples(read_yaml(file), file.parent, str(file))
    if BASED_ON in others:
        raise ConfigError(str(path), BASED_ON, based_on, "a robot file that is not based on another one")
    return {key: value for key, value in others.items() if key not in ("name", "description")} | own


def robot_from_dict(data: Mapping[str, Any], where: str = "robot") -> Robot:
    """Make a robot from a dictionary with the keys of a robot file; log as `load_robot` does.

    A golden case (the keys of a robot, together with q, qd and all recorded results) is accepted too; its
    results are ignored. Modes (basis pod) stand in `samples`, or in a `file` relative to the
    working directory.

    Raises
    ------
    ConfigError
        One line with key, what was found and what is allowed.
    """
    if not isinstance(data, Mapping):
        raise ConfigError(where, "", data, "a dictionary with the keys of a robot file")
    if data.keys() >= _CASE_KEYS:
        data = {key: value for key, value in data.items() if key not in _CASE_KEYS}
    return _warned(parse(with_samples(data, Path(), where), Robot, where=where), where)


def _warned(robot: Robot, where: str) -> Robot:
    """Log one line where chambers can make a link collapse within the range of pressures."""
    within = collapsing(robot)
    if within:
        low, high = (1e-3 * end for end in robot.pressure_range_pa)
        listed = ", ".join(
            f"{1e-3 * one.pressure_pa:.4g} kPa in {' with '.join(one.chambers)}" for one in within
        )
        logging.getLogger("soro_core").warning(
            "%s: pressure_range_pa of %g to %g kPa: a link can collapse beyond about %s;"
            " allowed without this warning: a range within, or least_elongation of the link",
            where,
            low,
            high,
            listed,
        )
    return robot
