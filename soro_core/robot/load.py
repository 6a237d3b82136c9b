"""Robots from files and dictionaries."""

from __future__ import annotations

import json
import logging
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from soro_core.config import find_config, parse, read_yaml
from soro_core.errors import ConfigError
from soro_core.files.csv_rows import read_matrix
from soro_core.robot.bases import BASES
from soro_core.robot.collapse import collapsing
from soro_core.robot.description import Robot
from soro_core.robot.link import DENSEST, HEAVIEST, LIGHTEST, LONGEST, Link
from soro_core.robot.strain import samples_fault

_ENDINGS = (".npy", ".npz", ".csv")
# No soft arm has more, so that they tell wrong units: length over radius of a link; area and offset of a
# chamber over section and radius; load over mass of an arm; strain or turn [rad] of a link by its weight.
_SLENDEREST, _WIDEST, _LADEN, _LIMPEST = 300.0, 10.0, 50.0, 100.0
# Young's modulus of a material, from a gel to a diamond; width of a range of pressures [Pa].
_MODULI, _RANGES = (1e3, 1e12), (1e3, 1e8)


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
    """Log a line where values have probably another unit, or chambers can make a link collapse."""
    for key, found, allowed in _odd(robot):
        logging.getLogger("soro_core").warning(
            "%s: %s: %s; allowed without this warning: %s; units are kg and m, Pa and N",
            where,
            key,
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


def _odd(robot: Robot) -> Iterator[tuple[str, str, str]]:
    """Give key, value and what is allowed of what no soft arm has: mm for m, g for kg, MPa or kPa for Pa."""
    for i, link in enumerate(robot.links):
        key, density, section = f"links[{i}]", link.mass / link.volume, link.volume / link.length
        if odd := _odd_size(link, density):
            yield key, *odd
            continue
        if link.material is not None:
            young, shear = link.material.youngs_modulus, link.material.shear_modulus
            if not _MODULI[0] <= young <= _MODULI[1]:
                yield f"{key}.material.youngs_modulus", f"{young:g} Pa", "{:g} to {:g} Pa".format(*_MODULI)
            elif not 0.32 * young <= shear <= 0.51 * young:
                allowed = f"{young / 3.0:.6g} (rubber) to {young / 2.0:.6g} Pa, by Poisson's ratio"
                yield f"{key}.material.shear_modulus", f"{shear:g} Pa", allowed
        elif link.k_e and link.k_b:
            stretch, bend = link.k_e[0] - link.k_e[1], link.k_b[0] - link.k_b[1]
            limp = 9.81 * link.mass * max(1.0 / (stretch * link.length), 0.5 * link.length / bend)
            if limp > _LIMPEST:
                found = (
                    f"stiffness at rest {stretch:.3g} N/m and {bend:.3g} N m, weight {9.81 * link.mass:.3g} N"
                )
                yield f"{key}.k_e, k_b", found, f"a strain or turn by it of {_LIMPEST:g} at most"
        for j, chamber in enumerate(link.chambers):
            area = chamber.area_m2 or (chamber.alpha_eps or 0.0) / link.length
            if chamber.muscle is not None:
                area = -chamber.muscle.area_m2
            if area > _WIDEST * section or (chamber.offset_m or 0.0) > _WIDEST * link.radius:
                allowed = f"an area and an offset of {_WIDEST:g} times the section and the radius of the link"
                yield f"{key}.chambers[{j}]", f"{chamber.model_dump(exclude_unset=True)}", allowed
    added = robot.tip_mass + sum(one.mass for one in robot.point_masses)
    if added > _LADEN * (own := sum(link.mass for link in robot.links)):
        yield (
            "tip_mass, point_masses",
            f"{added:g} kg on {own:.3g} kg",
            f"{_LADEN:g} times the mass of the arm",
        )
    low, high = robot.pressure_range_pa
    if robot.chamber_names and not _RANGES[0] <= high - low <= _RANGES[1]:
        yield "pressure_range_pa", f"{low:g} to {high:g} Pa", "a range of {:g} to {:g} Pa".format(*_RANGES)


def _odd_size(link: Link, density: float) -> tuple[str, str] | None:
    size = f"a length of {link.length:g} m, a radius of {link.radius:g} m"
    if not LIGHTEST <= density <= DENSEST:
        found = f"mass, radius and length make {density:.3g} kg/m^3"
        return found, f"a material's, {LIGHTEST:g} to {DENSEST:g}"
    if link.length > LONGEST or link.mass > HEAVIEST:  # of a density that is stated
        return f"{size} and {link.mass:.3g} kg", f"at most {LONGEST:g} m and {HEAVIEST:g} kg"
    if link.length > _SLENDEREST * link.radius:
        return size, f"at most {_SLENDEREST:g} radii"
    return None
