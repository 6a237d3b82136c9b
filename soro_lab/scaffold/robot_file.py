"""The robot file of a new arm."""

from __future__ import annotations

from typing import Any

from soro_core.adaptation.modes import Mode, first_mode
from soro_core.model import SoftArm
from soro_core.robot import Robot, robot_from_dict
from soro_lab.scaffold.arm import NewArm, NewLink
from soro_lab.scaffold.options import MOUNTINGS
from soro_lab.scaffold.quantity import GUESS, Noted, rounded

# Of the first bending and of the first stretching; fitted arms of config/robots have 0.17 to 0.9.
DAMPING = 0.2
_HEADER = """{name}: {what}, {mounting}. Written by `soro new`.
Each number has its unit and where it comes from. "estimated" follows from given numbers by a
formula and may be wrong by a factor of two or more; "guess" makes the arm run on the twin.
Write your own numbers in their place. With a known Young's modulus, multiply k_e and k_b by it over
the E of their comments. docs/model_terms.md has further keys: loads, contact, air, other laws."""


def robot_tree(arm: NewArm) -> dict[str, Any]:
    """Return the robot file as a tree of `Noted` values."""
    quaternion, what = MOUNTINGS[arm.mounting]
    loss = _damping(arm)
    return {
        "name": Noted(arm.name, "small letters, digits and _"),
        "description": Noted(_what(arm), "for people"),
        "gravity": Noted((0.0, 0.0, -9.81), "m/s^2, in the world, whose z points up"),
        "base_quaternion": Noted(quaternion, f"x, y, z, w of the base in the world, {arm.mounting}: {what}"),
        "base_position": Noted((0.0, 0.0, 0.0), "m, of the base in the world: at its origin"),
        "tip_mass": Noted(0.0, "kg, of plates or tools at the tip that always stay: none given"),
        # Where the deformed angle vanishes, high pressures can collapse a link.
        "bend_angle": Noted("geometric", "angle that k_b acts on: that of a beam, curvature times length"),
        "pressure_range_pa": arm.pressure_range,
        "links": [_link(link, arm.planar, loss[k]) for k, link in enumerate(arm.links)],
    }


def robot_header(arm: NewArm) -> str:
    """Return the comment at the top of the robot file."""
    return _HEADER.format(name=arm.name, what=_what(arm), mounting=arm.mounting)


def _what(arm: NewArm) -> str:
    counts = [len(link.geometry.angles) for link in arm.links]
    links = "one link" if len(counts) == 1 else f"{len(counts)} links"
    chambers = f"{counts[0]}" if len(set(counts)) == 1 else " ".join(map(str, counts))
    plane = " that bends in one plane" if arm.planar else ""
    return f"{links} of {chambers} chambers{' each' if len(set(counts)) < len(counts) else ''}{plane}"


def _link(link: NewLink, planar: bool, damping: tuple[float, float]) -> dict[str, Any]:
    stretch, bend = damping
    strains = {"elongation": {"basis": "constant"}, "bending_x": {"basis": "constant"}}
    losses = (stretch, bend) if planar else (stretch, bend, bend)
    text = (
        f"J s of elongation, J m^2 s of bending, damping ratio {DAMPING:g} of the first mode of each; {GUESS}"
    )
    return {
        "length": link.geometry.length,
        "radius": link.geometry.radius,
        "mass": link.geometry.mass,
        **(
            {"strains": Noted(strains, "it bends in the plane of local x only, the direction of angle 0")}
            if planar
            else {}
        ),
        "k_e": Noted((link.k_e.value, 0.0, 0.0), f"a1, a2, a3 (linear law): {link.k_e.note}"),
        "k_b": Noted((link.k_b.value, 0.0, 0.0), f"a4, a5, a6 (linear law): {link.k_b.note}"),
        "damping": Noted(losses, text),
        **(
            {"chambers": [_chamber(link, angle) for angle in link.geometry.angles]}
            if link.geometry.angles
            else {}
        ),
    }


def _chamber(link: NewLink, angle: Noted) -> dict[str, Noted]:
    return {"angle_rad": angle, "area_m2": link.geometry.area, "offset_m": link.geometry.offset}


def _damping(arm: NewArm) -> list[tuple[float, float]]:
    """Return the damping of elongation [J s] and of bending [J m^2 s] of each link."""
    model = SoftArm(_undamped(arm))
    bend, stretch = first_mode(model, stretch=False), first_mode(model, stretch=True)
    assert bend is not None
    assert stretch is not None
    return [
        (_loss(link.k_e, link.geometry.length, stretch), _loss(link.k_b, link.geometry.length, bend))
        for link in arm.links
    ]


def _loss(stiffness: Noted, length: Noted, mode: Mode) -> float:
    """Return the damping of a strain that has `DAMPING` in a mode of the arm."""
    return rounded(2.0 * DAMPING * stiffness.value * length.value**2 / mode.rate_per_s)


def _undamped(arm: NewArm) -> Robot:
    """Return the robot as far as its damping depends on it."""
    strains: dict[str, Any] = {"strains": {"elongation": {}, "bending_x": {}}} if arm.planar else {}
    links = [
        {
            "length": link.geometry.length.value,
            "radius": link.geometry.radius.value,
            "mass": link.geometry.mass.value,
            "k_e": (link.k_e.value, 0.0, 0.0),
            "k_b": (link.k_b.value, 0.0, 0.0),
            **strains,
        }
        for link in arm.links
    ]
    return robot_from_dict({"name": arm.name, "bend_angle": "geometric", "links": links}, where=arm.name)
