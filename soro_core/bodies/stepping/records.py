"""What the kernels of a world know and write: bodies, arms and contacts as flat arrays.

A *mover* is what contacts move: first the arms, each with its coordinates and those of the arms that it
carries, then the bodies, each with its twist (angular, linear) in the world, about its centre of mass. Rows
of movers are padded to one width.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core._box import Box, address_of
from soro_core._jit import kernel
from soro_core.arrays import Array, Flags, Integers

BALL, CAPSULE, CYLINDER, BOX, GROUND, MESH = 0, 1, 2, 3, 4, 5
# Entries of `BodyTables.counts`.
CORNERS, PLANES, EDGES, TRIANGLES = 0, 1, 2, 3
FREE, HINGED, DRIVEN = 0, 1, 2
# Entries of `BodyTables.hinge`: a point of the axis, its direction, the centre of mass from the point at
# angle 0 (all in the world), stiffness, damping, least and largest angle, and inertia about the axis.
POINT, AXIS, ARM, SPRING, DAMPER, LOW, HIGH, ABOUT_AXIS, HINGE_WIDTH = 0, 3, 6, 9, 10, 11, 12, 13, 14
# Entries of `BodyRows.joint`.
ANGLE, RATE = 0, 1
# In place of a coefficient of friction: both sides are held together.
HELD = -1.0
# Largest number of contacts at a time.
MOST_CONTACTS = 512
# Entries of a stored contact: sides (body, or -1 - section), point, normal, force on the first side, gap.
SIDE_A, SIDE_B, WHERE, NORMAL, FORCE, GAP, CONTACT_WIDTH = 0, 1, 2, 5, 8, 11, 12


class BodyTables(NamedTuple):
    """Parameters of n bodies."""

    kind: Integers
    size: Array
    """Radius; radius and half of the length; half of the edges; of a mesh the nearest face; (n, 3) [m]."""
    bound: Array
    """Radius of the ball about the centre that holds the body [m]; of the ground 0."""
    mass: Array
    inertia: Array
    """About the body's axes, (n, 3) [kg m^2]."""
    motion: Integers
    hinge: Array
    """(n, HINGE_WIDTH)."""
    at_zero: Array
    """Rotation of a hinged body at angle 0, (n, 3, 3)."""
    friction: Array
    restitution: Array
    gravity: Array
    counts: Integers
    """Of meshes: corners, planes, edges and triangles, (n, 4); rows of these are padded."""
    corner: Array
    """(n, most, 3) [m]."""
    plane: Array
    """Normals outwards and distances, (n, most, 4)."""
    edge: Integers
    """Corners at both ends, (n, most, 2)."""
    triangle: Integers
    """Corners, counter-clockwise from outside, and plane, (n, most, 4)."""


class BodyRows(NamedTuple):
    """State of n bodies, or rows of states with time first."""

    place: Array
    """Centres of mass, (n, 3) [m]."""
    rotation: Array
    """(n, 3, 3)."""
    twist: Array
    """Angular and linear velocity in the world, (n, 6)."""
    joint: Array
    """Angle and rate of hinged bodies, (n, 2)."""


class NoArm(NamedTuple):
    """In place of an arm's `Stepping` in a world without arms, so that no model of an arm is compiled."""

    nothing: int = 0


class MountTables(NamedTuple):
    """Arms at the tips of others, see `mounts`; an arm on its own that carries none does not use its rows."""

    carrier: Integers
    """Arm that carries each arm at its tip, or -1, (n_a,)."""
    is_carrier: Flags
    offset_rotation: Array
    """Base of a carried arm, seen from the tip of its carrier, (n_a, 3, 3)."""
    offset_place: Array
    carried_rotation: Array
    """The same in the world, (n_a, 3, 3)."""
    carried_place: Array
    tip_rotation: Array
    """Tip of each carrier in the world, (n_a, 3, 3)."""
    tip_place: Array
    tip_motion: Array
    """Its twist, and the rate of that, seen from itself, (n_a, 2, 6)."""
    wrench: Array
    """What the base of each arm takes, seen from itself, (n_a, 6)."""
    columns: Array
    """J' of the tip of a carrier; B of a carried arm; (n_a, width, 6)."""
    answers: Array
    """A^-1 of these, (n_a, width, 6)."""
    load: Array
    """On the tip of a carrier what it carries, like the inertia of a body; then its gain; (n_a, 6, 6)."""
    scratch: Array
    """(3, 6)."""
    block: Array
    """(2, 6, 6)."""
    pivots: Integers
    no_gravity: Array
    no_wrench: Array
    """No wrenches on bases, (n_a, 6)."""


class ArmTables(NamedTuple):
    """Arms, and the sections along them between which contacts are looked for."""

    address: Integers
    """`soro_core._box.address_of` of each arm's `Stepping`, (n_a,)."""
    first_q: Integers
    """First coordinate of each arm in a row of all, (n_a + 1,); so internal states and inputs."""
    first_z: Integers
    first_u: Integers
    first_site: Integers
    mover: Integers
    """Row of `Movers` that has each arm, and its first column there, (n_a,)."""
    column: Integers
    first_arm: Integers
    """Of each such row the arm that stands on its own base, (n_m,)."""
    mounts: MountTables
    link: Integers
    """Of each section, with what follows as in `soro_core.model.tables.Site`, (n_s, ...)."""
    place: Array
    whole: Integers
    step: Array
    shape: Array
    rest: Array
    radius: Array
    arc: Array
    """Places along the whole arm [m], (n_s,)."""
    friction: float
    """Where arms touch arms."""
    touch_arms: bool
    joint_arm: Integers
    """Arm, section and body of each point that holds a body on an arm, (n_j,)."""
    joint_section: Integers
    joint_body: Integers
    joint_offset: Array
    """Where the point is in the frames of section and body, (n_j, 2, 3) [m]."""
    R: Array
    """Rotations of the sections at the start of a step, (n_s, 3, 3)."""
    p: Array
    columns: Array
    """Body Jacobians there, one coordinate a row, (n_s, width, 6)."""
    piece: Array
    """Curves that begin there, as in `near`, (n_s, 4, 3); their middles, and their reach."""
    middle: Array
    half: Array
    acceleration: Array
    """Of the last step, (n_a, width)."""
    residual: Array
    """Scratch of Newton's iteration, by mover, (n_a, width)."""
    change: Array
    """Last correction of each arm relative to its scale, (n_a,)."""
    failed: Integers
    """The arm that is at work, (1,)."""
    no_wrench: Array
    base_twist: Array
    """Angular and linear velocity of each base in the world at the end of the step, (n_a, 6).

    Of one that an arm carries by the speeds at its start."""
    base_place: Array
    """Places of the bases at its start, (n_a, 3)."""


class Movers(NamedTuple):
    """Velocities of arms and bodies over a step, (n_m, width), and what all contacts share."""

    start: Array
    free: Array
    """At the end of the step without contact."""
    end: Array
    theta: Array
    """Part of the step at which the equation of each mover holds: 1/2, or 1 where it may touch; (n_m,)."""
    n_arms: int
    """Number of movers that are arms, each with those that it carries; the bodies are behind them."""
    effective: Array
    """Inertia of hinged bodies with damping and spring, (n_m,)."""
    stiffness: float
    reach: float


class ContactTables(NamedTuple):
    """Contacts of a step, their number first."""

    counts: Integers
    """(1,), and behind it the number of those of the step before: (2,)."""
    key: Integers
    """Which surfaces: equal from step to step."""
    side: Integers
    """Bodies, or -1 - section where a piece of an arm begins; at a limit twice the hinged body; (n, 2)."""
    part: Array
    """Where the point lies on that piece, 0 to 1, (n, 2)."""
    point: Array
    frame: Array
    """Rows: normal, out of the second side, and two tangents, (n, 3, 3)."""
    gap: Array
    friction: Array
    """Coefficient, or HELD."""
    restitution: Array
    apart: Array
    """The first side's point less the second's, of sides that are held together, (n, 3) [m]."""
    given: Array
    """Speed at the end of the step that moves no mover: of an arm's base, (n, 3)."""
    mover: Integers
    """(n, 2)."""
    G: Array
    """Speed along the frame per velocity of the mover, with its sign, (n, 2, 3, width)."""
    Y: Array
    """A^-1 G': velocity of the mover per impulse, (n, 2, 3, width)."""
    D: Array
    """Speed of the contact per impulse on it, (n, 3, 3)."""
    bias: Array
    """Least normal speed at the end of the step; the rate at which held sides close in, (n,)."""
    hard: Flags
    """Impacts, (n,)."""
    soft: Array
    """Share of the bias that a normal impulse takes away, (n,)."""
    impulse: Array
    """Along the frame [N s], (n, 3); before a sweep; and the change by the last one."""
    before: Array
    step: Array
    old_key: Integers
    old_impulse: Array
    block: Array
    """Scratch, (7, 3)."""


class WorldTables(NamedTuple):
    """All of a world but its arms."""

    bodies: BodyTables
    now: BodyRows
    """At the start of the step."""
    then: BodyRows
    """At its end."""
    movers: Movers
    contacts: ContactTables
    points: Array
    """Scratch: points and directions, (N_POINTS, 3)."""
    corners: Array
    """Corners of a body, (12 or more, 3)."""


class StepPart(NamedTuple):
    """A part of a step in time."""

    h: float
    """[s]."""
    done: float
    """Fraction of the whole step that is done, and that this part is."""
    part: float
    pressure: Array
    """At the start, the middle and the end of the whole step, (3, n_u)."""


# Rows of `WorldTables.points`. The first three, and ENDS and TOWARDS, serve any function. Others: an
# edge of a body as a piece; places on two pieces and their derivatives; the normal of a surface in the world
# and in the body; a point seen from a body.
ENDS, TOWARDS, EDGE, HERE, ALONG, BEND, THERE, ALONG_OTHER, BEND_OTHER = 3, 4, 5, 9, 10, 11, 12, 13, 14
OUT, LOCAL_OUT, LOCAL, FACING, N_POINTS = 15, 16, 17, 18, 19


@kernel
def make_world(bodies: BodyTables, stiffness: float, reach: float, sizes: tuple[int, int]) -> Box:
    """Return a `WorldTables` in a box; `sizes`: number of movers that are arms, width of a row."""
    n_arms, width = sizes
    n_b = bodies.kind.shape[0]
    n = n_arms + n_b
    most = MOST_CONTACTS
    movers = Movers(
        np.zeros((n, width)),
        np.zeros((n, width)),
        np.zeros((n, width)),
        np.ones(n),
        n_arms,
        np.ones(n),
        stiffness,
        reach,
    )
    contacts = ContactTables(
        np.zeros(2, dtype=np.int64),
        np.zeros(most, dtype=np.int64),
        np.zeros((most, 2), dtype=np.int64),
        np.zeros((most, 2)),
        np.zeros((most, 3)),
        np.zeros((most, 3, 3)),
        np.zeros(most),
        np.zeros(most),
        np.zeros(most),
        np.zeros((most, 3)),
        np.zeros((most, 3)),
        np.zeros((most, 2), dtype=np.int64),
        np.zeros((most, 2, 3, width)),
        np.zeros((most, 2, 3, width)),
        np.zeros((most, 3, 3)),
        np.zeros(most),
        np.zeros(most, dtype=np.bool_),
        np.zeros(most),
        np.zeros((most, 3)),
        np.zeros((most, 3)),
        np.zeros((most, 3)),
        np.zeros(most, dtype=np.int64),
        np.zeros((most, 3)),
        np.zeros((7, 3)),
    )
    now = BodyRows(np.zeros((n_b, 3)), np.zeros((n_b, 3, 3)), np.zeros((n_b, 6)), np.zeros((n_b, 2)))
    then = BodyRows(np.zeros((n_b, 3)), np.zeros((n_b, 3, 3)), np.zeros((n_b, 6)), np.zeros((n_b, 2)))
    corners = np.zeros((max(12, bodies.corner.shape[1]), 3))
    return Box(WorldTables(bodies, now, then, movers, contacts, np.zeros((N_POINTS, 3)), corners))


@kernel
def boxed(tables: ArmTables | NoArm) -> Box:
    """Tables in a box."""
    return Box(tables)


@kernel
def address_in(box: Box) -> int:
    """Address of what is in a box."""
    return int(address_of(box))
