"""Robots that differ from the file of their controller in structure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from soro_core.robot import Link, Robot, load_robot
from soro_core.robot.discretisation import with_basis
from soro_core.robot.parts import fields


def relinked(robot: Robot, change: Callable[[Link], Mapping[str, Any]]) -> Robot:
    """Return the robot with changed keys of each link."""
    return robot.replace(links=[{**fields(link), **change(link)} for link in robot.links])


def sloped(slope: float, stiffness: float = 1.0, order: int = 0) -> Callable[[Robot], Robot]:
    """Truth with another area slope, part of the bending stiffness, and strains of a Legendre order."""

    def change(link: Link) -> Mapping[str, Any]:
        a4, a5, a6 = link.k_b
        chambers = [{**fields(chamber), "area_slope": slope} for chamber in link.chambers]
        return {"chambers": chambers, "k_b": [stiffness * a4, stiffness * a5, a6]}

    return lambda robot: varying(order)(relinked(robot, change))


def weak(number: int, part: float) -> Callable[[Robot], Robot]:
    """Truth with one chamber of each link that gives a part of its force."""

    def change(link: Link) -> Mapping[str, Any]:
        return {
            "chambers": [scaled(one, part if i == number else 1.0) for i, one in enumerate(link.chambers)]
        }

    return lambda robot: relinked(robot, change)


def scaled(chamber: Any, part: float) -> dict[str, Any]:
    """Return the keys of a chamber that gives a part of the force."""
    found = fields(chamber)
    return {
        k: part * v if k in ("alpha_eps", "alpha_kappa", "area_m2") and v else v for k, v in found.items()
    }


def varying(order: int) -> Callable[[Robot], Robot]:
    """Truth with strains that vary along each link."""
    return lambda robot: with_basis(robot, "legendre", order) if order else robot


def four_chambers() -> Robot:
    """A hanging arm of one link with four chambers at uneven angles."""
    chambers = [
        {"angle_rad": float(np.deg2rad(angle)), "area_m2": 1.2e-4, "offset_m": 0.012}
        for angle in (0.0, 70.0, 170.0, 280.0)
    ]
    link = {
        "length": 0.12,
        "radius": 0.018,
        "mass": 0.08,
        "k_e": [1500.0, 0.0, 0.0],
        "k_b": [0.06, 0.0, 0.0],
        "damping": [0.08, 3e-6, 3e-6],
        "chambers": chambers,
    }
    return Robot(
        name="four_chambers",
        base_quaternion=(1.0, 0.0, 0.0, 0.0),
        pressure_range_pa=(0.0, 90e3),
        links=[link],
    )


def four_uneven(robot: Robot) -> Robot:
    """Truth of `four_chambers`: one weak chamber, strains that vary, creep."""

    def change(link: Link) -> Mapping[str, Any]:
        creep = [{"tau": [0.5], "stiffness": [0.0, 1e-4, 1e-4]}]
        return {
            "chambers": [scaled(c, 0.55 if i == 2 else 1.0) for i, c in enumerate(link.chambers)],
            "creep": creep,
        }

    return varying(1)(relinked(robot, change))


def guessed() -> Robot:
    """The guess with which the identification of the fabric arm begins."""
    return load_robot(Path(__file__).parents[1] / "examples" / "asu_two_segment_guess.yaml")


def write_robot(robot: Robot, path: Path, keys: Mapping[str, Any] | None = None) -> str:
    """Write the file of a robot, or of some of its keys beside others; return its path."""
    own = robot.model_dump(mode="json", exclude_defaults=True)
    found = own if keys is None else {**keys, "links": own["links"]}
    # Coordinates have the order of the strains.
    path.write_text(yaml.safe_dump(found, sort_keys=False))
    return str(path)
