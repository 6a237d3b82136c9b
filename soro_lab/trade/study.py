"""The study: reference, coarse pass, second pass around its front, costs, and slow measures."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, replace
from functools import partial
from typing import Any

from soro_core.errors import ModelError, SoroError
from soro_core.integrate import STEPPERS
from soro_core.jobs import Executor, map_jobs
from soro_lab.scene import Requirement
from soro_lab.trade import cache as keys
from soro_lab.trade.cache import Cache
from soro_lab.trade.candidate import Candidate
from soro_lab.trade.case import TradeCase
from soro_lab.trade.cost import Cost, measure, warm
from soro_lab.trade.grid import CandidateGrid, around, coarse, size, spaces, within
from soro_lab.trade.outcome import Outcome, compute
from soro_lab.trade.reference import ReferenceRun, converge
from soro_lab.trade.results import CandidateResult, Study, near_front, pareto
from soro_lab.trade.slow_metrics import LoopError, closed_loop, loop_seconds, measured_error
from soro_lab.trade.trace import Errors

# Tolerance of the reference's tip, % of the length: a twentieth of the requirement, within these.
FINEST, COARSEST = 2e-3, 5e-2
NEAR = 1.5  # factor in error and cost, see `near_front`
Progress = Callable[[str, int, int], None]


class Stopped(Exception):  # noqa: N818 -- no error: the user asks for it
    """The user stopped the study before it had a result."""


def run_study(
    case: TradeCase,
    grid: CandidateGrid,
    requirement: Requirement,
    executor: Executor,
    cache: Cache | None = None,
    repeats: int = 3,
    progress: Progress = lambda text, done, total: None,
    stop: Callable[[], bool] = lambda: False,
) -> Study:
    """Measure the trade.

    Parameters
    ----------
    case : TradeCase
    grid : CandidateGrid
        Values to combine.
    requirement : Requirement
        Required error or time.
    executor : Executor
        Computes the errors; this process measures times afterwards, one after the other.
    cache : Cache, optional
        Where results are stored; nowhere by default.
    repeats : int
        Repeats of each time.
    progress : callable
        Called with (text, done, total).
    stop : callable
        Function that returns whether to stop, called between candidates; the results so far are returned,
        marked as stopped.

    Raises
    ------
    Stopped
        If `stop` returns True before the reference is computed.
    ModelError
        If the reference cannot be computed.
    """
    return _Run(case, grid, requirement, executor, cache, repeats, progress, stop).study()


class _Run:
    """One study in progress."""

    def __init__(
        self,
        case: TradeCase,
        grid: CandidateGrid,
        requirement: Requirement,
        executor: Executor,
        cache: Cache | None,
        repeats: int,
        progress: Progress,
        stop: Callable[[], bool],
    ) -> None:
        self.case, self.requirement, self.executor = case, requirement, executor
        self.grid = within(grid, case.longest_step_s)
        self.cache, self.repeats, self.progress, self.stop = cache, repeats, progress, stop
        self.key = keys.case_key(case)
        self.rows: dict[Candidate, CandidateResult] = {}

    def study(self) -> Study:
        required = self.requirement.error_percent / 20 if self.requirement.error else math.inf
        tolerance = min(max(required, FINEST), COARSEST)
        self.progress("reference", 0, 0)
        self.reference = self._reference(tolerance)
        if self.stop():
            raise Stopped
        steppers = sorted(STEPPERS)
        found, refused = spaces(self.grid, self.case.robot)
        first = coarse(self.grid, found, steppers)
        self._errors(first, "coarse grid")
        self._costs("coarse grid")
        near = near_front(self._complete(), lambda r: r.price(self.requirement), lambda r: r.tip, NEAR)
        self._errors(around(self.grid, (row.candidate for row in near), self.rows), "around the front")
        self._costs("around the front")
        if not self.stop():
            self._late()
        combinations = size(self.grid, len(found), len(steppers))
        rows = tuple(sorted(self.rows.values(), key=lambda row: (row.cpu, row.tip)))
        return Study(
            self.case, self.requirement, self.reference, rows, combinations, refused, stopped=self.stop()
        )

    def _reference(self, tolerance: float) -> ReferenceRun:
        key = keys.reference_key(self.key)
        stored = self._cached(key)
        known = None if stored is None else ReferenceRun.from_dict(stored)
        # Also if an earlier study asked for a smaller tolerance and did not reach it.
        if known is not None and min(known.own.tip, known.asked) <= tolerance:
            return replace(known, asked=tolerance)
        try:
            found = converge(self.case, tolerance, lambda text: self.progress(text, 0, 0), self.stop)
        except ModelError:
            if self.stop():
                raise Stopped from None
            raise
        if known is not None and known.own.tip <= found.own.tip:
            found = replace(known, asked=tolerance)
        if not self.stop():
            self._keep(key, found.as_dict())
        return found

    def _complete(self) -> list[CandidateResult]:
        return [row for row in self.rows.values() if row.complete]

    def _errors(self, candidates: list[Candidate], text: str) -> None:
        truth = self.reference
        reference = f"{truth.candidate.section}"
        unknown = []
        for candidate in candidates:
            known = self._cached(keys.error_key(self.key, reference, candidate))
            if known is None:
                unknown.append(candidate)
            else:
                errors = None if known["errors"] is None else Errors(**known["errors"])
                self.rows[candidate] = CandidateResult(candidate, errors, known["failure"])
        total, done = len(candidates), len(candidates) - len(unknown)
        self.progress(f"errors, {text}", done, total)
        if not unknown or self.stop():
            return
        for candidate in _one_a_kind(unknown):
            self.progress(f"kernels of {candidate.model.method}, {candidate.integrator}", done, total)
            with contextlib.suppress(SoroError):  # the same failure is reported when the errors are computed
                warm(self.case, candidate)
        job = partial(compute, self.case, truth.trace)
        for outcome in map_jobs(job, unknown, self.executor, in_order=False, stop=self.stop):
            done += 1
            self.progress(f"errors, {text}", done, total)
            self._note(outcome, reference)

    def _note(self, outcome: Outcome, reference: str) -> None:
        self.rows[outcome.candidate] = CandidateResult(outcome.candidate, outcome.errors, outcome.failure)
        value = {"errors": outcome.errors and asdict(outcome.errors), "failure": outcome.failure}
        self._keep(keys.error_key(self.key, reference, outcome.candidate), value)

    def _costs(self, text: str) -> None:
        missing = [row for row in self.rows.values() if row.errors is not None and row.cost is None]
        for done, row in enumerate(missing):
            if self.stop():
                return
            self.progress(f"times, {text}", done, len(missing))
            key = keys.cost_key(self.case, row.candidate, self.repeats)
            known = self._cached(key)
            cost = Cost(**known) if known else measure(self.case, row.candidate, self.repeats)
            if known is None:
                self._keep(key, asdict(cost))
            self.rows[row.candidate] = replace(row, cost=cost)
        self.progress(f"times, {text}", len(missing), len(missing))

    def _late(self) -> None:
        """Run closed loop and measured run for rows on the front or near it."""
        near = near_front(self._complete(), lambda r: r.price(self.requirement), lambda r: r.tip, NEAR)
        front = pareto(near, lambda r: r.price(self.requirement), lambda r: r.tip)
        scene = self.case.scene
        models = list(dict.fromkeys(row.candidate.model for row in near))[: self.grid.loops]
        loops = models if scene is not None and self.case.robot.n_u else []
        measured = front if self.case.measured is not None else []
        total = len(loops) + len(measured)
        for done, model in enumerate(loops):
            if self.stop():
                return
            assert scene is not None
            self.progress(f"closed loop, {loop_seconds(scene):g} s each", done, total)
            result = self._loop(model)
            for candidate, row in self.rows.items():
                if candidate.model == model:
                    self.rows[candidate] = replace(row, loop=result)
        for done, row in enumerate(measured, len(loops)):
            if self.stop():
                return
            self.progress("measured run", done, total)
            found = measured_error(self.case, row.candidate)
            self.rows[row.candidate] = replace(self.rows[row.candidate], measured_per_m=found)
        self.progress("done", max(total, 1), max(total, 1))

    def _loop(self, model: Any) -> LoopError:
        scene = self.case.scene
        assert scene is not None
        truth = self.reference.candidate
        key = keys.loop_key(scene, robot=self.key, model=model.model_dump(mode="json"), truth=truth.section)
        known = self._cached(key)
        if known is not None:
            return LoopError(**known)
        result = closed_loop(scene, model, truth)
        self._keep(key, asdict(result))
        return result

    def _cached(self, key: str) -> dict[str, Any] | None:
        return None if self.cache is None else self.cache.get(key)

    def _keep(self, key: str, value: dict[str, Any]) -> None:
        if self.cache is not None:
            self.cache.put(key, value)


def _one_a_kind(candidates: Iterable[Candidate]) -> list[Candidate]:
    """One candidate for each set of kernels."""
    return list({(c.model.method, c.integrator): c for c in candidates}.values())
