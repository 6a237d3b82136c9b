"""A world of arms and rigid bodies: what exists, checked, and its tables for the kernels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from soro_core._box import Box
from soro_core.arrays import Array, Integers
from soro_core.bodies.attached import joint_tables, joints_of, refuse_displaced
from soro_core.bodies.body import GRAVITY, BodyMotion, RigidBody, check_attachments, check_mounts
from soro_core.bodies.mounted import mount_tables, movers_of, tip_frame, under_gravity
from soro_core.bodies.shapes import MeshShape
from soro_core.bodies.stepping.records import (
    ABOUT_AXIS,
    ARM,
    AXIS,
    BALL,
    BOX,
    CAPSULE,
    CYLINDER,
    DAMPER,
    DRIVEN,
    FREE,
    GROUND,
    HIGH,
    HINGE_WIDTH,
    HINGED,
    LOW,
    MESH,
    POINT,
    SPRING,
    ArmTables,
    BodyRows,
    BodyTables,
    NoArm,
    address_in,
    boxed,
    make_world,
)
from soro_core.errors import ModelError, short
from soro_core.integrate.base_motion import WIDTH, Base
from soro_core.integrate.stepper import stepping
from soro_core.model import SoftArm
from soro_core.model.build import find_site
from soro_core.model.checks import number, require
from soro_core.model.tables import NoExternal
from soro_core.robot import BaseState, Robot
from soro_core.robot.basis import radius_profile
from soro_core.robot.link import CLOSE

_EARTH = (0.0, 0.0, -GRAVITY)
_BOUNDS = (
    ("stiffness", 1.0, 1e9),
    ("arm_friction", 0.0, 10.0),
    ("points_per_link", 1, 200),
    ("reach", 0.0, 1e6),
)
_KINDS = {"ball": BALL, "capsule": CAPSULE, "cylinder": CYLINDER, "box": BOX, "ground": GROUND, "mesh": MESH}
# Entries of `BodyTables` on meshes: name, width of a row, and type.
_MESH: tuple[tuple[str, int, type], ...] = (
    ("corner", 3, np.float64),
    ("plane", 4, np.float64),
    ("edge", 2, np.int64),
    ("triangle", 4, np.int64),
)


@dataclass(frozen=True)
class BodyWorld:
    """Arms and rigid bodies that touch each other.

    Attributes
    ----------
    bodies : mapping of str to RigidBody
        By name.
    arms : mapping of str to SoftArm
        By name, each on the base of its robot file; not of the method `mde`. What a robot file has besides
        (contacts, tip constraint) acts as without bodies.
    q0 : mapping of str to (n_q,)
        Coordinates of arms at the start; the others are straight.
    mounts : mapping of str to str
        Arms at the tip of another one, and the arm that carries each: an earlier one on a base of its own.
        The base of the robot file is then seen from that tip, whose z axis goes on along the backbone; the
        two arms do not touch each other, and gravity is that of the carrying arm.
    gravity : (3,)
        Of the bodies [m/s^2]; arms have their own.
    stiffness : float
        Normal force per depth at a contact [N/m]: surfaces are hard, this only keeps the forces unique.
    touch_arms : bool
        Whether arms touch each other and themselves; else they pass through each other.
    arm_friction : float
        Coefficient between arms; between an arm and a body that of the body holds.
    points_per_link : int
        Pieces of an arm's link, each of which touches bodies and pieces at its nearest place.
    reach : float
        Distance from the origin beyond which a body has left the world [m].

    Raises
    ------
    ModelError
        If a value is not allowed.
    ConfigError
        If a body is attached to no arm or place of the world.
    """

    bodies: Mapping[str, RigidBody]
    arms: Mapping[str, SoftArm] = field(default_factory=dict)
    q0: Mapping[str, ArrayLike] = field(default_factory=dict)
    mounts: Mapping[str, str] = field(default_factory=dict)
    gravity: Sequence[float] = _EARTH
    stiffness: float = 5e4
    touch_arms: bool = True
    arm_friction: float = 0.5
    points_per_link: int = 6
    reach: float = 10.0

    def __post_init__(self) -> None:
        for key in ("bodies", "arms", "q0", "mounts"):
            require(getattr(self, key), Mapping, key, "a mapping by name")
        if both := sorted(str(name) for name in self.bodies if name in self.arms):
            raise ModelError(f"arms: {both[0]} is a body too; allowed are names of one thing", "arms")
        for name, body in self.bodies.items():
            require(body, RigidBody, f"bodies: {name}", "a RigidBody")
        for name, arm in self.arms.items():
            require(arm, SoftArm, f"arms: {name}", "a SoftArm")
            if arm.method != "exact":
                raise ModelError(f"arms: {name}: method {arm.method!r}; allowed is 'exact'", name)
        if not self.bodies and not self.arms:
            raise ModelError("bodies: there is none, and no arm; allowed are one or more", "bodies")
        tendons = {bool(arm.robot.tendons) for arm in self.arms.values()}
        if len(tendons) > 1:
            raise ModelError("arms: some have tendons; allowed are tendons on all of them or on none", "arms")
        require(self.touch_arms, bool, "touch_arms", "true or false")
        for key, low, high in _BOUNDS:
            if not low <= number(getattr(self, key)) <= high:
                raise ModelError(
                    f"{key} = {short(getattr(self, key))}: allowed are numbers from {low:g} to {high:g}", key
                )
        if self.points_per_link != int(self.points_per_link):
            raise ModelError(
                f"points_per_link = {self.points_per_link}: allowed are whole numbers", "points_per_link"
            )
        check_mounts(self.mounts, list(self.arms), "world")
        for name in self.mounts:
            if (robot := self.arms[name].robot).contacts or robot.tip_constraint:
                what = "of an arm that another one carries: allowed is neither"
                raise ModelError(f"arms: {name}: contacts or tip_constraint {what}", name)
        check_attachments(self.bodies, {name: arm.length for name, arm in self.arms.items()}, "world")
        refuse_displaced(self.bodies, list(self.arms), self.motions, self.mounts)
        if np.shape(self.gravity) != (3,) or not np.isfinite(self.gravity).all():
            raise ModelError(f"gravity = {short(self.gravity)}: allowed are three numbers", "gravity")

    @property
    def motions(self) -> dict[str, BodyMotion]:
        """The motions of the bodies that state one, by name."""
        return {name: body.motion for name, body in self.bodies.items() if body.motion is not None}

    def frame_of(self, name: str, q: Mapping[str, ArrayLike]) -> Array:
        """Return what the robot file of an arm calls the world (4, 4), in the world: the tip that carries it.

        Parameters
        ----------
        name : str
            Of the arm.
        q : mapping of str to (n_q,)
            Coordinates of arms; the others are straight.
        """
        return tip_frame(self.mounts, self.arms, name, q)

    def side_names(self, sides: Iterable[float], pieces: Sequence[str]) -> list[str]:
        """Return the names of sides of a contact.

        Parameters
        ----------
        sides : iterable of float
            Body, or -1 - section.
        pieces : sequence of str
            Arm of each section.
        """
        bodies = list(self.bodies)
        names = [f"body {bodies[k]}" if k >= 0 else f"arm {pieces[-1 - k]}" for k in map(int, sides)]
        return [name if name not in names[:k] else "itself" for k, name in enumerate(names)]


@dataclass(frozen=True)
class WorldBoxes:
    """What `soro_core.bodies.stepping.step.world_run` takes of a world, and keeps alive."""

    boxes: tuple[Box, Box, Box]
    arms: tuple[SoftArm, ...]
    """As they are computed: alike in what acts on them from outside."""
    steppings: tuple[Box, ...]
    first_q: Integers
    first_z: Integers
    first_u: Integers
    radius: Array
    piece_of: tuple[str, ...]
    """Name of the arm of each section."""
    failed: Integers
    """The arm that has failed, (1,)."""


def bases_of(world: BodyWorld, motions: Mapping[str, Base] | None = None) -> dict[str, Base]:
    """Return the motion of each base of a world in which one moves or an arm carries another, else none.

    Of a carried arm it does not count: its carrier has it.
    """
    if not (motions or world.mounts):
        return {}
    return {name: (motions or {}).get(name, _at_rest) for name in world.arms}


def _at_rest(t: float) -> BaseState:
    return BaseState()


def body_tables(world: BodyWorld) -> BodyTables:
    """Return the tables of the bodies of a world."""
    bodies = list(world.bodies.values())
    extents = [(_KINDS[body.shape.kind], *body.shape.extents()) for body in bodies]
    hinge = np.zeros((len(bodies), HINGE_WIDTH))
    for row, body in zip(hinge, bodies, strict=True):
        if body.hinge is not None and body.mass is not None:
            axis = np.array(body.hinge.axis) / math.hypot(*body.hinge.axis)
            arm = np.array(body.position) - body.hinge.point
            low, high = body.hinge.limits_rad or (-np.inf, np.inf)
            turned = body.rotation @ body.axes
            own = axis @ (turned * body.moments()) @ turned.T @ axis
            row[POINT : POINT + 3], row[AXIS : AXIS + 3], row[ARM : ARM + 3] = body.hinge.point, axis, arm
            row[SPRING], row[DAMPER], row[LOW], row[HIGH] = (
                body.hinge.stiffness,
                body.hinge.damping,
                low,
                high,
            )
            row[ABOUT_AXIS] = own + body.mass * float(np.sum(np.cross(axis, arm) ** 2))
    motions = [DRIVEN if one.fixed else HINGED if one.hinge is not None else FREE for one in bodies]
    return BodyTables(
        kind=np.array([kind for kind, _, _ in extents], dtype=np.int64),
        size=np.array([size for _, size, _ in extents], dtype=np.float64).reshape(-1, 3),
        bound=np.array([bound for _, _, bound in extents], dtype=np.float64),
        mass=np.array([one.mass or 1.0 for one in bodies], dtype=np.float64),
        inertia=np.array([one.moments() for one in bodies]).reshape(-1, 3),
        motion=np.array(motions, dtype=np.int64),
        hinge=hinge,
        at_zero=np.array([one.rotation @ one.axes for one in bodies]).reshape(-1, 3, 3),
        friction=np.array([one.friction for one in bodies], dtype=np.float64),
        restitution=np.array([one.restitution for one in bodies], dtype=np.float64),
        gravity=np.array(world.gravity, dtype=np.float64),
        **_mesh_tables(bodies),
    )


def _mesh_tables(bodies: Sequence[RigidBody]) -> dict[str, Any]:
    """Entries of `BodyTables` on meshes."""
    rows = [_mesh_rows(body) for body in bodies]
    counts = np.array([[len(one) for one in own] for own in rows], dtype=np.int64).reshape(-1, 4)
    found: dict[str, Any] = {"counts": counts}
    for k, (key, width, kind) in enumerate(_MESH):
        found[key] = np.zeros((len(bodies), counts[:, k].max(initial=0), width), dtype=kind)
        for b, own in enumerate(rows):
            found[key][b, : counts[b, k]] = own[k]
    return found


def _mesh_rows(body: RigidBody) -> list[Array | Integers]:
    """Corners, planes, edges and triangles of a body about its principal axes; none of other shapes."""
    if not isinstance(body.shape, MeshShape):
        return [np.zeros((0, width)) for _, width, _ in _MESH]
    solid, axes = body.shape.solid, body.axes
    planes = np.column_stack((solid.planes[:, :3] @ axes, solid.planes[:, 3]))
    return [solid.corners @ axes, planes, solid.edges, solid.triangles]


def first_rows(world: BodyWorld, n: int) -> BodyRows:
    """Return rows of n times for the bodies, of which the first is set."""
    bodies = list(world.bodies.values())
    shape = (n, len(bodies))
    rows = BodyRows(
        np.zeros((*shape, 3)), np.zeros((*shape, 3, 3)), np.zeros((*shape, 6)), np.zeros((*shape, 2))
    )
    for b, one in enumerate(bodies):
        rows.place[0, b], rows.rotation[0, b] = one.position, one.rotation @ one.axes
        rows.twist[0, b] = (*one.angular_velocity, *one.velocity)
    return rows


def build_world(world: BodyWorld, bases: Mapping[str, Base]) -> WorldBoxes:
    """Build tables and workspace of a world, for one thread.

    Parameters
    ----------
    world : BodyWorld
    bases : mapping of str to callable
        Motions of the bases of arms by name, as of `simulate`: of all of them (`bases_of`), or of none.
    """
    arms = _alike(under_gravity(world.mounts, world.arms))
    rows, columns, first_arms = movers_of(world.mounts, world.arms)
    width = max([6, *(column + arm.n_q for column, arm in zip(columns, arms, strict=True))])
    box = make_world(body_tables(world), float(world.stiffness), float(world.reach), (len(first_arms), width))
    wider = WIDTH if bases else 0
    counts = [[0, arm.n_q, arm.n_internal, arm.n_u + wider] for arm in arms]
    first = np.cumsum([[0, 0, 0, 0], *counts], axis=0).astype(np.int64)
    boxes = tuple(stepping(arm, base=bases.get(name)) for name, arm in zip(world.arms, arms, strict=True))
    sites, arc, radius, first_site = [], [], [], [0]
    joints = joints_of(world.bodies, world.arms, world.q0, world.mounts)
    for i, arm in enumerate(arms):
        places = [joint.place for joint in joints if joint.arm == i]
        for s in _sections(arm.robot, int(world.points_per_link), places):
            site = find_site(arm.robot, arm.tables, s)
            sites.append(site)
            arc.append(s)
            link = arm.robot.links[site.link]
            radius.append(radius_profile(link, np.array([site.place / link.length]))[0])
        first_site.append(len(sites))
    n = len(sites)
    shape = np.zeros((n, width, 2))
    for k, site in enumerate(sites):
        shape[k, : len(site.shape)] = site.shape
    tables = ArmTables(
        address=np.array([address_in(one) for one in boxes], dtype=np.int64),
        first_q=first[:, 1],
        first_z=first[:, 2],
        first_u=first[:, 3],
        first_site=np.array(first_site, dtype=np.int64),
        mover=np.array(rows, dtype=np.int64),
        column=np.array(columns, dtype=np.int64),
        first_arm=np.array(first_arms, dtype=np.int64),
        mounts=mount_tables(world.mounts, dict(zip(world.arms, arms, strict=True)), width),
        link=np.array([site.link for site in sites], dtype=np.int64),
        place=np.array([site.place for site in sites], dtype=np.float64),
        whole=np.array([site.whole for site in sites], dtype=np.int64),
        step=np.array([site.step for site in sites], dtype=np.float64),
        shape=shape,
        rest=np.array([site.rest for site in sites], dtype=np.float64),
        radius=np.array(radius, dtype=np.float64),
        arc=np.array(arc, dtype=np.float64),
        friction=float(world.arm_friction),
        touch_arms=bool(world.touch_arms),
        **joint_tables(joints, arc, first_site),
        R=np.zeros((n, 3, 3)),
        p=np.zeros((n, 3)),
        columns=np.zeros((n, width, 6)),
        piece=np.zeros((n, 4, 3)),
        middle=np.zeros((n, 3)),
        half=np.zeros(n),
        acceleration=np.zeros((len(arms), width)),
        residual=np.zeros((len(arms), width)),
        change=np.zeros(len(arms)),
        failed=np.zeros(1, dtype=np.int64),
        no_wrench=np.zeros(6 * (1 + max((len(arm.robot.wrench_places) for arm in arms), default=0))),
        base_twist=np.zeros((len(arms), 6)),
        base_place=np.zeros((len(arms), 3)),
    )
    names = tuple(name for name, k in zip(world.arms, np.diff(first_site), strict=True) for _ in range(k))
    return WorldBoxes(
        (box, boxed(tables), boxes[0] if boxes else boxed(NoArm(0))),
        arms,
        boxes,
        first[:, 1],
        first[:, 2],
        first[:, 3],
        tables.radius,
        names,
        tables.failed,
    )


def _sections(robot: Robot, n: int, places: Sequence[float]) -> list[float]:
    """Places [m] between which an arm has n pieces a link, of the original links where it is refined.

    Those of its joints are among them.
    """
    ends, start = [0.0], 0.0
    for first in range(0, len(robot.links), robot.refinement):
        length = sum(link.length for link in robot.links[first : first + robot.refinement])
        ends += [start + length * (k + 1) / n for k in range(n)]
        start += length
    more = [s for s in set(places) if min(abs(s - end) for end in ends) > CLOSE]
    return sorted([*ends, *more])


def _alike(arms: tuple[SoftArm, ...]) -> tuple[SoftArm, ...]:
    """Return arms whose tables are of one type: those without anything from outside get a place for it."""
    bare = [isinstance(arm.tables.external, NoExternal) for arm in arms]
    if all(bare) or not any(bare):
        return arms
    return tuple(
        SoftArm(arm.robot.replace(wrench_places=[arm.length]), nodes=arm.nodes) if without else arm
        for arm, without in zip(arms, bare, strict=True)
    )
