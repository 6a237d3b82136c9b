"""What a fit compares: whole runs, and states at rest, with the coordinates of an arm at their samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import eigh

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.integrate import simulate
from soro_core.model import SoftArm
from soro_core.model.equilibrium.rest_forces import RestForces
from soro_core.model.equilibrium.statics import equilibrium
from soro_lab.identification.arm.cases.initial_conditions import at_start
from soro_lab.identification.recording.recording import Recording
from soro_lab.identification.recording.streams import Shape

Interval: TypeAlias = tuple[float, float]
ALWAYS: tuple[Interval, ...] = ((-np.inf, np.inf),)

# The stepper with the least error at long steps for its time (`python -m benchmarks --only sixlink`).
_STEPPER = "tr_bdf2_linear"


@dataclass(frozen=True)
class ArmMotion:
    """Motion of an arm.

    Attributes
    ----------
    t : (n,)
        Times [s]; of states at rest their numbers.
    q, qd : (n, n_q)
        Coordinates and their rates.
    """

    t: Array
    q: Array
    qd: Array

    def at(self, t: Array) -> Array:
        """Return the coordinates (len(t), n_q) at times [s], those of the ends before and after."""
        return np.asarray(CubicHermiteSpline(self.t, self.q, self.qd)(np.clip(t, self.t[0], self.t[-1])))


class Case(Protocol):
    """Measured streams, and the coordinates that an arm has at their samples."""

    @property
    def name(self) -> str:
        """Name of the case, for messages and reports."""
        ...

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """What was seen, without what is not compared."""
        ...

    @property
    def block_s(self) -> float:
        """Length [s] of what counts as one witness."""
        ...

    def simulated(self, arm: SoftArm, values: Mapping[str, float]) -> ArmMotion:
        """Return the motion of an arm.

        Parameters
        ----------
        arm : SoftArm
        values : mapping of str to float
            Numbers by name; those of a release (`initial_conditions`) are used.

        Raises
        ------
        ModelError
            If the arm has none there: no balance, or a simulation that fails.
        """
        ...

    def coordinates(self, path: ArmMotion, frames: Mapping[str, float]) -> list[Array]:
        """Return the coordinates (n, n_q) at the samples of each shape.

        Parameters
        ----------
        path : ArmMotion
            Of `simulated`.
        frames : mapping of str to float
            Numbers of the measurement by name (`clock`).
        """
        ...


def clock(name: str) -> str:
    """Return the name of the number by which the stamps of the shape of a run are late [s]."""
    return f"frame/{name}/clock"


@dataclass(frozen=True)
class Whole:
    """A run, simulated under its measured pressures from the balance of the first.

    Attributes
    ----------
    recording : Recording
    dt : float
        Step of the simulation [s].
    judged : tuple of (start, end)
        Times [s] that are compared; the simulation covers all before them too.
    rate_hz : float
        Largest number of samples a second that are compared.
    block_s : float
        Length [s] of what counts as one witness.
    """

    recording: Recording
    dt: float = 0.005
    judged: tuple[Interval, ...] = ALWAYS
    rate_hz: float = 50.0
    block_s: float = 1.0

    @property
    def name(self) -> str:
        """Name of the run."""
        return self.recording.name

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Samples within the intervals, thinned."""
        first, last = self.recording.span
        return tuple(
            s.rows(_within(s.t, self.judged) & _within(s.t, ((first, last),)) & _thinned(s.t, self.rate_hz))
            for s in self.recording.shapes
        )

    def simulated(self, arm: SoftArm, values: Mapping[str, float]) -> ArmMotion:
        """Return the motion from rest, or from where a release begins."""
        times, table = self._pressures
        if self.recording.load_kg:
            robot = arm.robot.replace(tip_mass=arm.robot.tip_mass + self.recording.load_kg)
            arm = SoftArm(robot, nodes=arm.nodes)
        push = held_push(arm, self.recording.push_n)
        q0, internal = at_start(arm, self.name, equilibrium(arm, table[0, 0], wrench=push), values)
        result = simulate(
            arm,
            q0,
            t_end=(len(times) - 1) * self.dt,
            dt=self.dt,
            integrator=_STEPPER,
            pressure=table,
            internal0=internal,
            wrench=None if push is None else lambda _, state: push(state.q),
        )
        q, qd = np.asarray(result.q, float), np.asarray(result.qd, float)
        if len(q) != len(times) or not np.isfinite(q).all():
            raise ModelError(
                f"{self.name} failed after {result.t[-1]:.3g} s: {result.status.message}", self.name
            )
        return ArmMotion(times, q, qd)

    def coordinates(self, path: ArmMotion, frames: Mapping[str, float]) -> list[Array]:
        """Return the coordinates when the samples were taken: before their stamps by what these are late."""
        late = frames.get(clock(self.name), 0.0)
        return [path.at(s.t - late) for s in self.shapes]

    @cached_property
    def _pressures(self) -> tuple[Array, Array]:
        """Times of the steps, and pressures (n, 3, n_u) at the start, the middle and the end of each."""
        begin = float(self.recording.pressure.t[0])
        end = max((float(s.t[-1]) for s in self.shapes if s.t.size), default=begin)
        steps = max(1, int(np.ceil((end - begin) / self.dt - 1e-9)))
        times: Array = begin + self.dt * np.arange(steps + 1, dtype=np.float64)
        at = self.recording.pressure.at
        start, middle = at(times), at(times + 0.5 * self.dt)
        return times, np.stack([start, middle, np.vstack([start[1:], start[-1:]])], axis=1)


@dataclass(frozen=True)
class Rests:
    """States at rest.

    Attributes
    ----------
    name : str
    pressure : (n, n_u)
        Of each state [Pa gauge].
    shapes : tuple of Shape
        What was seen; sample k belongs to state `t[k]`.
    load_kg : tuple of float
        Known mass at the tip in each state, beside that of the robot [kg]; () where there is none.
    push_n : tuple of tuple of float
        Known force on the tip in each state, in the world [N]; () where there is none.
    """

    name: str
    pressure: Array
    shapes: tuple[Shape, ...]
    load_kg: tuple[float, ...] = ()
    push_n: tuple[tuple[float, float, float], ...] = ()
    block_s: float = field(default=1.0, init=False)

    def simulated(self, arm: SoftArm, values: Mapping[str, float]) -> ArmMotion:
        """Return the balances, each search started at the nearest state that was found."""
        q = np.zeros((len(self.pressure), arm.n_q))
        loads = self.load_kg or (0.0,) * len(q)
        pushes = self.push_n or ((0.0, 0.0, 0.0),) * len(q)
        for k, (p, load, push) in enumerate(zip(self.pressure, loads, pushes, strict=True)):
            alike = [j for j in range(k) if pushes[j] == push]  # another push is too far a way
            near = min(alike, key=lambda j: float(np.linalg.norm(self.pressure[j] - p)), default=None)
            begin = None if near is None else q[near]
            q[k] = equilibrium(arm, p, begin, load, wrench=held_push(arm, push))
        return ArmMotion(np.arange(len(q), dtype=np.float64), q, np.zeros_like(q))

    def coordinates(self, path: ArmMotion, frames: Mapping[str, float]) -> list[Array]:
        """Return the balance at each sample."""
        return [path.q[s.t.astype(int)] for s in self.shapes]


def held_push(arm: SoftArm, push_n: Sequence[float]) -> Callable[[Array], Array] | None:
    """Return the wrench of a force on the tip that is held in the world, as a function of q; None for none.

    Parameters
    ----------
    arm : SoftArm
    push_n : sequence of float
        In the world [N].
    """
    if not any(push_n):
        return None
    return lambda q: np.append(np.zeros(3), push_n @ arm.pose(q, arm.length)[:3, :3])


def _within(t: Array, intervals: Sequence[Interval]) -> NDArray[np.bool_]:
    inside = [(t >= start) & (t <= end) for start, end in intervals]
    return np.any(inside, axis=0) if inside else np.zeros(len(t), bool)


def _thinned(t: Array, rate_hz: float) -> NDArray[np.bool_]:
    """Whether a sample is the first of its interval."""
    keep = np.zeros(len(t), bool)
    if len(t):
        keep[np.unique(np.floor((t - t[0]) * rate_hz + 1e-6), return_index=True)[1]] = True
    return keep


# No step is longer: pressures of regulators change within some 50 ms.
LONGEST_S = 0.01


def longest_step(arm: SoftArm, turn: float) -> float:
    """Return a step [s] in which the slowest swing of an arm at rest turns by at most `turn` [rad].

    The stepper of `Whole` makes a swing slower by 0.04 `turn`^2 of its frequency.

    Raises
    ------
    ModelError
        If the arm has no rest without pressure.
    """
    none = np.zeros(arm.n_u)
    rest = equilibrium(arm, none)
    stiffness = RestForces(arm, none, 0.0).stiffness(rest)
    square = float(eigh(0.5 * (stiffness + stiffness.T), arm.inertia_matrix(rest), eigvals_only=True)[0])
    return min(LONGEST_S, turn / np.sqrt(square)) if square > 0.0 else LONGEST_S
