"""The state in equilibrium at one load, by Newton's method, docs/design.md (10)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_design.fem.part import Balance, Part
from soro_design.fem.solve.equations import Equations
from soro_design.fem.solve.linear import KeptFactors
from soro_design.fem.solve.states import EquilibriumState, SolverSettings
from soro_design.fem.solve.steps import CUT, shortened, whole_or_half

# The slope of the potential at the end of a step over that at its start; beyond it the step is shortened.
KEPT_SLOPE = 0.9
# Iterations over which the unbalanced force may grow on and on, where no search shortens steps.
GROWING = 3


class Attempt(NamedTuple):
    """A state in equilibrium, or the cause why there is none, and the iterations used."""

    state: EquilibriumState | None
    cause: str
    iterations: int


def equilibrium(
    equations: Equations, guess: Array, safe: Array, load: float, settings: SolverSettings, is_searching: bool
) -> Attempt:
    """Return the state at a load, or a cause.

    Parameters
    ----------
    equations : Equations
        Of the part.
    guess, safe : ndarray, (n, d)
        Displacements to start from, and those where no element is inverted, if the guess has one [m].
    load : float
        Load factor.
    settings : SolverSettings
        How close, and how long to try.
    is_searching : bool
        Whether to shorten steps to where the potential has its lowest point.
    """
    part = equations.part
    u = safe + part.reach(safe, guess) * (guess - safe)

    def balance_at(u: Array, before: Array) -> Balance:
        return part.balance(u, load, before=before)

    balance = balance_at(u, safe)
    if balance.inverted >= 0:
        u, balance = safe, balance_at(safe, safe)
    last, growing, kept = np.inf, 0, KeptFactors()
    for iteration in range(settings.iterations):
        if balance.inverted >= 0:
            return Attempt(None, inversion(part, balance.inverted), iteration)
        if equations.is_met(balance, u, load, settings.tolerance):
            return Attempt(
                EquilibriumState(load, u, equations.state_forces(balance), balance.energy), "", iteration
            )
        size = float(np.linalg.norm(equations.free(balance)))
        # The load itself makes the first one; a search looks at the potential, and the force may grow.
        growing = growing + 1 if size > last and not is_searching else 0
        if growing == GROWING:
            return Attempt(None, f"the unbalanced force grows to {size:.3g} N", iteration)
        last = size if iteration else np.inf
        step = equations.step(balance, u, load, kept)
        if step is None:
            return Attempt(None, "the stiffness is singular: hold the part", iteration)
        is_there = equations.is_there(equations.gap(u, load))
        u, balance = moved(equations, balance_at, u, step, balance, is_there, is_searching)
    if balance.inverted >= 0:
        return Attempt(None, inversion(part, balance.inverted), settings.iterations)
    return Attempt(None, f"no equilibrium in {settings.iterations} iterations", settings.iterations)


def moved(
    equations: Equations,
    balance_at: Callable[[Array, Array], Balance],
    u: Array,
    step: Array,
    start: Balance,
    is_there: bool,
    is_searching: bool,
) -> tuple[Array, Balance]:
    """Return the end of a step: so much of it that nothing meets and J > 0, and as a search asks.

    Parameters
    ----------
    equations : Equations
        Of the part.
    balance_at : callable
        Forces at displacements (n, d), by those before.
    u, step : ndarray, (n, d)
        Displacements before the step, and the whole step [m].
    start : Balance
        Forces before the step.
    is_there : bool
        Whether held nodes are in their places before it.
    is_searching : bool
        Whether to shorten it to where the potential has its lowest point.
    """
    # Held nodes that still move do work too, and a saddle has no descent: no potential to follow.
    slope = float((step * equations.free(start)).sum()) if is_searching and is_there else 0.0

    def share(balance: Balance) -> float:
        if balance.inverted >= 0:
            # Held nodes have to move by all of it.
            return whole_or_half(balance) if is_there else 1.0
        return _share(slope, float((step * equations.free(balance)).sum()))

    return shortened(balance_at, u, step, share, equations.part.reach(u, u + step))


def _share(slope: float, now: float) -> float:
    """Share of a step to keep, by the slopes of the potential at its start and at its end; 1 is all."""
    if slope >= 0.0 or abs(now) <= -KEPT_SLOPE * slope:
        return 1.0
    # The lowest point by a straight slope; where it gets steeper there is none to aim at.
    return float(np.clip(slope / (slope - now), 0.1, 0.8)) if now > 0.0 else CUT


def inversion(part: Part, e: int) -> str:
    """Say which element turns inside out."""
    place = ", ".join(f"{x:.4g}" for x in part.mesh.points[part.mesh.cells[e]].mean(axis=0))
    return f"element {e} at ({place}) m turns inside out; refine there, or lower the load"
