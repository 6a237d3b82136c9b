"""Robots from files and dictionaries."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from soro_core.config import find_config, parse, read_yaml
from soro_core.errors import ConfigError
from soro_core.robot.description import Robot
from soro_core.robot.mode_files import with_samples

# What a reference case (a robot with a state and the right answers) holds besides the robot.
_CASE_KEYS = frozenset(
    ("kind", "q", "qd", "inertia_matrix", "coriolis_force", "gravity_force", "elastic_force", "tip_pose")
)


def load_robot(name_or_path: str | Path) -> Robot:
    """Read a robot file, or a shipped robot by its name.

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
    return parse({"name": path.stem, **data}, Robot, where=str(path))


def robot_from_dict(data: Mapping[str, Any], where: str = "robot") -> Robot:
    """Make a robot from a dictionary with the keys of a robot file.

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
    return parse(with_samples(data, Path(), where), Robot, where=where)
