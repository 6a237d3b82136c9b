"""Equilibrium under rising loads: Newton's method with load steps that adapt, docs/design.md (10)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu

from soro_core.errors import ModelError
from soro_core.fem.part import Balance, Part
from soro_core.fem.response import Array

GROWTH, CUT = 1.5, 0.5
# A least pivot below this share of the greatest is one of a part that can move freely.
LOOSE = 1e-13
# Entries above this share of their column may stay pivots of the diagonal.
PIVOT = 1e-3
# The slope of the potential at the end of a step over that at its start; beyond it the step is shortened.
KEPT_SLOPE = 0.9
SHORTENINGS = 8


@dataclass(frozen=True)
class Settings:
    """How loads rise and when forces count as balanced.

    Attributes
    ----------
    first_step, least_step : float
        First load step, and the one below which the solution stops.
    tolerance : float
        Greatest unbalanced force over the forces of stresses or springs, as norms.
    iterations : int
        Most iterations of one load step.
    """

    first_step: float = 0.25
    least_step: float = 1e-4
    tolerance: float = 1e-9
    iterations: int = 12

    def __post_init__(self) -> None:
        rules = {
            "first_step": 0.0 < self.first_step < np.inf,
            "least_step": 0.0 < self.least_step < np.inf,
            "tolerance": 0.0 < self.tolerance < 1.0,
            "iterations": self.iterations >= 1,
        }
        for key, is_kept in rules.items():
            if not is_kept:
                allowed = "steps above 0, tolerance between 0 and 1, 1 iteration or more"
                raise ModelError(f"{key} {getattr(self, key)}; allowed: {allowed}", key)


@dataclass(frozen=True, eq=False)
class State:
    """A state in equilibrium.

    Attributes
    ----------
    load : float
        Load factor.
    u : ndarray, (n, d)
        Displacements [m].
    reaction : ndarray, (n, d)
        Forces of the supports on the part [N], 0 where a node is free.
    energy : float
        Strain energy [J].
    """

    load: float
    u: Array
    reaction: Array
    energy: float


@dataclass(frozen=True, eq=False)
class Solution:
    """What became of a solution.

    Attributes
    ----------
    status : str
        solved, or stopped before the last load.
    cause : str
        Why it stopped, else empty.
    states : tuple of State
        Those at the loads asked for that were reached.
    last : State
        The last one in equilibrium, whatever the status.
    steps, iterations : int
        Load steps in equilibrium and all iterations.
    """

    status: str
    cause: str
    states: tuple[State, ...]
    last: State
    steps: int
    iterations: int


def solve(
    part: Part,
    loads: Sequence[float] = (1.0,),
    settings: Settings | None = None,
    progress: Callable[[State], None] | None = None,
) -> Solution:
    """Follow the part from its undeformed state through rising load factors.

    Parameters
    ----------
    part : Part
        The part.
    loads : sequence of float
        Load factors to stop at, rising from above 0.
    settings : Settings, optional
        How loads rise.
    progress : callable, optional
        Called with every state in equilibrium.

    Returns
    -------
    Solution
        With a status in place of an exception where no equilibrium is found.

    Raises
    ------
    ModelError
        If `loads` do not rise, or a load has no finite value.
    """
    settings = settings or Settings()
    if not all(a < b for a, b in zip((0.0, *loads), loads, strict=False)) or not np.isfinite(loads).all():
        raise ModelError(f"loads {tuple(loads)}; allowed: numbers that rise from above 0", "loads")
    system = _System(part)
    zero = np.zeros_like(part.mesh.points)
    last = State(0.0, zero, zero, 0.0)
    before: State | None = None
    reached: list[State] = []
    if system.is_loose():
        return Solution(
            "stopped", "nothing holds the part against some motion: hold it there", (), last, 0, 0
        )
    step, steps, iterations = settings.first_step, 0, 0
    for stop in loads:
        while last.load < stop:
            load = stop if last.load + 1.001 * step >= stop else last.load + step
            guess = last.u
            if before is not None:
                guess = last.u + (last.u - before.u) * (load - last.load) / (last.load - before.load)
            state, cause = None, ""
            # Full steps first: a bent part gets longer before it gets better, which no search lets through.
            for is_searching in (False, True):
                state, cause, used = _equilibrium(system, guess, last.u, load, settings, is_searching)
                iterations += used
                if state is not None:
                    break
            if state is None:
                step = CUT * (load - last.load)
                if step < settings.least_step:
                    cause = f"load factor {load:.6g} of {loads[-1]:.6g}: {cause}"
                    return Solution("stopped", cause, tuple(reached), last, steps, iterations)
                continue
            # A step that was cut to end at a stop does not shorten the next one.
            step = GROWTH * max(step, load - last.load)
            before, last, steps = last, state, steps + 1
            if progress is not None:
                progress(state)
        reached.append(last)
    return Solution("solved", "", tuple(reached), last, steps, iterations)


class _System:
    """The equations of a part, with its held displacements taken out."""

    def __init__(self, part: Part) -> None:
        self.part = part
        held = part.loads.held
        self.is_held = np.isfinite(held)
        self.target = np.where(self.is_held, held, 0.0)
        pattern = part.pattern
        flat = self.is_held.ravel()
        column = np.repeat(np.arange(pattern.n), np.diff(pattern.start))
        self.dropped = flat[pattern.row] | flat[column]
        self.diagonal = pattern.diagonal()

    def gap(self, u: Array, load: float) -> Array:
        """Displacements that held nodes still lack."""
        return np.where(self.is_held, load * self.target - u, 0.0)

    def free(self, balance: Balance) -> Array:
        """Unbalanced forces of the free nodes."""
        return np.where(self.is_held, 0.0, balance.unbalanced)

    def is_loose(self) -> bool:
        """Whether the undeformed part can move without a force."""
        solver = self.factors(self.part.balance(np.zeros_like(self.target), 0.0))
        pivots = np.abs(solver.U.diagonal()) if solver is not None else np.zeros(1)
        return bool(pivots.min() <= LOOSE * pivots.max())

    def factors(self, balance: Balance) -> Any:
        """Return the factors of the stiffness between free nodes, or None where it is singular."""
        data, flat = balance.data, self.is_held.ravel()
        reduced = np.where(self.dropped, 0.0, data)
        # A stiffness of the usual size keeps the matrix as well scaled as it is.
        reduced[self.diagonal[flat]] = np.abs(data[self.diagonal]).mean()
        return factorised(self.part.pattern.matrix(reduced))

    def step(self, balance: Balance, gap: Array) -> Array | None:
        """Return Newton's step, or None where the stiffness is singular."""
        right = -self.free(balance).ravel()
        if gap.any():
            right -= self.part.pattern.matrix(balance.data) @ gap.ravel()
        right[self.is_held.ravel()] = 0.0
        solver = self.factors(balance)
        if solver is None:
            return None
        found = solver.solve(right)
        return found.reshape(gap.shape) + gap if np.isfinite(found).all() else None


def factorised(matrix: Any) -> Any:
    """Return the LU factors of a sparse matrix whose pattern is symmetric, or None where it is singular."""
    try:
        return splu(
            matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=PIVOT, options={"SymmetricMode": True}
        )
    except RuntimeError:
        return None


def _equilibrium(
    system: _System, guess: Array, safe: Array, load: float, settings: Settings, is_searching: bool
) -> tuple[State | None, str, int]:
    """Return the state at a load or the cause why there is none, and the iterations used."""
    part, u = system.part, guess
    balance = part.balance(u, load)
    if balance.inverted >= 0 and u is not safe:
        u, balance = safe, part.balance(safe, load)
    span = float(np.ptp(part.mesh.points, axis=0).max())
    for iteration in range(settings.iterations):
        if balance.inverted >= 0:
            return None, _inversion(part, balance.inverted), iteration
        free, gap = system.free(balance), system.gap(u, load)
        scale = max(balance.size, 1e-12 * float(np.abs(balance.data).max()) * span)
        is_there = float(np.abs(gap).max()) <= 1e-14 * span
        if is_there and float(np.linalg.norm(free)) <= settings.tolerance * scale:
            reaction = np.where(system.is_held, balance.unbalanced, 0.0)
            return State(load, u, reaction, balance.energy), "", iteration
        step = system.step(balance, gap)
        if step is None:
            return (
                None,
                "the stiffness is singular: hold the part, or the load is at a limit point",
                iteration,
            )
        # Held nodes that still move do work too, and a saddle has no descent: no potential to follow.
        slope = float((step * free).sum()) if is_searching and is_there else 0.0
        u, balance = _moved(system, u, load, step, slope, is_there)
    if balance.inverted >= 0:
        return None, _inversion(part, balance.inverted), settings.iterations
    return None, f"no equilibrium in {settings.iterations} iterations", settings.iterations


def _moved(
    system: _System, u: Array, load: float, step: Array, slope: float, is_there: bool
) -> tuple[Array, Balance]:
    """Return the end of a step: the whole of it, or so much that J > 0.

    Where the potential falls along it, with `slope`, so much that it is nearly at its lowest.
    """
    length = 1.0
    for _ in range(SHORTENINGS):
        moved = u + length * step
        balance = system.part.balance(moved, load)
        if balance.inverted >= 0:
            # Held nodes have to move by all of it.
            if not is_there:
                break
            length *= CUT
            continue
        if slope >= 0.0:
            break
        now = float((step * system.free(balance)).sum())
        if abs(now) <= -KEPT_SLOPE * slope:
            break
        # The lowest point by a straight slope; where it gets steeper there is none to aim at.
        length *= float(np.clip(slope / (slope - now), 0.1, 0.8)) if now > 0.0 else CUT
    return moved, balance


def _inversion(part: Part, e: int) -> str:
    place = ", ".join(f"{x:.4g}" for x in part.mesh.points[part.mesh.cells[e]].mean(axis=0))
    return f"element {e} at ({place}) m turns inside out; refine there, or lower the load"
