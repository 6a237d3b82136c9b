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


def load_robot(name_or_path: str | Path) -> Robot:
    """Read a robot file, or a shipped robot by its name; log a range of pressures that can collapse a link.

    Files of modes (basis pod) are read with it, relative to its folder.

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
    data = read_yaml(path)
    data = with_samples(data, path.parent, str(path))
    return _warned(parse({"name": path.stem, **data}, Robot, where=str(path)), str(path))


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
