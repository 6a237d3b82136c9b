"""Equilibrium along a path whose load may fall: steps of an arc length, docs/design.md (11)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_design.fem.part import Part
from soro_design.fem.solve.equations import LOOSE_CAUSE, Equations
from soro_design.fem.solve.equilibrium import Attempt, equilibrium, inversion
from soro_design.fem.solve.states import EquilibriumState, LoadSolution, SolverSettings
from soro_design.fem.solve.steps import CUT, GROWTH

# Iterations of a step that keeps its length, and the least cosine between a step and its tangent.
USUAL, STRAIGHT = 5, 0.7
# Shortenings of a step until the path counts as ended, steps that look for a limit point.
SHORTENINGS, LOOKS = 20, 40


def follow(
    part: Part,
    load: float = 1.0,
    settings: SolverSettings | None = None,
    until: Callable[[EquilibriumState], bool] | None = None,
    most_steps: int = 200,
    progress: Callable[[EquilibriumState], None] | None = None,
) -> LoadSolution:
    """Follow the path of equilibria of the part from its undeformed state, also where the load falls.

    Parameters
    ----------
    part : Part
    load : float
        Load factor above 0 at which to end, once the path rises to it.
    settings : SolverSettings, optional
        The first step is as long as the displacements of its load step in the linear part.
    until : callable, optional
        Of a state: whether to end there.
    most_steps : int
        After which to stop.
    progress : callable, optional
        Called with every state in equilibrium.

    Returns
    -------
    LoadSolution
        With all states of the path; with a status in place of an exception where it ends early.

    Raises
    ------
    ModelError
        If `load` or `most_steps` is not above 0.
    """
    if not 0.0 < load < np.inf or most_steps < 1:
        raise ModelError(
            f"load {load}, most_steps {most_steps}; allowed: load above 0, 1 step or more", "load"
        )
    settings = settings or SolverSettings(iterations=part.usual_iterations)
    equations = Equations(part)
    path = ArcLengthPath(equations, settings, at_rest(part), None)
    states: list[EquilibriumState] = []
    cause = LOOSE_CAUSE if equations.is_loose() else ""
    while not cause and len(states) < most_steps:
        state = path.step(load)
        if state is None:
            cause = f"load factor {path.last.load:.6g}: no equilibrium on the path; {path.cause}"
            break
        states.append(state)
        if progress is not None:
            progress(state)
        if state.load == load or (until is not None and until(state)):
            break
    else:
        cause = cause or f"load factor {path.last.load:.6g} after {most_steps} steps; ask for more of them"
    status = "stopped" if cause else "solved"
    return LoadSolution(status, cause, tuple(states), path.last, len(states), path.iterations)


def at_rest(part: Part) -> EquilibriumState:
    """Return the undeformed state."""
    zero = np.zeros_like(part.mesh.points)
    return EquilibriumState(0.0, zero, zero, 0.0)


class ArcLengthPath:
    """The end of a path of equilibria, which steps on.

    Parameters
    ----------
    equations : Equations
        Of the part.
    settings : SolverSettings
        First step, tolerance and iterations.
    last : EquilibriumState
        Where it begins.
    before : EquilibriumState or None
        A state before it, which says where the path comes from; by default the load rises first.
    """

    def __init__(
        self,
        equations: Equations,
        settings: SolverSettings,
        last: EquilibriumState,
        before: EquilibriumState | None,
    ) -> None:
        self.equations, self.settings = equations, settings
        self.last = last
        self.way = None if before is None else last.u - before.u
        self.length = 0.0 if self.way is None else float(np.linalg.norm(self.way))
        self.iterations, self.cause = 0, ""

    def step(self, ceiling: float = np.inf) -> EquilibriumState | None:
        """Go on by one step, at most up to the load `ceiling`; return None where there is no state."""
        last, equations = self.last, self.equations
        rate = self._rate(last.u, last.load)
        if rate is None:
            self.cause = "the stiffness is singular: hold the part"
            return None
        size = float(np.linalg.norm(rate))
        if size == 0.0:
            self.cause = "no load moves the part"
            return None
        if self.length == 0.0:
            self.length = self.settings.first_step * size
        forwards = 1.0 if self.way is None or float((rate * self.way).sum()) >= 0.0 else -1.0
        for _ in range(SHORTENINGS):
            rise = forwards * self.length / size
            state, self.cause, used = self._correct(last.u + rise * rate, last.load + rise)
            if state is not None and last.load < ceiling < state.load:
                # On the straight line between both.
                share = (ceiling - last.load) / (state.load - last.load)
                guess = last.u + share * (state.u - last.u)
                state, self.cause, _ = equilibrium(equations, guess, last.u, ceiling, self.settings, False)
            if state is not None and self._is_straight(state.u - last.u, forwards * rate):
                self.way, self.last = state.u - last.u, state
                self.length *= float(np.clip(np.sqrt(USUAL / max(used, 1)), CUT, GROWTH))
                return state
            self.length *= CUT
        return None

    def _rate(self, u: Array, load: float) -> Array | None:
        """du/dload, or None where the stiffness is singular."""
        tangent = self.equations.tangent(self.equations.part.balance(u, load), u)
        return tangent.move(self.equations.part.push(u), self.equations.target) if tangent else None

    def _is_straight(self, moved: Array, tangent: Array) -> bool:
        """Whether a step keeps to its tangent, and so to its path."""
        sizes = float(np.linalg.norm(moved) * np.linalg.norm(tangent))
        return float((moved * tangent).sum()) >= STRAIGHT * sizes

    def _correct(self, u: Array, load: float) -> Attempt:
        """Newton's method for displacements and load, each step normal to the way from the last state."""
        equations, part, start = self.equations, self.equations.part, self.last.u
        before, u = start, start + part.reach(start, u) * (u - start)
        for iteration in range(self.settings.iterations):
            balance = part.balance(u, load, before=before)
            if balance.inverted >= 0:
                return Attempt(None, inversion(part, balance.inverted), iteration)
            if equations.is_met(balance, u, load, self.settings.tolerance):
                forces = equations.state_forces(balance)
                return Attempt(EquilibriumState(load, u, forces, balance.energy), "", iteration)
            self.iterations += 1
            tangent = equations.tangent(balance, u)
            by_gap = tangent.move(-balance.unbalanced, equations.gap(u, load)) if tangent else None
            rate = tangent.move(part.push(u), equations.target) if tangent else None
            if by_gap is None or rate is None:
                return Attempt(None, "the stiffness is singular: hold the part", iteration)
            way = u - start
            along = float((way * rate).sum())
            if along == 0.0:
                return Attempt(None, "the path turns by a right angle", iteration)
            rise = -float((way * by_gap).sum()) / along
            step = by_gap + rise * rate
            share = part.reach(u, u + step)
            before, u, load = u, u + share * step, load + share * rise
        return Attempt(None, "no equilibrium within the iterations", self.settings.iterations)


def limit_load(
    equations: Equations, before: EquilibriumState | None, last: EquilibriumState, settings: SolverSettings
) -> float | None:
    """Return the load factor at which the path beyond a state turns back, or None where it rises on.

    Parameters
    ----------
    equations : Equations
        Of the part.
    before, last : EquilibriumState
        The last two states in equilibrium, if there are two.
    settings : SolverSettings
        As of the path.
    """
    path = ArcLengthPath(equations, settings, last, before)
    highest = last.load
    for _ in range(LOOKS):
        state = path.step()
        if state is None:
            return None
        if state.load < highest:
            return highest
        highest = state.load
    return None
