"""The numbers of a robot as flat arrays, in the form that the kernels read."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.robot import Link, Robot, link_damping, link_stiffness, shear_factors

Array: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]
Booleans: TypeAlias = NDArray[np.bool_]

DEFORMED, GEOMETRIC = 0, 1
CREEP, DAHL = 0, 1

# Row of the twist (angular, linear) and sign that one unit of each strain adds: Gamma = (-kappa_y,
# kappa_x, torsion).
_COLUMN = {
    "torsion": (2, 1.0),
    "bending_x": (1, 1.0),
    "bending_y": (0, -1.0),
    "shear_x": (3, 1.0),
    "shear_y": (4, 1.0),
    "elongation": (5, 1.0),
}


class Tables(NamedTuple):
    """Everything that the kernels know about a robot; n links, n_q coordinates, n_z internal states."""

    steps: int
    """Steps a link of the method `mde`."""
    offset: Integers
    """First coordinate of each link, and n_q: (n + 1,)."""
    basis: Array
    """B transposed, one twist a coordinate: (n_q, 6)."""
    reference: Array
    """xi_0 of each link: (n, 6)."""
    length: Array
    radius: Array
    mass: Array
    tip_mass: float
    gravity: Array
    """In the world frame (3,)."""
    base_rotation: Array
    base_position: Array
    nodes: Array
    """Quadrature nodes on (0, 1), with weights that sum to 1."""
    weights: Array
    columns: Integers
    """Coordinate of elongation, bending_x, bending_y of each link, -1 where it is not carried: (n, 3)."""
    law: Array
    """a1 ... a6 of each link, zeros where a material holds: (n, 6)."""
    bend_angle: int
    stiffness: Array
    """Linear stiffness of each coordinate (material), (n_q,)."""
    damping: Array
    actuation: Array
    """H at q = 0, (n_q, n_u)."""
    runs_along: Booleans
    """Which chamber runs along which link, (n, n_u)."""
    axial_gain: Array
    """Area times length of each chamber along each link, (n, n_u)."""
    area_slope: Array
    """Relative growth of the area per fibre strain, (n_u,)."""
    internal_kind: Integers
    """CREEP or DAHL, (n_z,)."""
    internal_coordinate: Integers
    internal_stiffness: Array
    internal_scale: Array
    """Relaxation time [s] of creep, range of hysteresis."""


class MdeTables(Tables):
    """The same for the method `mde`: a type of its own, so that kernels of one method alone are compiled."""


def build_tables(robot: Robot, method: str, nodes: int, steps: int) -> Tables:
    """Flatten a robot. `nodes` Gauss-Legendre nodes a link, `steps` of `mde` a link."""
    links = robot.links
    offset = np.concatenate(([0], np.cumsum([len(link.strains) for link in links]))).astype(np.int64)
    basis = np.zeros((robot.n_q, 6))
    for row, name in enumerate(name for link in links for name in link.strains):
        component, sign = _COLUMN[name]
        basis[row, component] = sign
    abscissae, weights = np.polynomial.legendre.leggauss(nodes)
    kinds, coordinates, stiffnesses, scales = _internal(robot, offset)
    actuation, axial_gain, runs_along = _chambers(robot, offset)
    kind = MdeTables if method == "mde" else Tables
    return kind(
        steps=steps,
        offset=offset,
        basis=basis,
        reference=np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(links), 1)),
        length=np.array([link.length for link in links], dtype=np.float64),
        radius=np.array([link.radius for link in links], dtype=np.float64),
        mass=np.array([link.mass for link in links], dtype=np.float64),
        tip_mass=float(robot.tip_mass),
        gravity=np.array(robot.gravity, dtype=np.float64),
        base_rotation=rotation_matrix(robot.base_quaternion),
        base_position=np.array(robot.base_position, dtype=np.float64),
        nodes=np.ascontiguousarray((abscissae + 1.0) / 2.0),
        weights=np.ascontiguousarray(weights / 2.0),
        columns=np.array([_columns(link, first) for link, first in zip(links, offset, strict=False)]),
        law=np.array([_law(link) for link in links], dtype=np.float64),
        bend_angle=DEFORMED if robot.bend_angle == "deformed" else GEOMETRIC,
        stiffness=np.concatenate(
            [link_stiffness(link, factor) for link, factor in zip(links, shear_factors(robot), strict=True)]
        ),
        damping=np.concatenate([link_damping(link) for link in links]),
        actuation=actuation,
        runs_along=runs_along,
        axial_gain=axial_gain,
        area_slope=np.array(
            [chamber.area_slope for link in links for chamber in link.chambers], dtype=np.float64
        ),
        internal_kind=np.array(kinds, dtype=np.int64),
        internal_coordinate=np.array(coordinates, dtype=np.int64),
        internal_stiffness=np.array(stiffnesses, dtype=np.float64),
        internal_scale=np.array(scales, dtype=np.float64),
    )


def _chambers(robot: Robot, offset: Integers) -> tuple[Array, Array, Booleans]:
    """H at q = 0 (n_q, n_u), and the axial gain of each chamber along each link and where it runs (n, n_u).

    A chamber of area A at d = r (cos phi, sin phi) does work p A (eps - r (kx cos phi + ky sin phi)) on
    every unit of undeformed length that it runs along (theory.md section 3).
    """
    H = np.zeros((robot.n_q, robot.n_u))
    axial_gain = np.zeros((len(robot.links), robot.n_u))
    runs_along = np.zeros((len(robot.links), robot.n_u), dtype=np.bool_)
    u = -1
    for first, owner in enumerate(robot.links):
        group = range(first, min(first + robot.refinement, len(robot.links)))
        whole = sum(robot.links[i].length for i in group)
        for chamber in owner.chambers:
            u += 1
            for i in group:
                link = robot.links[i]
                if chamber.area_m2 is not None and chamber.offset_m is not None:
                    axial = chamber.area_m2 * link.length
                    bending = axial * chamber.offset_m
                else:
                    assert chamber.alpha_eps is not None
                    assert chamber.alpha_kappa is not None
                    axial = chamber.alpha_eps * link.length / whole
                    bending = chamber.alpha_kappa * link.length / whole
                gains = {
                    "elongation": axial,
                    "bending_x": -bending * np.cos(chamber.angle_rad),
                    "bending_y": -bending * np.sin(chamber.angle_rad),
                }
                H[offset[i] : offset[i + 1], u] = [gains.get(name, 0.0) for name in link.strains]
                axial_gain[i, u] = axial
                runs_along[i, u] = True
    return H, axial_gain, runs_along


def rotation_matrix(quaternion: tuple[float, ...]) -> Array:
    """Rotation matrix of a quaternion (x, y, z, w), normalised here so that it is orthogonal to round-off."""
    x, y, z, w = np.array(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _columns(link: Link, first: int) -> list[int]:
    names = list(link.strains)
    wanted = ("elongation", "bending_x", "bending_y")
    return [int(first) + names.index(name) if name in names else -1 for name in wanted]


def _law(link: Link) -> list[float]:
    if link.k_e is None or link.k_b is None:
        return [0.0] * 6
    return [*link.k_e, *link.k_b]


def _internal(robot: Robot, offset: Integers) -> tuple[list[int], list[int], list[float], list[float]]:
    """Internal states: all creep branches link by link, then all hysteresis elements."""
    kinds: list[int] = []
    coordinates: list[int] = []
    stiffnesses: list[float] = []
    scales: list[float] = []

    def add(kind: int, first: int, stiffness: tuple[float, ...], scale: tuple[float, ...]) -> None:
        kinds.extend([kind] * len(stiffness))
        coordinates.extend(range(first, first + len(stiffness)))
        stiffnesses.extend(stiffness)
        scales.extend(scale if len(scale) == len(stiffness) else scale * len(stiffness))

    for link, first in zip(robot.links, offset, strict=False):
        for branch in link.creep:
            add(CREEP, int(first), branch.stiffness, branch.tau)
    for link, first in zip(robot.links, offset, strict=False):
        for element in link.hysteresis:
            add(DAHL, int(first), element.stiffness, element.range)
    return kinds, coordinates, stiffnesses, scales
