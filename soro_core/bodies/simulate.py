"""Simulation of a world of arms and bodies with fixed steps in a compiled loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array, Integers
from soro_core.bodies.attached import refuse_displaced
from soro_core.bodies.mounted import arm_energy
from soro_core.bodies.stepping.arms import SLIDING
from soro_core.bodies.stepping.records import (
    CONTACT_WIDTH,
    FORCE,
    GAP,
    MOST_CONTACTS,
    NORMAL,
    SIDE_A,
    SIDE_B,
    WHERE,
    BodyRows,
)
from soro_core.bodies.stepping.step import AWAY, CROWDED, DEEP, FULL, OVERLAP, TURNING, world_run
from soro_core.bodies.world import BodyWorld, WorldBoxes, bases_of, build_world, first_rows
from soro_core.errors import ModelError, short
from soro_core.integrate.base_motion import Base, base_rows
from soro_core.integrate.causes import describe_at
from soro_core.integrate.simulate import MOST_NUMBERS, input_table, step_times
from soro_core.integrate.state import OK, Status
from soro_core.model.checks import finite, refuse_push, require, shaped
from soro_core.model.dynamics import GOOD
from soro_core.robot import BaseState
from soro_core.rotation import rotation_log

Input: TypeAlias = Callable[[float], ArrayLike] | ArrayLike
# Surfaces that touch at the start may overlap by this [m].
_TOUCHING = -1e-6
# Room for contacts in the first part of a run.
_ROOM = 32 * MOST_CONTACTS


@dataclass(frozen=True)
class ContactRows:
    """All contacts that carry, over a run.

    Attributes
    ----------
    behind : (n_t,)
        Number of rows up to and with each time; the forces of time k act over the step that ends there.
    side : (n, 2)
        Body, by its place in the world, or -1 minus the place of an arm, on either side.
    point, normal, force : (n, 3)
        In the world: place [m], normal out of the second side, force on the first one [N].
    gap : (n,)
        At the start of the step [m], negative where surfaces sink in.
    """

    behind: Integers
    side: Integers
    point: Array
    normal: Array
    force: Array
    gap: Array

    @property
    def step(self) -> Integers:
        """Index of the time of each row, (n,)."""
        return np.repeat(np.arange(len(self.behind)), np.diff(self.behind, prepend=0))


@dataclass(frozen=True)
class WorldResult:
    """A simulated run of a world; a failed one ends at its last good state.

    Attributes
    ----------
    t : (n_t,)
        Time [s], 0 included.
    place, rotation, twist : mapping of str to (n_t, 3), (n_t, 3, 3), (n_t, 6)
        Of each body: centre [m], orientation, and angular and linear velocity, in the world.
    angle : mapping of str to (n_t, 2)
        Angle and rate of each hinged body.
    q, qd, internal : mapping of str to (n_t, ...)
        States of each arm.
    contacts : ContactRows
        All contacts at all those times.
    status : Status
        ``ok``, or what failed, when, and what to do.
    world : BodyWorld
        What was simulated.
    """

    t: Array
    place: Mapping[str, Array]
    rotation: Mapping[str, Array]
    twist: Mapping[str, Array]
    angle: Mapping[str, Array]
    q: Mapping[str, Array]
    qd: Mapping[str, Array]
    internal: Mapping[str, Array]
    contacts: ContactRows
    status: Status
    world: BodyWorld

    def contact_force(self, name: str) -> Array:
        """Sum of the contact forces on a body or an arm, (n_t, 3) [N]."""
        own = self._side(name)
        return self._sums((self.contacts.side == own) @ np.array([1.0, -1.0]) * self.contacts.force.T)

    def normal_force(self, name: str) -> Array:
        """Sum of the normal forces on a body or an arm, without joints, (n_t,) [N]."""
        own = (self.contacts.side == self._side(name)).any(axis=1)
        return self._sums((own * (self.contacts.force * self.contacts.normal).sum(axis=1))[None])[:, 0]

    def energy(self) -> Array:
        """Kinetic, gravitational and elastic energy of all bodies and arms, (n_t,) [J].

        Without what creep and hysteresis store, and the motion of bases by `motions`; fixed bodies have none.
        """
        total = np.zeros(len(self.t))
        for name, body in self.world.bodies.items():
            if body.fixed or body.mass is None:
                continue
            spin = np.einsum("kji,kj->ki", self.rotation[name] @ body.axes, self.twist[name][:, :3])
            total += 0.5 * (spin**2) @ body.moments()
            total += 0.5 * body.mass * (self.twist[name][:, 3:] ** 2).sum(axis=1)
            total -= body.mass * self.place[name] @ np.asarray(self.world.gravity)
            if body.hinge is not None:
                total += 0.5 * body.hinge.stiffness * self.angle[name][:, 0] ** 2
        for name in self.world.arms:
            total += arm_energy(self.world.mounts, self.world.arms, name, self.q, self.qd)
        return total

    def _side(self, name: str) -> int:
        if name in self.world.bodies:
            return list(self.world.bodies).index(name)
        if name in self.world.arms:
            return -1 - list(self.world.arms).index(name)
        names = ", ".join([*self.world.bodies, *self.world.arms])
        raise ModelError(f"{short(name)}: allowed are {names}", "name")

    def _sums(self, columns: Array) -> Array:
        rows = np.zeros((len(self.t), len(columns)))
        np.add.at(rows, self.contacts.step, columns.T)
        return rows


def simulate_world(
    world: BodyWorld,
    *,
    t_end: float = 1.0,
    dt: float = 1e-3,
    pressures: Mapping[str, Input] | None = None,
    wrenches: Mapping[str, Input] | None = None,
    motions: Mapping[str, Base] | None = None,
) -> WorldResult:
    """Simulate arms and bodies together, docs/bodies.md.

    Parameters
    ----------
    world : BodyWorld
    t_end, dt : float
        Duration and time step [s]; the last step is shorter if dt does not divide t_end.
    pressures : mapping of str to callable, (n_u,) or (n_t, 3, n_u), optional
        Inputs of each arm, as `pressure` of `soro_core.integrate.simulate`; default 0.
    wrenches : mapping of str to callable or (6,), optional
        Torque [N m] and force [N] on bodies that are not fixed, in the world, about their centres: constant,
        or a function of the time, taken in the middle of each step.
    motions : mapping of str to callable, optional
        Motion of fixed bodies, in place of their own, and of the bases of arms: `BaseState` as a function of
        time, as a `Shake`, of its displacement and rotation from the pose in the world.

    Returns
    -------
    WorldResult
        It ends early with a status if a step fails, surfaces sink through each other, or a body leaves.

    Raises
    ------
    ModelError
        If an argument is not allowed, or bodies overlap at the start.
    """
    require(world, BodyWorld, "world", "a BodyWorld")
    pressures, wrenches, starts = pressures or {}, wrenches or {}, world.q0
    motions = {**world.motions, **(motions or {})}
    refuse_unknown(world, {"pressures": pressures, "q0": starts, "wrenches": wrenches, "motions": motions})
    driven = {name: base for name, base in motions.items() if name in world.bodies}
    refuse_displaced(world.bodies, list(world.arms), motions, world.mounts)
    bases = bases_of(world, {name: base for name, base in motions.items() if name in world.arms})
    built = build_world(world, bases)
    n_q, n_z = int(built.first_q[-1]), int(built.first_z[-1])
    n_b = len(world.bodies)
    times = step_times(t_end, dt, MOST_NUMBERS // (1 + 2 * n_q + n_z + 3 * int(built.first_u[-1]) + 30 * n_b))
    n = len(times)
    q, v, z, rows = np.zeros((n, n_q)), np.zeros((n, n_q)), np.zeros((n, n_z)), first_rows(world, n)
    tables = [np.zeros((n, 3, 0))]
    for i, (name, arm) in enumerate(world.arms.items()):
        table = input_table(pressures.get(name), times, arm.n_u, f"pressures: {name}", name)
        refuse_push(arm.robot, table, f"pressures: {name}")
        tables.append(table)
        if name in bases:
            ends = np.append(times[1:], times[-1])
            tables.append(base_rows(bases[name], arm, np.stack((times, 0.5 * (times + ends), ends), axis=1)))
        if name in starts:
            start = finite(shaped(starts[name], (arm.n_q,), f"q0: {name}", name), f"q0: {name}")
            q[0, built.first_q[i] : built.first_q[i + 1]] = start
            arm.damping_force(start, np.zeros(arm.n_q))  # refuses a collapsed start
    inputs = body_inputs(world, times, wrenches, driven, rows)
    run = (times, np.ascontiguousarray(np.concatenate(tables, axis=2)), inputs, built.radius)
    return run_rows(world, built, run, (q, v, z), rows)


def refuse_unknown(world: BodyWorld, given: Mapping[str, Mapping[str, object]]) -> None:
    """Refuse names that a world does not have, or has not for this; `given`: values by key and name."""
    moved = [name for name, body in world.bodies.items() if body.fixed]
    pushed = [name for name in world.bodies if name not in moved]
    arms = list(world.arms)
    rooted = [name for name in arms if name not in world.mounts]
    allowed = {"pressures": arms, "q0": arms, "wrenches": pushed, "motions": [*moved, *rooted]}
    for key, values in given.items():
        require(values, Mapping, key, "a mapping by name")
        if (other := next((name for name in values if name not in allowed[key]), None)) is not None:
            names = ", ".join(allowed[key]) or "none"
            raise ModelError(f"{key}: got {short(other)}; allowed: {names}", key)
    for name, motion in given.get("motions", {}).items():
        require(motion, Callable, f"motions: {name}", "a function that gives a BaseState")


def body_inputs(
    world: BodyWorld, times: Array, wrenches: Mapping[str, Input], driven: Mapping[str, Base], rows: BodyRows
) -> Array:
    """Wrenches of bodies, or twists of those that are driven, over each step, (n_t, n_b, 6)."""
    inputs = np.zeros((len(times), len(world.bodies), 6))
    steps = np.diff(times)
    for b, name in enumerate(world.bodies):
        if name in wrenches:
            values = wrenches[name]
            key = f"wrenches: {name}"
            if callable(values):
                middles = times[:-1] + 0.5 * steps
                found = [shaped(values(float(t)), (6,), key, name) for t in middles]
                inputs[:-1, b] = np.reshape(found, (len(middles), 6))
            else:
                inputs[:, b] = shaped(values, (6,), key, name)
            finite(inputs[:, b].ravel(), key)
        elif name in driven:
            states = [driven[name](float(t)) for t in times]
            for state in states:
                require(state, BaseState, f"motions: {name}", "a function that gives a BaseState")
                Q = shaped(state.rotation, (3, 3), f"motions: {name}", name)
                if not np.abs(Q.T @ Q - np.eye(3)).max() < 1e-9 or not np.linalg.det(Q) > 0.0:
                    raise ModelError(
                        f"motions: {name}: got {short(Q.tolist())}; allowed: a rotation", "motions"
                    )
            place = [
                rows.place[0, b] + shaped(one.displacement, (3,), f"motions: {name}", name) for one in states
            ]
            turn = [shaped(one.rotation, (3, 3), f"motions: {name}", name) for one in states]
            rows.place[0, b], rows.rotation[0, b] = place[0], turn[0] @ rows.rotation[0, b]
            for k, h in enumerate(steps):
                inputs[k, b, :3] = rotation_log(turn[k + 1] @ turn[k].T) / h
                inputs[k, b, 3:] = (place[k + 1] - place[k]) / h
            finite(inputs[:, b].ravel(), f"motions: {name}")
            rows.twist[0, b] = inputs[0, b]
    return inputs


def run_rows(
    world: BodyWorld,
    built: WorldBoxes,
    given: tuple[Array, Array, Array, Array],
    states: tuple[Array, Array, Array],
    bodies: BodyRows,
    goes_on: bool = False,
) -> WorldResult:
    """Fill rows from their first ones, with more room for contacts where it ends.

    Parameters
    ----------
    world, built : BodyWorld, WorldBoxes
    given, states, bodies : tuple, tuple, BodyRows
        As `world_run` takes them, without the least gap.
    goes_on : bool
        Whether the first rows are the last ones of another run with these boxes: they may overlap.

    Raises
    ------
    ModelError
        If surfaces overlap at the start of a run that does not go on.
    """
    times, pressure, inputs, radius = given
    least, room = (-np.inf, len(times) * MOST_CONTACTS) if goes_on else (_TOUCHING, _ROOM)
    contact, behind = np.zeros((room, CONTACT_WIDTH)), np.zeros(len(times), dtype=np.int64)
    blame = np.zeros(3)
    first = 0
    while True:
        part = slice(first, None)
        rows = (states[0][part], states[1][part], states[2][part])
        run = (times[part], pressure[part], inputs[part], radius, least if first == 0 else -np.inf)
        kept = (contact, behind[part], blame)
        last, code = world_run(built.boxes, run, rows, BodyRows(*(one[part] for one in bodies)), kept)
        first += last
        if code != FULL:
            break
        contact = np.concatenate((contact, np.zeros_like(contact)))
    if code == OVERLAP:
        names = world.side_names(sorted(blame[:2]), built.piece_of)
        text = f"{names[0]} and {names[1]} overlap at the start by {-1e3 * blame[2]:.4g} mm"
        raise ModelError(f"{text}; allowed are surfaces that do not", names[0])
    status = _describe(code, world, built, (times[first], states[0][first]), blame)
    return _result(world, built, (times[: first + 1], *states), bodies, (contact, behind), status)


def _describe(
    code: int, world: BodyWorld, built: WorldBoxes, at: tuple[float, Array], blame: Array
) -> Status:
    t, q = at
    when = f"failed at t = {t:.6g} s:"
    if code == GOOD:
        return OK
    if code == DEEP:
        one, other = world.side_names(sorted(blame[:2]), built.piece_of)
        return Status(
            f"{when} {one} and {other} have sunk {-1e3 * blame[2]:.4g} mm into each other, through the"
            " thinner one; use a smaller dt, or a larger stiffness"
        )
    if code in (AWAY, TURNING):
        name = world.side_names(blame[:1], built.piece_of)[0]
        if code == TURNING:
            return Status(f"{when} {name} turns too fast; use a smaller dt")
        return Status(f"{when} {name} has left the world, beyond its reach of {world.reach:g} m; hold it")
    if code == CROWDED:
        return Status(
            f"{when} more than {MOST_CONTACTS} contacts at a time; use fewer bodies or points_per_link"
        )
    if code == SLIDING:
        return Status(f"{when} the impulses at the contacts did not converge; use a smaller dt or stiffness")
    if built.arms and q.size:
        i = int(built.failed[0])
        status = describe_at(code, built.arms[i], q[built.first_q[i] : built.first_q[i + 1]])
        return Status(status.replace("failed:", f"{when} arm {list(world.arms)[i]}:"))
    return Status(f"{when} a wrench or a pressure is not finite")


def _result(
    world: BodyWorld,
    built: WorldBoxes,
    states: tuple[Array, Array, Array, Array],
    rows: BodyRows,
    contacts: tuple[Array, Integers],
    status: Status,
) -> WorldResult:
    """Sort the rows by name; `states`: times, which end the run, and rows q, v, z of all arms."""
    times, q, v, z = states
    n = len(times)
    contact, behind = contacts
    contact = contact[: behind[n - 1]]
    sides = contact[:, [SIDE_A, SIDE_B]].astype(np.int64)
    arm_of = np.repeat(np.arange(len(built.arms)), [built.piece_of.count(name) for name in world.arms])
    for column in sides.T:
        is_arm = column < 0
        column[is_arm] = -1 - arm_of[-1 - column[is_arm]]

    def by_arm(values: Array, first: Integers) -> dict[str, Array]:
        return {name: values[:n, first[i] : first[i + 1]] for i, name in enumerate(world.arms)}

    def by_body(values: Array) -> dict[str, Array]:
        return {name: values[:n, b] for b, name in enumerate(world.bodies)}

    return WorldResult(
        t=times,
        place=by_body(rows.place),
        rotation={name: one @ world.bodies[name].axes.T for name, one in by_body(rows.rotation).items()},
        twist=by_body(rows.twist),
        angle={
            name: one for name, one in by_body(rows.joint).items() if world.bodies[name].hinge is not None
        },
        q=by_arm(q, built.first_q),
        qd=by_arm(v, built.first_q),
        internal=by_arm(z, built.first_z),
        contacts=ContactRows(
            behind[:n],
            sides,
            contact[:, WHERE : WHERE + 3],
            contact[:, NORMAL : NORMAL + 3],
            contact[:, FORCE : FORCE + 3],
            contact[:, GAP],
        ),
        status=status,
        world=world,
    )
