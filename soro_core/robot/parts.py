"""Links made from a link: its parts, and one with other stiffness, losses and chamber gains."""

from __future__ import annotations

from typing import Any

from soro_core.config import Strict
from soro_core.errors import ConfigError
from soro_core.robot.bases import listed, names
from soro_core.robot.link import Link


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
    keys = ("area_m2", "alpha_eps", "alpha_kappa")
    part["chambers"] = [
        {
            key: gain * value if key in keys and value is not None else value
            for key, value in fields(c).items()
        }
        for c in link.chambers
    ]
    return part


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
    return [part, *({**part, "chambers": []} for _ in range(k - 1))]


def fields(model: Strict) -> dict[str, Any]:
    """Keys that are set, as plain values, without those at their default."""
    return model.model_dump(exclude_unset=True)


def plain(value: Any) -> Any:
    """Return the keys of a model, and of those in a list, as plain values."""
    if isinstance(value, Strict):
        return fields(value)
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value
