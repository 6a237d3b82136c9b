"""The numbers of a robot as flat arrays, in the form that the kernels read; `build` makes them."""

from __future__ import annotations

from typing import NamedTuple

from soro_core.arrays import Array, Flags, Integers

DEFORMED, GEOMETRIC = 0, 1
CREEP, DAHL, AIR = 0, 1, 2
# What acts at a place; 0 and above: the first number of its wrench.
CONTACT, HELD = -1, -2


class External(NamedTuple):
    """Places where something acts from outside, outward along the arm."""

    first: Integers
    """First place of each link, and behind the last: (n + 1,)."""
    place: Array
    """Metres from the base of the link, (n_places,)."""
    kind: Integers
    """CONTACT, HELD, or where its wrench begins."""
    whole: Integers
    """Sub-intervals of the link before it; all of them at its end."""
    step: Array
    """Metres beyond them."""
    shape: Array
    """Shape functions on that last piece, as in `Tables.shape`: (n_places, n_q, 2)."""
    rest: Array
    """xi_0 there, (n_places, 2, 6)."""
    radius: Array
    """Radius of the section [m], (n_places,)."""
    obstacles: Array
    """Rows as in `soro_core.model.forces.contact`, (n_obstacles, 14): an array, so that the
    twin can move a wall of its own tables."""
    clock: Array
    """Time for which obstacles have moved from their points [s]: at a stage, and at the start of its step; a
    run counts it from its begin, and only obstacles with a velocity see it. (2,)."""
    held: Array
    """Place where the tip is held, stiffness [N/m] and damping [N s/m] along each axis of the world: (9,)."""


class NoExternal(External):
    """The same without a place: its own type, so that kernels of an arm on which nothing acts skip it."""


class Tendons(NamedTuple):
    """Points of all tendons at which their lengths are summed up, docs/model_terms.md."""

    input: Integers
    """Row of its tendon among the inputs, (n_points,)."""
    link: Integers
    """(n_points,)."""
    weight: Array
    """Undeformed length of the backbone that it stands for [m], (n_points,)."""
    rest: Array
    """Tangent of the tendon at q = 0, by arc length of the backbone, seen from the section: (n_points, 3)."""
    columns: Array
    """What one unit of each coordinate of the link adds to it, (n_points, width, 3)."""


class NoTendons(Tendons):
    """The same without a tendon: its own type, so that kernels of an arm without tendons skip them."""


class BaseMotion(NamedTuple):
    """How the base frame moves, seen from itself: its twist, and the rate of these six numbers, (6,) each."""

    twist: Array
    rate: Array


class FixedBase(BaseMotion):
    """A base at rest: its own type, so that kernels of an arm on a fixed base skip it."""


class Tables(NamedTuple):
    """Everything that the kernels know about a robot; n links, n_q coordinates, n_z internal states."""

    steps: int
    """Steps a link of the method `mde`."""
    offset: Integers
    """First coordinate of each link, and n_q: (n + 1,)."""
    basis: Array
    """Twist that one unit of a coordinate's strain adds, (n_q, 6); times its shape function it is B'."""
    varying: Flags
    """Links whose strain varies along them, (n,)."""
    fraction: Array
    """Sub-intervals of a link on (0, 1): their lengths, (n_sub,)."""
    shape: Array
    """Shape function of each coordinate at two points of each sub-interval, the Gauss points of the Magnus
    step or the stages of Ralston's rule: (n_sub, n_q, 2)."""
    shape_node: Array
    """The same at the quadrature nodes, (n_q, n_nodes)."""
    reference: Array
    """xi_0 of each link at two points of each sub-interval, as `shape`: (n_sub, n, 2, 6)."""
    length: Array
    """Undeformed length of each link [m], (n,)."""
    gyration: Array
    """Squared gyration radius of a section about a diameter at each quadrature node [m^2], (n, n_nodes)."""
    mass: Array
    """Mass of each link without point masses [kg], (n,)."""
    mass_share: Array
    """Share of it at each quadrature node, (n, n_nodes)."""
    tip_mass: Array
    """Point mass at the tip [kg], (1,): an array, so that a filter can change that of its own tables."""
    point_mass: Array
    """Point mass at each quadrature node [kg], (n, n_nodes)."""
    gravity: Array
    """Gravity in the world frame [m/s^2], (3,)."""
    base_rotation: Array
    """Rotation of the base frame in the world, (3, 3)."""
    base_position: Array
    """Position of the base frame in the world [m], (3,)."""
    nodes: Array
    """Quadrature nodes on (0, 1)."""
    columns: Integers
    """First coordinate of elongation, bending_x, bending_y of each link, and behind the last: (n, 3, 2)."""
    law: Array
    """a1 ... a6 of each link, zeros where a material holds: (n, 6)."""
    law_share: Array
    """Share of a link that k_b of a node holds for, 1 where strain does not vary: (n, n_nodes)."""
    axial_share: Array
    """The same of k_e, over that of k_b: (n, n_nodes)."""
    least: Array
    """Elongation at which a link has collapsed, (n,)."""
    wall: Array
    """1 / (least elongation L)^2 [1/m^2] where compression stiffens towards it, else 0; (n,)."""
    bend_angle: int
    stiffness: Array
    """Linear stiffness (material), the block of each link: row of a coordinate, (n_q, width)."""
    damping: Array
    """Viscous damping, in the same form."""
    chamber_samples: Integers
    """Number of places of a link where the area of a chamber is evaluated: 0 where the chamber does not run
    along the link, 1 where strain or area is constant, else the number of nodes; (n, n_u)."""
    actuation: Array
    """dV/dq of areas that do not depend on strain, at each sample: (n_samples, n_q, n_u)."""
    area_rate: Array
    """Relative growth of the area per volume displaced there, at each sample [1/m^3]: (n_samples, n, n_u)."""
    area_saturation: Array
    """1 over the largest relative growth of the area of each chamber along each link, 0: none; (n, n_u)."""
    braid: Array
    """3 cos^2 of the braid angle of each muscle along each link, 0 of another chamber; (n, n_u)."""
    dead_band: Array
    """Pressure that each chamber takes before any of it acts [Pa], (n_u,)."""
    swell: Array
    """1 over the pressure beyond its dead band at which each chamber's area is infinite [1/Pa], (n_u,)."""
    axial_gain: Array
    """Area times length of each chamber along each link, (n, n_u)."""
    internal_kind: Integers
    """CREEP, DAHL, or AIR of a run with valves, which moves by other equations; (n_z,)."""
    internal_coordinate: Integers
    """The coordinate that drags each state along, (n_z,)."""
    internal_stiffness: Array
    """Generalised force per unit of the state, (n_z,)."""
    internal_scale: Array
    """Relaxation time [s] of creep, range of hysteresis."""
    external: External
    tendons: Tendons
    base: BaseMotion


class MdeTables(Tables):
    """The same for the method `mde`: its own type, so that only the kernels of one method are compiled."""


class Site(NamedTuple):
    """A place along the arm, in the form that the kernels read."""

    link: int
    place: float
    """Metres from the base of the link."""
    whole: int
    """Sub-intervals that lie before it."""
    step: float
    """Metres beyond them."""
    shape: Array
    """Shape functions on that last piece, as in `Tables.shape`: (n_q, 2)."""
    rest: Array
    """xi_0 there, (2, 6)."""
