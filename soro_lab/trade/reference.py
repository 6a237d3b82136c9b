"""The reference run for all errors, refined in space and time until it converges."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from soro_core.errors import ConfigError, ModelError
from soro_core.integrate import STEPPERS
from soro_core.model import SoftArm
from soro_core.model.discretised import discretised
from soro_core.robot import Discretisation, Robot
from soro_lab.trade.candidate import Candidate
from soro_lab.trade.case import SAMPLE_S, TradeCase
from soro_lab.trade.trace import Errors, TradeTrace, errors, trace

# The second stepper is for runs in which Newton's iteration of the first fails.
_STEPPERS = ("trapezoidal", "rk4")
_HALVINGS = 7
_FIRST_DT_S = 1e-3
# CPU time after which no further refinement starts [s].
_PATIENCE_S = 120.0


@dataclass(frozen=True)
class ReferenceRun:
    """A converged run.

    Attributes
    ----------
    candidate : Candidate
        Discretisation, stepper and step.
    trace : TradeTrace
        The run.
    own : Errors
        Estimate of its own errors, from the last two refinements in space and in time.
    asked : float
        Tolerance of the tip's own error, % of the length.
    note : str
        What prevented further refinement; "" for nothing.
    unknown : str
        Why the error of the shape functions is unknown and not part of `own`; "" if it is known.
    """

    candidate: Candidate
    trace: TradeTrace
    own: Errors
    asked: float
    note: str
    unknown: str = ""

    @property
    def converged(self) -> bool:
        """Whether the known own error of the tip is within the tolerance."""
        return self.own.tip <= self.asked

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for a cache."""
        run = {**vars(self.trace), "places": self.trace.places.tolist(), "energy": self.trace.energy.tolist()}
        candidate = {**vars(self.candidate), "model": self.candidate.model.model_dump(mode="json")}
        return {**vars(self), "candidate": candidate, "trace": run, "own": vars(self.own)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ReferenceRun:
        """Return the reference from the values of `as_dict`."""
        candidate, run = data["candidate"], data["trace"]
        candidate = {**candidate, "model": Discretisation.model_validate(candidate["model"])}
        run = {**run, "places": np.array(run["places"]), "energy": np.array(run["energy"])}
        own = Errors(**data["own"])
        parts = {"candidate": Candidate(**candidate), "trace": TradeTrace(**run), "own": own}
        return cls(**{**data, **parts})


def spaces(robot: Robot) -> tuple[list[Discretisation], str, str]:
    """Return discretisations from coarse to fine, why better ones fail, and why these do not converge.

    Quadratic Legendre polynomials on 1, 2, 4, ... pieces; constant strain on pieces, if a link does not allow
    polynomials; more quadrature nodes only, if it cannot be split either. The last ones do not converge to
    the continuum, so the error of the shape functions is unknown.
    """
    polynomial = [Discretisation(basis="legendre", order=2, links=k) for k in (1, 2, 4, 8)]
    constant = [Discretisation(links=k) for k in (2, 4, 8, 16, 32)]
    note = ""
    for levels in (polynomial, constant):
        try:
            levels[1].discretise(robot)
        except ConfigError as error:
            note = str(error)
        else:
            return levels, note, ""
    modes = not all(link.splits for link in robot.links)
    unknown = f"{'POD basis' if modes else 'basis of the robot file'} is not refined"
    return [Discretisation(nodes=n) for n in (8, 16, 32)], note, unknown


def converge(
    case: TradeCase,
    tolerance: float,
    say: Callable[[str], None] = lambda text: None,
    stop: Callable[[], bool] = lambda: False,
) -> ReferenceRun:
    """Refine until successive refinements move the tip by less than `tolerance` (RMS, % of the length).

    Parameters
    ----------
    case : TradeCase
        Run.
    tolerance : float
        Tolerance of the tip, % of the length; the error of the time step may be a quarter of it.
    say : callable
        Called with a text on progress.
    stop : callable
        Function that returns whether to stop refining.

    Raises
    ------
    ModelError
        If fewer than two refinements can be computed.
    """
    deadline = time.process_time() + _PATIENCE_S

    def enough() -> bool:
        return stop() or time.process_time() > deadline

    levels, note, unknown = spaces(case.robot)
    found: list[tuple[Candidate, TradeTrace, Errors]] = []
    best: ReferenceRun | None = None
    dt_s = _FIRST_DT_S
    for model in levels:
        try:
            arm = discretised(case.robot, model)
            step = _in_time(case, arm, model, dt_s, 0.25 * tolerance, say, enough)
        except ModelError as error:
            if best is None and model is levels[-1]:
                raise
            note = str(error)
            continue
        found.append(step)
        candidate, run, own = step
        dt_s = candidate.dt_s * 2  # the finer of two that agree; the next level halves it again
        for (_, before, _), (_, after, _) in pairwise(found[-2:]):
            moved = errors(before, after, case.robot.length)
            total = _sum(moved, own)
            best = ReferenceRun(candidate, run, total, tolerance, note, unknown)
        if best is not None and best.converged:
            return best
        if enough():
            break
    if best is not None:
        return best
    if not found:
        raise ModelError(f"{case.robot.name}: no refinement can be computed: {note}")
    raise ModelError(f"{case.robot.name}: only one refinement can be computed, so its error is unknown")


def _in_time(
    case: TradeCase,
    arm: SoftArm,
    model: Discretisation,
    dt_s: float,
    tolerance: float,
    say: Callable[[str], None],
    enough: Callable[[], bool],
) -> tuple[Candidate, TradeTrace, Errors]:
    """Halve the step until two runs agree; return the finer one and their difference."""
    failure = "no stepper"
    for integrator in _STEPPERS:
        if integrator not in STEPPERS:
            continue
        before: TradeTrace | None = None
        last: tuple[Candidate, TradeTrace, Errors] | None = None
        for dt in halvings(dt_s):
            candidate = Candidate(model, integrator, dt)
            say(f"reference: {candidate}")
            try:
                run = trace(case, arm, integrator, dt)
            except ModelError as error:
                failure, before = str(error), None
                continue
            if before is not None:
                last = candidate, run, errors(before, run, case.robot.length)
                if last[2].tip <= tolerance or enough():
                    return last
            before = run
        if last is not None:
            return last
    raise ModelError(failure)


def halvings(dt_s: float) -> Iterator[float]:
    """Yield steps [s] from `dt_s` on, each half of the last, all whole fractions of the sampling period."""
    parts = max(1, round(SAMPLE_S / dt_s))
    for k in range(_HALVINGS):
        yield SAMPLE_S / (parts * 2**k)


def _sum(one: Errors, other: Errors) -> Errors:
    frequency = one.frequency  # independent of time steps
    return Errors(one.tip + other.tip, one.shape + other.shape, one.energy + other.energy, frequency)
