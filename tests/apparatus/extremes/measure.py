"""Runs of the table of extremes on the arm alone, and what is physical about them."""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from soro_core import SoftArm, simulate
from soro_core.arrays import Array
from soro_core.integrate import Result
from soro_core.integrate.stepper import DISSIPATIVE
from tests.apparatus.extremes.arms import FULL_SCALE_PA, Arm, least_stretch
from tests.apparatus.extremes.cell import Outcome, Verdict, stopped

DEFAULT: str = inspect.signature(simulate).parameters["integrator"].default
# Energy that a run may gain, of what it has to give: the default stepper swings about the truth.
SWING = 0.1
# The same from any row to a later one where the stepper dissipates: round-off.
GROWTH = 1e-12
# Residual of the equation of motion, and of equilibrium, of its largest term.
RESIDUAL = 1e-7
BALANCE = 1e-3
LOOKS = 400


@dataclass(frozen=True)
class Release:
    """A release from a bent or stretched state at rest, under constant pressures of no slope."""

    arm: Arm
    turns: float = 0.0
    """Angle of each link over 2 pi."""
    curvature: float = 0.0
    """[1/m], added to it."""
    elongation: float = 0.0
    pressure: float = 0.0
    """Of full scale, in the first chamber of each link, from the first instant on."""
    dt: float = 1e-3
    steps: int = 200
    integrator: str = DEFAULT
    settles: bool = False
    """Whether it has to be at rest at the end."""

    def __call__(self) -> Verdict:
        """Run and judge."""
        arm, result, p = self.simulate()
        return judge(arm, result, p, self.settles, self.integrator in DISSIPATIVE)

    def start(self) -> tuple[SoftArm, Array, Array]:
        """Arm, coordinates and pressures that it starts with."""
        robot = self.arm.robot()
        arm = SoftArm(robot)
        curvature = 2.0 * math.pi * self.turns / self.arm.length + self.curvature
        p = np.zeros(arm.n_u)
        p[::3] = self.pressure * FULL_SCALE_PA
        return arm, self.arm.coordinates(robot, curvature, self.elongation), p

    def simulate(self) -> tuple[SoftArm, Result, Array]:
        """Run."""
        arm, q0, p = self.start()
        t_end = self.steps * self.dt
        return arm, simulate(arm, q0, t_end=t_end, dt=self.dt, integrator=self.integrator, pressure=p), p


def judge(arm: SoftArm, result: Result, p: Array, settles: bool = False, dissipates: bool = False) -> Verdict:
    """Verdict on a run under constant pressures; where the stepper `dissipates`, energy must never grow."""
    if not (
        np.isfinite(result.q).all() and np.isfinite(result.qd).all() and np.isfinite(result.internal).all()
    ):
        return Verdict(Outcome.NONSENSE, "not finite")
    stretch = least_stretch(arm, result.q)
    if stretch <= 0.0:
        return Verdict(Outcome.NONSENSE, f"elongation {stretch - 1:.3g}")
    gain = energy_gain(arm, result, p, dissipates)
    if gain > (GROWTH if dissipates else SWING):
        return Verdict(Outcome.NONSENSE, f"gained {gain:.1e} of its energy; {result.status.message}")
    if not result.status.ok:
        return stopped(result.status)
    if settles:
        off = imbalance(arm, result.q[-1], p)
        if off > BALANCE:
            return Verdict(Outcome.NONSENSE, f"at rest {off:.1e} out of balance")
    return Verdict(Outcome.FINISHED, f"gained {gain:.0e}")


def energy_gain(arm: SoftArm, result: Result, p: Array, anywhere: bool = False) -> float:
    """Most that the energy rose above its start, or `anywhere` above an earlier row.

    Over what the arm can give; constant pressures have -p V.
    """
    rows = np.unique(np.linspace(0, len(result.t) - 1, LOOKS).astype(int))
    energies = np.array([energy(arm, result, k, p) for k in rows])
    work = float(np.abs(p) @ np.ptp([arm.displaced_volume(result.q[k]) for k in rows], axis=0))
    before = np.minimum.accumulate(energies) if anywhere else energies[0]
    return float((energies - before).max()) / (scale_of(arm, result) + work)


def scale_of(arm: SoftArm, result: Result) -> float:
    """What the arm can give [J]: its energy at the start, and the weight falling by two lengths."""
    mass = sum(link.mass for link in arm.robot.links) + arm.robot.tip_mass
    kinetic, _, elastic = arm.energy(result.q[0], result.qd[0])
    return kinetic + elastic + 2.0 * mass * float(np.linalg.norm(arm.robot.gravity)) * arm.length


def energy(arm: SoftArm, result: Result, k: int, p: Array) -> float:
    """Energy of row k [J]: of the arm, its internal states and the constant pressures."""
    t = arm.tables
    internal = 0.5 * float(t.internal_stiffness @ result.internal[k] ** 2)
    return (
        sum(arm.energy(result.q[k], result.qd[k])) + internal - float(p @ arm.displaced_volume(result.q[k]))
    )


def imbalance(arm: SoftArm, q: Array, p: Array) -> float:
    """Unbalanced force at rest, over the largest that balance or the weight, by kind of coordinate.

    The weight acts on an elongation with the length of a link as its arm, on a curvature with its square.
    """
    link = arm.robot.links[0].length
    weight = arm.robot.tip_mass + sum(one.mass for one in arm.robot.links)
    weight *= float(np.linalg.norm(arm.robot.gravity))
    terms = np.array([arm.gravity_force(q), arm.elastic_force(q), -arm.actuation_matrix(q) @ p])
    bends = np.array(["bending" in name for name in arm.robot.coordinate_names])
    worst = 0.0
    for kind, least in ((bends, weight * link**2), (~bends, weight * link)):
        worst = max(worst, _over(terms.sum(axis=0)[kind], terms[:, kind], least))
    return worst


@dataclass(frozen=True)
class Acceleration:
    """Forward dynamics alone, at a bent, stretched, moving state: the equation of motion holds."""

    arm: Arm
    method: str
    turns: float = 0.0
    curvature: float = 0.0
    elongation: float = 0.0
    options: dict[str, Any] = field(default_factory=dict)

    def __call__(self) -> Verdict:
        """Evaluate and judge."""
        robot = self.arm.robot()
        arm = SoftArm(robot, method=self.method, **self.options)
        curvature = 2.0 * math.pi * self.turns / self.arm.length + self.curvature
        q = self.arm.coordinates(robot, curvature, self.elongation)
        qd = self.arm.coordinates(robot, 20.0, -0.3)
        p = np.full(arm.n_u, 0.3 * FULL_SCALE_PA)
        qdd = arm.forward_dynamics(q, qd, p)
        terms = np.array(
            [
                arm.inertia_matrix(q) @ qdd,
                arm.coriolis_force(q, qd),
                arm.gravity_force(q),
                arm.elastic_force(q),
                arm.damping_force(q, qd),
                -arm.actuation_matrix(q) @ p,
            ]
        )
        if not np.isfinite(terms).all():
            return Verdict(Outcome.NONSENSE, "not finite")
        residual = _over(terms.sum(axis=0), terms)
        good = residual <= RESIDUAL
        return Verdict(Outcome.FINISHED if good else Outcome.NONSENSE, f"residual {residual:.0e}")


@dataclass(frozen=True)
class Straight:
    """Forward dynamics and its derivative at a vanishing curvature, against those of the straight arm."""

    arm: Arm
    method: str
    curvature: float

    def __call__(self) -> Verdict:
        """Evaluate and judge."""
        robot = self.arm.robot()
        arm = SoftArm(robot, method=self.method)
        direction = self.arm.coordinates(robot, 1.0)
        qd, p = self.arm.coordinates(robot, 20.0, -0.3), np.full(arm.n_u, 0.3 * FULL_SCALE_PA)

        def at(curvature: float) -> Array:
            return arm.forward_dynamics(curvature * direction, qd, p)

        # Far enough from the series' end for a difference to be clean, near enough for the second derivative.
        h = 1e-3
        straight, slope = at(0.0), (at(h) - at(-h)) / (2.0 * h)
        here = at(self.curvature)
        value = np.abs(here - straight - self.curvature * slope).max() / np.abs(straight).max()
        there = (at(self.curvature + h) - at(self.curvature - h)) / (2.0 * h)
        change = np.abs(there - slope).max() / np.abs(slope).max()
        good = value <= 1e-11 and change <= 1e-5
        note = f"value off {value:.0e}, derivative {change:.0e}"
        return Verdict(Outcome.FINISHED if good else Outcome.NONSENSE, note)


@dataclass(frozen=True)
class Seams:
    """Forward dynamics over nine decades of curvature: no jump where a series ends."""

    arm: Arm
    method: str

    def __call__(self) -> Verdict:
        """Evaluate and judge."""
        robot = self.arm.robot()
        arm = SoftArm(robot, method=self.method)
        qd, p = self.arm.coordinates(robot, 20.0, -0.3), np.full(arm.n_u, 0.3 * FULL_SCALE_PA)

        def at(curvature: float) -> Array:
            return arm.forward_dynamics(self.arm.coordinates(robot, curvature), qd, p)

        worst, where = 0.0, 0.0
        for curvature in np.geomspace(1e-8, 10.0, 541) / self.arm.length:
            here, there = at(curvature), at(curvature * (1.0 + 1e-9))
            jump = float(np.abs(there - here).max() / np.abs(here).max())
            if jump > worst:
                worst, where = jump, curvature * self.arm.length
        good = worst <= 1e-7
        note = f"largest jump {worst:.0e} at {where:.0e} rad"
        return Verdict(Outcome.FINISHED if good else Outcome.NONSENSE, note)


@dataclass(frozen=True)
class Hours:
    """A long run under slowly swinging pressures: at its end it moves as it did at the beginning."""

    arm: Arm
    duration_s: float
    dt: float = 5e-3
    period_s: float = 2.0
    integrator: str = DEFAULT

    def __call__(self) -> Verdict:
        """Run and judge."""
        arm = SoftArm(self.arm.robot())
        phase = 2.0 * np.pi / 3.0 * np.arange(arm.n_u)

        def pressure(t: float) -> Array:
            return 0.25 * FULL_SCALE_PA * (1.0 + np.sin(2.0 * np.pi * t / self.period_s - phase))

        result = simulate(
            arm, t_end=self.duration_s, dt=self.dt, integrator=self.integrator, pressure=pressure
        )
        if not np.isfinite(result.q).all():
            return Verdict(Outcome.NONSENSE, "not finite")
        if not result.status.ok:
            return stopped(result.status)
        period = round(self.period_s / self.dt)
        # The start has died out after a few periods.
        early, late = result.q[5 * period : 6 * period], result.q[-period - 1 : -1]
        drift = float(np.abs(late - early).max() / np.abs(early).max())
        good = drift <= 1e-6
        return Verdict(Outcome.FINISHED if good else Outcome.NONSENSE, f"drifted {drift:.0e}")


@dataclass(frozen=True)
class Swing:
    """A long run without losses and input: the energy stays within a band."""

    release: Release

    def __call__(self) -> Verdict:
        """Run and judge."""
        arm, result, p = self.release.simulate()
        if not result.status.ok:
            return stopped(result.status)
        rows = np.arange(0, len(result.t), max(1, len(result.t) // 4000))
        energies = np.array([energy(arm, result, int(k), p) for k in rows])
        start = energies[: len(rows) // 10]
        rest = energies[len(rows) // 10 :]
        band = float(np.ptp(start))
        out = max(float(rest.max() - start.max()), float(start.min() - rest.min()), 0.0) / band
        good = out <= 0.5
        note = f"leaves the band of the first tenth by {100 * out:.0f} % of it"
        return Verdict(Outcome.FINISHED if good else Outcome.NONSENSE, note)


def _over(total: Array, terms: Array, least: float = 0.0) -> float:
    largest = float(np.abs(terms).max(initial=least))
    return float(np.abs(total).max(initial=0.0)) / largest if largest > 0.0 else 0.0
