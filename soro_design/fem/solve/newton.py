"""Equilibrium under rising loads: Newton's method with load steps that adapt, docs/design.md (10)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from soro_core.errors import ModelError
from soro_design.fem.part import Part
from soro_design.fem.solve.arc import at_rest, limit_load
from soro_design.fem.solve.equations import LOOSE_CAUSE, Equations
from soro_design.fem.solve.equilibrium import Attempt, equilibrium
from soro_design.fem.solve.states import EquilibriumState, LoadSolution, SolverSettings
from soro_design.fem.solve.steps import LoadSteps


def solve(
    part: Part,
    loads: Sequence[float] = (1.0,),
    settings: SolverSettings | None = None,
    progress: Callable[[EquilibriumState], None] | None = None,
) -> LoadSolution:
    """Follow the part from its undeformed state through rising load factors.

    Parameters
    ----------
    part : Part
    loads : sequence of float
        Load factors to stop at, rising from above 0.
    settings : SolverSettings, optional
        How loads rise.
    progress : callable, optional
        Called with every state in equilibrium.

    Returns
    -------
    LoadSolution
        With a status in place of an exception where no equilibrium is found.

    Raises
    ------
    ModelError
        If `loads` do not rise, or a load has no finite value.
    """
    if not all(a < b for a, b in zip((0.0, *loads), loads, strict=False)) or not np.isfinite(loads).all():
        raise ModelError(f"loads {tuple(loads)}; allowed: numbers that rise from above 0", "loads")
    way = _Way(part, settings or SolverSettings(iterations=part.usual_iterations), progress)
    if way.equations.is_loose():
        return way.ended(LOOSE_CAUSE)
    for load in loads:
        cause = way.go_to(load)
        if cause:
            return way.ended(cause)
        way.reached.append(way.last)
    return way.ended("")


class _Way:
    """The states on the way to a load, and the load step that fits."""

    def __init__(
        self, part: Part, settings: SolverSettings, progress: Callable[[EquilibriumState], None] | None
    ) -> None:
        self.equations, self.settings, self.progress = Equations(part), settings, progress
        self.last = at_rest(part)
        self.before: EquilibriumState | None = None
        self.reached: list[EquilibriumState] = []
        self.size = LoadSteps(settings.first_step, settings.least_step)
        self.has_search_lost = False
        self.steps = self.iterations = 0

    def ended(self, cause: str) -> LoadSolution:
        """Return what became of it."""
        status = "stopped" if cause else "solved"
        return LoadSolution(status, cause, tuple(self.reached), self.last, self.steps, self.iterations)

    def go_to(self, stop: float) -> str:
        """Go on to a load; return the cause if there is no way."""
        while self.last.load < stop:
            load = self.size.next(self.last.load, stop)
            state, cause, _ = self.try_at(load)
            if state is not None:
                self.accept(state)
            elif self.size.has_failed(load - self.last.load):
                return f"load factor {load:.6g} of {stop:.6g}: {self.reason(load, cause)}"
        return ""

    def try_at(self, load: float) -> Attempt:
        """Try to find the state at a load from the last one."""
        # From there and not from a guess: a part that bends, moved on straight, changes its volume.
        u = self.last.u
        # Full steps first: a bent part gets longer before it gets better, which no search lets through.
        for is_searching in (False,) if self.has_search_lost else (False, True):
            attempt = equilibrium(self.equations, u, u, load, self.settings, is_searching)
            self.iterations += attempt.iterations
            if attempt.state is not None:
                return attempt
        self.has_search_lost = True
        return attempt

    def accept(self, state: EquilibriumState) -> None:
        """Go on from a state in equilibrium."""
        self.size.has_succeeded(state.load - self.last.load)
        self.before, self.last = self.last, state
        self.steps += 1
        if self.progress is not None:
            self.progress(state)

    def reason(self, load: float, cause: str) -> str:
        """Say why load control finds nothing: a limit point, where the path turns, or the cause given."""
        limit = limit_load(self.equations, self.before, self.last, self.settings)
        if limit is None or limit >= load:
            return cause
        return (
            f"a limit point at load factor {limit:.6g}, beyond which there is no equilibrium near by;"
            " soro_design.fem.follow goes on along the path by arc length"
        )
