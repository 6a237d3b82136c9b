"""Print the tables of docs/model.md that help to choose the number of nodes a link.

    python docs/model_nodes.py

Errors are relative to the largest entry: the worst of inertia matrix, Coriolis and gravity force, and the
distance of the tip over the length.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from soro_core import SoftArm, robot_from_dict
from soro_core.model.arm_base import default_nodes
from soro_core.robot import Robot

LENGTH = 0.2
STRAINS = ("bending_x", "bending_y", "elongation")


def rod(field: dict[str, Any]) -> Robot:
    """One link, every strain with the same shape functions."""
    material = {"youngs_modulus": 1e5, "shear_modulus": 3e4}
    link = {"length": LENGTH, "radius": 0.015, "mass": 0.15, "material": material}
    link["strains"] = dict.fromkeys(STRAINS, field)
    return robot_from_dict({"links": [link], "base_quaternion": [0.0, 0.6, 0.0, 0.8]})


def errors(robot: Robot, q: Any, qd: Any, nodes: Sequence[int], converged: int) -> list[tuple[float, float]]:
    """Error of the tip and of the dynamics for each number of nodes."""

    def results(n: int) -> tuple[Any, ...]:
        arm = SoftArm(robot, nodes=n)
        forces = arm.inertia_matrix(q), arm.coriolis_force(q, qd), arm.gravity_force(q)
        return arm.pose(q, LENGTH)[:3, 3], *forces

    tip, *right = results(converged)
    found = []
    for n in nodes:
        at, *got = results(n)
        worst = max(np.abs(a - b).max() / np.abs(b).max() for a, b in zip(got, right, strict=True))
        found.append((float(np.linalg.norm(at - tip)) / LENGTH, float(worst)))
    return found


def row(first: str, cells: Sequence[str]) -> None:
    """Print one line of a table."""
    print(f"| {first} | {' | '.join(cells)} |")


def main() -> None:
    """Print both tables."""
    nodes = (3, 4, 5, 6, 7, 8, 10, 12, 16)
    row("bending angle", [f"{n} nodes" for n in nodes])
    for degrees in (45, 90, 180, 360, 450, 720):
        curvature = np.radians(degrees) / LENGTH
        q, qd = np.array([0.8 * curvature, 0.6 * curvature, 0.1]), np.array([10.0, -5.0, 0.3])
        row(f"{degrees} degrees", [f"{worst:.0e}" for _, worst in errors(rod({}), q, qd, nodes, 40)])
    nodes = (8, 12, 16, 20, 24, 48)
    row("degree", [f"{n} nodes" for n in nodes])
    for degree in (1, 3, 5):
        robot = rod({"basis": "legendre", "order": degree})
        scale = np.repeat([6.0, 6.0, 0.05], degree + 1) / np.tile(np.sqrt(np.arange(degree + 1) + 1), 3)
        q, qd = np.random.default_rng(degree).normal(size=(2, robot.n_q)) * scale * [[1.0], [5.0]]
        cells = [f"{tip:.0e} / {worst:.0e}" for tip, worst in errors(robot, q, qd, nodes, 200)]
        row(f"{degree} (default {default_nodes(robot)})", cells)


if __name__ == "__main__":
    main()
