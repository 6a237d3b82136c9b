"""From the tendons of a robot to the points at which kernels see them, docs/model_terms.md."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from soro_core.arrays import Array
from soro_core.model.tables import NoTendons, Tables, Tendons
from soro_core.robot import Link, Robot
from soro_core.robot.basis import knots, on_pieces, rest_strain, shape_values

# Points a link of a winding tendon or a varying strain: to 1e-10 of the length for a link bent by 3 rad.
_LEAST, _PER_SIZE, _PER_TURN = 10, 2, 9


def no_tendons() -> NoTendons:
    """Return the points of no tendon."""
    none = np.zeros(0, dtype=np.int64)
    return NoTendons(none, none, np.zeros(0), np.zeros((0, 3)), np.zeros((0, 1, 3)))


def tendon_points(robot: Robot, t: Tables, rule: Callable[[int], tuple[Array, Array]]) -> Tendons:
    """Return the points of all tendons.

    Parameters
    ----------
    robot : Robot
        With tendons.
    t : Tables
        Its tables.
    rule : callable
        Gives n nodes and weights on (0, 1) for a number n.
    """
    inputs: list[int] = []
    links: list[int] = []
    weights: list[float] = []
    rest: list[Array] = []
    columns: list[Array] = []
    width = t.stiffness.shape[1]
    for k, tendon in enumerate(robot.tendons):
        begin, last = tendon.links or (0, len(robot.links) // robot.refinement - 1)
        along = range(begin * robot.refinement, (last + 1) * robot.refinement)
        rate = 2.0 * math.pi * tendon.turns / sum(robot.links[i].length for i in along)
        start = tendon.angle_rad
        for i in along:
            link, rows = robot.links[i], slice(t.offset[i], t.offset[i + 1])
            at, shares = _places(link, rate * link.length, rule)
            at_rest = rest_strain(link, at)
            shapes = shape_values(link, at * link.length)
            for s, share, shape, strain in zip(at * link.length, shares, shapes.T, at_rest, strict=True):
                angle = start + rate * s
                out = tendon.offset_m * np.array([math.cos(angle), math.sin(angle), 0.0])
                onward = rate * np.array([-out[1], out[0], 0.0])
                column = np.zeros((width, 3))
                column[: link.n_q] = shape[:, None] * _velocity(t.basis[rows], out)
                inputs.append(robot.n_u - len(robot.tendons) + k)
                links.append(i)
                weights.append(share * link.length)
                rest.append(_velocity(strain, out) + onward)
                columns.append(column)
            start += rate * link.length
    return Tendons(
        np.array(inputs, dtype=np.int64),
        np.array(links, dtype=np.int64),
        np.array(weights, dtype=np.float64),
        np.array(rest),
        np.array(columns),
    )


def _places(link: Link, turn: float, rule: Callable[[int], tuple[Array, Array]]) -> tuple[Array, Array]:
    """Places on (0, 1) of a link and their weights; one where neither the tendon turns nor a strain varies.

    `turn`: of the tendon along the link [rad]. Between sections the strain at rest is smooth.
    """
    if turn == 0.0 and not link.varies and not link.varies_at_rest:
        return np.array([0.5]), np.ones(1)
    size = max(field.size for field in link.strains.values()) if link.varies else 0
    points = rule(_LEAST + _PER_SIZE * size + math.ceil(_PER_TURN * abs(turn) / (2.0 * math.pi)))
    return on_pieces(knots(link), *points)


def _velocity(twist: Array, at: Array) -> Array:
    """Velocity of a point of the section, of twists (..., 6)."""
    return twist[..., 3:] + np.cross(twist[..., :3], at)
