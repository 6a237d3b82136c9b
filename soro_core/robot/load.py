"""Robots from files and dictionaries."""

from __future__ import annotations

import json
import logging
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from soro_core.config import find_config, parse, read_yaml
from soro_core.errors import ConfigError
from soro_core.files.csv_rows import read_matrix
from soro_core.robot.bases import BASES
from soro_core.robot.collapse import collapsing
from soro_core.robot.description import Robot
from soro_core.robot.link import DENSEST, HEAVIEST, LIGHTEST, LONGEST
from soro_core.robot.strain import samples_fault

_ENDINGS = (".npy", ".npz", ".csv")


def with_samples(data: Mapping[str, Any], folder: Path, where: str) -> dict[str, Any]:
    """Return a copy of a robot's dictionary in which each `file` of modes has its `samples` beside it.

    What is malformed elsewhere is left as it is: the check of the whole dictionary names it.

    Parameters
    ----------
    data : mapping
        Keys of a robot file; not changed.
    folder : Path
        Folder to which the files are relative.
    where : str
        Robot file, for errors.

    Raises
    ------
    ConfigError
        If a file is missing, or does not hold one real, finite array of shape (n_samples, n_modes).
    """
    links = data.get("links")
    if not isinstance(links, list | tuple):
        return dict(data)
    return {**data, "links": [_link(link, folder, where, f"links[{i}]") for i, link in enumerate(links)]}


def _link(link: Any, folder: Path, where: str, key: str) -> Any:
    strains = link.get("strains") if isinstance(link, Mapping) else None
    if not isinstance(strains, Mapping):
        return link
    read = {
        name: _field(field, folder, where, f"{key}.strains.{name}.file") for name, field in strains.items()
    }
    return {**link, "strains": read}


def _field(field: Any, folder: Path, where: str, key: str) -> Any:
    if not isinstance(field, Mapping) or field.get("samples") is not None:
        return field
    basis = field.get("basis")
    if not isinstance(basis, str) or basis not in BASES or "file" not in BASES[basis].keys:
        return field
    name, modes = field.get("file"), field.get("modes")
    if not isinstance(name, str) or not name:
        return field
    path = folder / name
    if path.suffix not in _ENDINGS:
        raise ConfigError(where, key, name, f"a path ending in {', '.join(_ENDINGS)}")
    if not path.is_file():
        raise ConfigError(where, key, f"{name}: no such file", f"an existing file, relative to {folder}")
    try:
        array = _array(path)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ConfigError(where, key, f"{name}: {error}", "a file with one array of numbers") from None
    if array.dtype.kind not in "fiu":
        raise ConfigError(where, key, f"{name}: values of type {array.dtype}", "real numbers")
    fault = samples_fault(array, modes if isinstance(modes, int) and modes > 0 else None)
    if fault is not None:
        wrong = np.argwhere(~np.isfinite(array))
        found = f"{array[tuple(wrong[0])]} in row {wrong[0][0]}" if len(wrong) else f"shape {array.shape}"
        raise ConfigError(where, key, f"{name}: {found}", fault)
    return {**field, "samples": array.astype(np.float64).tolist()}


def _array(path: Path) -> np.ndarray[Any, Any]:
    if path.suffix == ".csv":
        return np.array(read_matrix(path))
    content = np.load(path, allow_pickle=False)
    if isinstance(content, np.ndarray):
        return content
    with content:
        if len(content.files) != 1:
            raise ValueError(f"{len(content.files)} arrays")
        return np.asarray(content[content.files[0]])


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


def save_robot(robot: Robot, path: str | Path) -> None:
    """Write a file NAME.yaml, which `load_robot` reads as an equal robot; modes stand in it as `samples`.

    Raises
    ------
    ConfigError
        If the file cannot be written.
    """
    import yaml

    file = Path(path)
    if file.suffix != ".yaml":
        raise ConfigError(str(file), "", file.suffix, "a path ending in .yaml")
    keys = json.loads(robot.model_dump_json(exclude_unset=True))  # numbers of numpy become plain ones
    text = yaml.safe_dump({"name": robot.name, **keys}, sort_keys=False, default_flow_style=None, width=110)
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(str(file), "", error.strerror, "a file that can be written") from None


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
    """Log a line where a link weighs as no material does, is too large, or chambers can make one collapse."""
    for i, link in enumerate(robot.links):
        density = link.mass / link.volume
        if not LIGHTEST <= density <= DENSEST:
            found = f"mass, radius and length make {density:.3g} kg/m^3"
            allowed = f"a material's, {LIGHTEST:g} to {DENSEST:g}"
        elif link.length > LONGEST or link.mass > HEAVIEST:  # of a density that is stated
            found = f"a length of {link.length:g} m, a radius of {link.radius:g} m and {link.mass:.3g} kg"
            allowed = f"at most {LONGEST:g} m and {HEAVIEST:g} kg"
        else:
            continue
        logging.getLogger("soro_core").warning(
            "%s: links[%d]: %s; allowed without this warning: %s; units are kg and m",
            where,
            i,
            found,
            allowed,
        )
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
