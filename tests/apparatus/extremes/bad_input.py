"""Values that are not numbers, put in wherever a number goes in."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from soro_core import SoftArm, simulate
from soro_core.integrate import make_stepper
from tests.apparatus.extremes.arms import Arm
from tests.apparatus.extremes.cell import Outcome, Verdict, stopped


@dataclass(frozen=True)
class BadInput:
    """One number that is none, at one place."""

    place: str
    value: float

    def __call__(self) -> Verdict:
        """Put it in and judge."""
        return PLACES[self.place](self.value)


def _forward(key: str, value: float) -> Verdict:
    arm = SoftArm(Arm().robot())
    inputs: dict[str, Any] = {"q": np.zeros(3), "qd": np.zeros(3), "p": np.zeros(3), "wrench": np.zeros(6)}
    inputs[key][1] = value
    qdd = arm.forward_dynamics(inputs["q"], inputs["qd"], inputs["p"], wrench=inputs["wrench"])
    return Verdict(Outcome.NONSENSE, f"gave {qdd}")


def _simulate(**inputs: Any) -> Verdict:
    arm = SoftArm(Arm().robot())
    result = simulate(arm, **{"t_end": 0.1, "dt": 1e-3, **inputs})
    if not (np.isfinite(result.q).all() and np.isfinite(result.qd).all()):
        return Verdict(Outcome.NONSENSE, "not finite")
    if result.status.ok:
        return Verdict(Outcome.NONSENSE, "finished as if nothing were wrong")
    return stopped(result.status)


def _step(value: float) -> Verdict:
    arm = SoftArm(Arm().robot())
    stepper = make_stepper("trapezoidal", arm)
    before = stepper.initial_state()
    after, status = stepper.step(before, np.array([0.0, value, 0.0]), 1e-3)
    if status.ok or after is not before:
        return Verdict(Outcome.NONSENSE, f"{status}: {after}")
    return stopped(status)


def _robot(value: float) -> Verdict:
    Arm(youngs_modulus=value).robot()
    return Verdict(Outcome.NONSENSE, "accepted")


PLACES: dict[str, Callable[[float], Verdict]] = {
    "forward dynamics: q": lambda x: _forward("q", x),
    "forward dynamics: qd": lambda x: _forward("qd", x),
    "forward dynamics: pressure": lambda x: _forward("p", x),
    "forward dynamics: wrench": lambda x: _forward("wrench", x),
    "simulate: q0": lambda x: _simulate(q0=[0.0, x, 0.0]),
    "simulate: qd0": lambda x: _simulate(qd0=[0.0, x, 0.0]),
    "simulate: dt": lambda x: _simulate(dt=x),
    "simulate: t_end": lambda x: _simulate(t_end=x),
    "simulate: wrench": lambda x: _simulate(wrench=[0.0, 0.0, x, 0.0, 0.0, 0.0]),
    "simulate: pressure from 0.05 s on": lambda x: _simulate(
        pressure=lambda t: np.array([0.0, x if t >= 0.05 else 0.0, 0.0])
    ),
    "one step: pressure": _step,
    "robot: Young's modulus": _robot,
}
# Where the number is met in the run and not before it.
IN_THE_RUN = ("simulate: pressure from 0.05 s on", "one step: pressure")
BAD = (math.nan, math.inf, -math.inf)
