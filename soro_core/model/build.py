"""The tables of a robot: from its description to flat arrays."""

from __future__ import annotations

import math

import numpy as np

from soro_core.arrays import Array, Integers
from soro_core.model.build_external import external_table, find, places_of, with_masses
from soro_core.model.forces.routing import no_tendons, tendon_points
from soro_core.model.tables import CREEP, DAHL, DEFORMED, GEOMETRIC, FixedBase, MdeTables, Site, Tables
from soro_core.robot import Link, Robot, link_damping, link_stiffness, shear_factors
from soro_core.robot.basis import (
    knots,
    mass_profile,
    on_pieces,
    radius_profile,
    rest_strain,
    shape_means,
    shape_values,
    stiffness_profile,
    strain_rows,
)
from soro_core.robot.link import LEAST_ELONGATION
from soro_core.rotation import matrix_from_quaternion

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
# Where on a sub-interval the strain is evaluated: Gauss points, and the stages of Ralston's rule.
MAGNUS = np.array([0.5 - np.sqrt(3.0) / 6.0, 0.5 + np.sqrt(3.0) / 6.0])
RALSTON = np.array([0.0, 2.0 / 3.0])
# Their number of digits doubles with each: five give all of them for up to 100 nodes.
_NEWTON_STEPS = 8
# Nodes of each piece between two sections of a link.
_FEWEST = 3


def build_tables(robot: Robot, method: str, nodes: int, steps: int) -> Tables:
    """Flatten a robot into the arrays that the kernels read.

    Parameters
    ----------
    robot : Robot
    method : {"exact", "mde"}
    nodes : int
        Gauss-Radau nodes a link.
    steps : int
        Steps of `mde` a link.
    """
    links = robot.links
    offset = np.concatenate(([0], np.cumsum([link.n_q for link in links]))).astype(np.int64)
    basis = np.zeros((robot.n_q, 6))
    for row, name in enumerate(name for link in links for name in strain_rows(link)):
        component, sign = _COLUMN[name]
        basis[row, component] = sign
    places, weights, point_mass = with_masses(robot, *_quadrature(robot, nodes))
    fraction, points = _sub_intervals(method, places, steps)
    kinds, coordinates, stiffnesses, scales = _internal(robot, offset)
    samples, actuation, area_rate, saturation, braid, axial_gain = _chambers(robot, offset, places, weights)
    law_share, axial_share = _law_shares(robot, places, weights)
    kind = MdeTables if method == "mde" else Tables
    tables = kind(
        steps=steps,
        offset=offset,
        basis=basis,
        varying=np.array([link.varies or link.varies_at_rest for link in links]),
        fraction=fraction,
        shape=np.ascontiguousarray(
            _shapes(robot, points.ravel()).reshape(robot.n_q, *points.shape).transpose(1, 0, 2)
        ),
        shape_node=_shapes(robot, places),
        reference=_at_rest(robot, points),
        length=np.array([link.length for link in links], dtype=np.float64),
        gyration=np.array([0.25 * radius_profile(link, places) ** 2 for link in links]),
        mass=np.array([link.mass for link in links], dtype=np.float64),
        mass_share=np.array(
            [weights * mass_profile(link, places) if link.sections else weights for link in links]
        ),
        tip_mass=np.array([robot.tip_mass], dtype=np.float64),
        point_mass=point_mass,
        gravity=np.array(robot.gravity, dtype=np.float64),
        base_rotation=matrix_from_quaternion(np.array(robot.base_quaternion)),
        base_position=np.array(robot.base_position, dtype=np.float64),
        nodes=places,
        columns=np.array([_columns(link, first) for link, first in zip(links, offset, strict=False)]),
        law=np.array([_law(link) for link in links], dtype=np.float64),
        law_share=law_share,
        axial_share=axial_share,
        least=np.array([link.least_elongation or LEAST_ELONGATION for link in links]),
        wall=np.array([(link.length * (link.least_elongation or math.inf)) ** -2 for link in links]),
        bend_angle=DEFORMED if robot.bend_angle == "deformed" else GEOMETRIC,
        stiffness=_blocks(
            [link_stiffness(link, factor) for link, factor in zip(links, shear_factors(robot), strict=True)]
        ),
        damping=_blocks([link_damping(link) for link in links]),
        chamber_samples=samples,
        actuation=actuation,
        area_rate=area_rate,
        area_saturation=saturation,
        braid=braid,
        dead_band=_by_input(robot, [c.dead_band_pa for link in links for c in link.chambers]),
        swell=_by_input(robot, [c.swell_per_pa for link in links for c in link.chambers]),
        axial_gain=axial_gain,
        internal_kind=np.array(kinds, dtype=np.int64),
        internal_coordinate=np.array(coordinates, dtype=np.int64),
        internal_stiffness=np.array(stiffnesses, dtype=np.float64),
        internal_scale=np.array(scales, dtype=np.float64),
        external=external_table(robot, [], robot.n_q),
        tendons=no_tendons(),
        base=FixedBase(np.zeros(6), np.zeros(6)),
    )
    if robot.tendons:
        tables = tables._replace(tendons=tendon_points(robot, tables, radau))
    sites = []
    for link, place, what in places_of(robot):
        site = build_site(robot, tables, link, place)
        at_end = place == robot.links[link].length
        sites.append((what, site._replace(whole=len(fraction)) if at_end else site))
    return tables._replace(external=external_table(robot, sites, robot.n_q))


def _quadrature(robot: Robot, nodes: int) -> tuple[Array, Array]:
    """Nodes and weights on (0, 1): where sections lie inside links, a rule on each piece between them."""
    ends = np.concatenate([knots(link) for link in robot.links])
    ends = np.unique(np.round(ends, 9))
    pieces = len(ends) - 1
    if pieces == 1:
        return radau(nodes)
    places, weights = on_pieces(ends, *radau(max(_FEWEST, math.ceil(nodes / pieces))))
    places[-1] = 1.0
    return places, weights


def radau(n: int) -> tuple[Array, Array]:
    """Gauss-Radau nodes and weights on (0, 1), the last node at 1: exact for polynomials of degree 2 n - 2.

    The end of a link is needed anyway, for the links behind it: as a node it costs nothing more.
    """
    # Roots of P_(n-1) + P_n but for -1, by Newton's method from those of the Chebyshev polynomials: numpy
    # takes roots from eigenvalues, which are complex numbers there from release 2.5 on.
    x = -np.cos(2.0 * np.pi * np.arange(1, n) / (2 * n - 1))
    for _ in range(_NEWTON_STEPS):
        before, last = _legendre(n - 1, x), _legendre(n, x)
        x = x - (1.0 - x) / n * (before + last) / (before - last)
    weights = np.concatenate(([2.0 / n**2], (1.0 - x) / (n * _legendre(n - 1, x)) ** 2))
    places = np.concatenate(([-1.0], x))
    return (1.0 - places[::-1]) / 2.0, np.ascontiguousarray(weights[::-1]) / 2.0


def _legendre(degree: int, x: Array) -> Array:
    return np.asarray(np.polynomial.legendre.legval(x, [0.0] * degree + [1.0]), dtype=np.float64)


def find_site(robot: Robot, t: Tables, s: float) -> Site:
    """Look up a place of the arm.

    Parameters
    ----------
    robot : Robot
    t : Tables
        Tables of this robot.
    s : float
        Undeformed arc length from the base of the arm [m].
    """
    return build_site(robot, t, *find(robot, s))


def build_site(robot: Robot, t: Tables, link: int, place: float) -> Site:
    """Look up a place of a link.

    Parameters
    ----------
    robot : Robot
    t : Tables
        Tables of this robot.
    link : int
    place : float
        Undeformed arc length from the base of the link [m].
    """
    length = robot.links[link].length
    ends = np.concatenate(([0.0], np.cumsum(t.fraction))) * length
    whole = min(int(np.searchsorted(ends, place, side="right")) - 1, len(t.fraction) - 1)
    step = place - ends[whole]
    shape = np.zeros((robot.n_q, 2))
    points = RALSTON if isinstance(t, MdeTables) else MAGNUS
    rows = slice(t.offset[link], t.offset[link + 1])
    at = np.clip(ends[whole] + step * points, 0.0, length)
    shape[rows] = shape_values(robot.links[link], at)
    return Site(link, float(place), whole, float(step), shape, rest_strain(robot.links[link], at / length))


def _chambers(
    robot: Robot, offset: Integers, places: Array, weights: Array
) -> tuple[Integers, Array, Array, Array, Array, Array]:
    """Numbers of samples, actuation, area rates, area saturations, braids and axial gains of `Tables`.

    A chamber of area A at d = r (cos phi, sin phi) does work p A (eps - r (kx cos phi + ky sin phi)) on
    every unit of undeformed length that it runs along, docs/model.md (23).
    """
    at, shares = places[weights > 0.0], weights[weights > 0.0]
    n = len(robot.links)
    samples = np.zeros((n, robot.n_u), dtype=np.int64)
    actuation = np.zeros((len(at), robot.n_q, robot.n_u))
    area_rate = np.zeros((len(at), n, robot.n_u))
    saturation, braid, axial_gain = (np.zeros((n, robot.n_u)) for _ in range(3))
    u = -1
    for first, owner in enumerate(robot.links):
        group = range(first, min(first + robot.refinement, n))
        whole = sum(robot.links[i].length for i in group)
        for chamber in owner.chambers:
            u += 1
            for i in group:
                link = robot.links[i]
                axial, bending = chamber.gains(link.length, whole)
                gains = {
                    "elongation": axial,
                    "bending_x": -bending * np.cos(chamber.angle_rad),
                    "bending_y": -bending * np.sin(chamber.angle_rad),
                }
                # By strain a muscle grows as its braid says.
                growth = chamber.area_slope if chamber.muscle is None else 1.0
                share, shape = np.ones(1), shape_means(link)[None]
                if growth != 0.0 and link.varies:
                    share, shape = shares, shares[:, None] * shape_values(link, at * link.length).T
                k = len(share)
                unit = np.array([gains.get(name, 0.0) for name in strain_rows(link)])
                actuation[:k, offset[i] : offset[i + 1], u] = unit * shape
                if growth != 0.0:
                    area_rate[:k, i, u] = growth / (share * axial)
                samples[i, u] = k
                saturation[i, u], axial_gain[i, u] = chamber.area_saturation, axial
                if chamber.muscle is not None:
                    braid[i, u] = chamber.muscle.braid
    most = samples.max(initial=1)
    return samples, actuation[:most], area_rate[:most], saturation, braid, axial_gain


def _by_input(robot: Robot, of_chambers: list[float]) -> Array:
    """Values of the chambers, and zeros of the tendons behind them, (n_u,)."""
    return np.array(of_chambers + [0.0] * len(robot.tendons), dtype=np.float64)


def _columns(link: Link, first: int) -> list[list[int]]:
    names = strain_rows(link)
    wanted = ("elongation", "bending_x", "bending_y")
    begin = [int(first) + names.index(name) if name in names else 0 for name in wanted]
    return [[b, b + names.count(name)] for b, name in zip(begin, wanted, strict=True)]


def _sub_intervals(method: str, places: Array, steps: int) -> tuple[Array, Array]:
    """Lengths of the sub-intervals on (0, 1), and the two points of each, (n_sub, 2)."""
    if method == "mde":
        start = np.arange(steps) / steps
        return np.full(steps, 1.0 / steps), start[:, None] + RALSTON / steps
    ends = np.concatenate(([0.0], places))
    length = np.diff(ends)
    return length, ends[:-1, None] + length[:, None] * MAGNUS


def _shapes(robot: Robot, places: Array) -> Array:
    """Shape functions (n_q, n) at places on (0, 1) of each link."""
    return np.ascontiguousarray(
        np.concatenate([shape_values(link, np.clip(places, 0.0, 1.0) * link.length) for link in robot.links])
    )


def _blocks(matrices: list[Array]) -> Array:
    width = max(len(matrix) for matrix in matrices)
    return np.concatenate([np.pad(matrix, ((0, 0), (0, width - len(matrix)))) for matrix in matrices])


def _law(link: Link) -> list[float]:
    if link.k_e is None or link.k_b is None:
        return [0.0] * 6
    return [*link.k_e, *link.k_b]


def _law_shares(robot: Robot, places: Array, weights: Array) -> tuple[Array, Array]:
    """`Tables.law_share`, `Tables.axial_share`: each has the mean 1 along a link."""
    bending, axial = np.ones((2, len(robot.links), len(places)))
    for i, link in enumerate(robot.links):
        if link.varies or link.varies_at_rest:
            bending[i] = weights
            if link.sections:
                stiffer, axially = (
                    stiffness_profile(link, name, places) for name in ("bending_x", "elongation")
                )
                bending[i] *= stiffer / (weights @ stiffer)
                axial[i] = axially / stiffer * (weights @ stiffer) / (weights @ axially)
    return bending, axial


def _at_rest(robot: Robot, points: Array) -> Array:
    """`Tables.reference` of the points (n_sub, 2) on (0, 1)."""
    at = [rest_strain(link, points.ravel()).reshape(*points.shape, 6) for link in robot.links]
    return np.ascontiguousarray(np.stack(at, axis=1))


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
