"""Links made from a link: its parts, and one with other stiffness, losses and chamber gains."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from soro_core.config import Strict
from soro_core.errors import ConfigError, nearest
from soro_core.robot.bases import gauss, listed, names
from soro_core.robot.basis import along, knots, mass_profile, mean_stiffness, on_pieces, stiffness_profile
from soro_core.robot.chamber import Chamber
from soro_core.robot.link import CLOSE, Link


def scaled_link(link: Link, stiffness: float, damping: float, gain: float) -> dict[str, Any]:
    """Return the keys of a link with other physics.

    Parameters
    ----------
    link : Link
    stiffness, damping, gain : float
        Factors on the stiffness, on all losses, and on the force of the chambers.
    """

    def times(values: tuple[float, ...], factor: float) -> tuple[float, ...]:
        return tuple(factor * value for value in values)

    part = fields(link)
    for law in ("k_e", "k_b"):
        values = getattr(link, law)
        if values is not None:
            part[law] = (*times(values[:2], stiffness), values[2])
    if link.material is not None:
        part["material"] = {
            **fields(link.material),
            "youngs_modulus": stiffness * link.material.youngs_modulus,
            "shear_modulus": stiffness * link.material.shear_modulus,
            "viscosity": damping * link.material.viscosity,
        }
    if link.damping is not None:
        part["damping"] = times(link.damping, damping)
    part["creep"] = [{"tau": c.tau, "stiffness": times(c.stiffness, damping)} for c in link.creep]
    part["hysteresis"] = [
        {"stiffness": times(h.stiffness, damping), "range": h.range} for h in link.hysteresis
    ]
    part["chambers"] = [scaled_chamber(chamber, gain) for chamber in link.chambers]
    return part


def scaled_chamber(chamber: Chamber, gain: float, arm: float = 1.0) -> dict[str, Any]:
    """Return the keys of a chamber with other force per pressure.

    Parameters
    ----------
    chamber : Chamber
    gain, arm : float
        Factors on its force, and on its distance from the backbone.
    """
    keys = fields(chamber)
    factors = {"area_m2": gain, "offset_m": arm, "alpha_eps": gain, "alpha_kappa": gain * arm}
    for key, factor in factors.items():
        if keys.get(key) is not None:
            keys[key] *= factor
    if chamber.muscle is not None:  # its force is as its section
        keys["muscle"] = {**fields(chamber.muscle), "radius_m": math.sqrt(gain) * chamber.muscle.radius_m}
    return keys


def check_split(link: Link, where: str, key: str) -> None:
    """Refuse a link whose parts would not have its physics.

    Parameters
    ----------
    link : Link
    where, key : str
        File or robot, and key of the link, for the message.

    Raises
    ------
    ConfigError
        If a strain has modes (they run along the whole link), or a strain varies and losses are given for
        each coordinate (that of P_1, say, has no counterpart in the parts).
    """
    for name, field in link.strains.items():
        if not field.shape_functions.splits:
            allowed = listed(names(lambda basis: basis.splits))
            raise ConfigError(where, f"{key}.strains.{name}.basis", field.basis, allowed)
    if link.varies:
        for name in ("damping", "creep", "hysteresis"):
            values = getattr(link, name)
            if values:
                raise ConfigError(
                    where, f"{key}.{name}", plain(values), "none where a strain is not constant"
                )


def split_link(link: Link, k: int) -> list[dict[str, Any]]:
    """Return the keys of k equal links with the physics of one; the first has the chambers."""

    def share(values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(value / k for value in values)

    part = fields(link)
    part.pop("density", None)
    part.update(length=link.length / k, mass=link.mass / k)
    for law in ("k_e", "k_b"):
        values = getattr(link, law)
        if values is not None:
            part[law] = tuple(k * value for value in values)
    if link.damping is not None:
        part["damping"] = share(link.damping)
    part["creep"] = [{"tau": c.tau, "stiffness": share(c.stiffness)} for c in link.creep]
    part["hysteresis"] = [{"stiffness": share(h.stiffness), "range": h.range} for h in link.hysteresis]
    parts = [part, *({**part, "chambers": []} for _ in range(k - 1))]
    return [_cut(link, keys, j / k, (j + 1) / k) for j, keys in enumerate(parts)] if link.sections else parts


def _cut(link: Link, part: dict[str, Any], begin: float, end: float) -> dict[str, Any]:
    """Return the keys of a part of a link with sections, from its part of a uniform one; places 0 ... 1."""
    given = knots(link)
    x = np.array([begin, *given[(given > begin + CLOSE) & (given < end - CLOSE)], end])
    places = [*((x[:-1] - begin) * link.length).tolist(), part["length"]]
    columns = {key: along(link, key, x) for key in type(link.sections[0]).model_fields if key != "place"}
    rows = [
        {"place": place, **{key: each[n].tolist() for key, each in columns.items() if each is not None}}
        for n, place in enumerate(places)
    ]
    at, weights = on_pieces(x, *gauss(4))
    share = weights / (end - begin)
    part = {**part, "sections": rows, "mass": part["mass"] * float(share @ mass_profile(link, at))}
    if columns["mass_per_m"] is not None:
        del part["mass"]
    if columns["radius"] is not None:
        part.pop("radius", None)
    for law, strain in (("k_e", "elongation"), ("k_b", "bending_x")):
        if part.get(law) is not None:
            stiffer = float(share @ stiffness_profile(link, strain, at)) / mean_stiffness(link, strain)
            first, second, third = part[law]
            part[law] = (stiffer * first, stiffer * second, third)
    return part


def fields(model: Strict) -> dict[str, Any]:
    """Keys that are set, as plain values, without those at their default."""
    return model.model_dump(exclude_unset=True)


_STEP = re.compile(r"\.?([A-Za-z_]\w*)|\[(\d+)\]")


def put(keys: dict[str, Any], model: Strict, path: str, value: Any) -> None:
    """Set a value by its path, ``links[0].k_b[0]``, in the keys of a model; what it leaves out has defaults.

    Parameters
    ----------
    keys : dict
        As `fields` gives them; changed.
    model : Strict
    path : str
    value : object
        Plain value.

    Raises
    ------
    ConfigError
        If the path leads nowhere.
    """
    found = list(_STEP.finditer(path))
    steps = [one[1] or int(one[2]) for one in found]
    where = str(getattr(model, "name", "robot"))
    if not steps or _STEP.sub("", path):
        raise ConfigError(where, path, value, "a path of keys and numbers, as links[0].k_b[0]")
    inner: Any = keys
    of: Any = model
    for n, step in enumerate(steps):
        within, of = of, _part(of, step)
        is_there = step in inner if isinstance(inner, dict) else isinstance(step, int) and step < len(inner)
        if n == len(steps) - 1 and (is_there or isinstance(inner, dict)):
            inner[step] = value
            return
        below = plain(inner[step]) if is_there else plain(of)
        if not isinstance(below, dict | list | tuple):
            raise ConfigError(where, path, value, _parts_of(within, step, path, found[n]))
        below = dict(below) if isinstance(below, dict) else list(below)
        inner[step] = inner = below


def _parts_of(within: Any, step: str | int, path: str, at: re.Match[str]) -> str:
    """Return what a path may name in a value in which one of its steps leads nowhere."""
    here = path[: at.start()] or "the robot"
    if isinstance(within, list | tuple):
        if isinstance(step, int) and step < len(within):
            return f"all of {path[: at.end()]}, which has no parts"
        return f"a number below {len(within)} behind {here}, as {here}[0]"
    known = tuple(within) if isinstance(within, dict) else tuple(type(within).model_fields)
    if step in ("material", "k_e", "k_b") and isinstance(within, Link):
        stated = "material.youngs_modulus" if within.material else "k_b[0]"
        return f"{here}.{stated} and the like, which state the stiffness: either material, or k_e and k_b"
    if step in known:
        return f"all of {path[: at.end()]}, which has no value yet, or no parts"
    return f"a key of {here}: {', '.join(known)}{nearest(str(step), known)}"


def _part(of: Any, step: str | int) -> Any:
    """Return a key of a model or a mapping, or an entry of a list; None where there is none."""
    if isinstance(step, str):
        return of.get(step) if isinstance(of, dict) else getattr(of, step, None)
    return of[step] if isinstance(of, list | tuple) and step < len(of) else None


def plain(value: Any) -> Any:
    """Return the keys of a model, of those in a list, and numbers of numpy as plain values."""
    if isinstance(value, Strict):
        return fields(value)
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):  # of numpy
        return value.tolist()
    return value
