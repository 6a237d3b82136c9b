"""The best design of a task: a search on a coarse mesh, whose limit on stretch follows the own mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.jobs import Executor, map_jobs
from soro_design.parts.file import PartFile
from soro_design.shape.figures import GOALS, DesignFigures, figures, without_shape
from soro_design.shape.search import SurrogateSearch
from soro_design.shape.task import ShapeTask, coarse

# Rounds between two checks on the own mesh, while the stretch there is beyond the limit; most checks.
MORE, CHECKS = 2, 3
# By how much more than what was seen the own mesh may stretch.
SPARE = 1.01


@dataclass
class ShapeSearch:
    """How far a search is.

    Attributes
    ----------
    task : ShapeTask
    designs : list of tuple of ndarray and DesignFigures
        Points of the unit cube and what they reach on the coarse mesh, in order.
    start : DesignFigures or None
        The part on the coarse mesh.
    before, after : DesignFigures or None
        The part and the best design on the part's own mesh.
    ratio : float
        Elongation on the own mesh over that on the coarse one.
    best : int or None
        Number of the best design.
    """

    task: ShapeTask
    designs: list[tuple[Array, DesignFigures]] = field(default_factory=list)
    start: DesignFigures | None = None
    before: DesignFigures | None = None
    after: DesignFigures | None = None
    ratio: float = 1.0
    best: int | None = None

    @property
    def is_beyond(self) -> bool:
        """Whether the best design stretches beyond the limit on the part's own mesh."""
        return self.after is not None and not self.after.cause and self.task.excess(self.after.stretch) > 0.0

    def excess(self, found: DesignFigures) -> float:
        """Return by how much the stretch of a design would be beyond the limit on the own mesh."""
        return self.task.excess(1.0 + self.ratio * (found.stretch - 1.0))


def default_designs(task: ShapeTask) -> int:
    """Return the number of designs that are computed."""
    return 20 + 8 * len(task.varied)


def optimise(
    state: ShapeSearch,
    executor: Executor,
    most: int,
    told: Callable[[ShapeSearch], None],
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Search, and keep in the state all that is known, also when an interrupt leaves.

    Parameters
    ----------
    state : ShapeSearch
        New, of a task.
    executor : Executor
        Computes the designs of a round; results do not depend on it.
    most : int
        Number of designs before the own mesh is asked; `MORE` rounds more follow each check that fails.
    told : callable
        Called after each design.
    stop : callable
        Asked whether to begin no more.

    Raises
    ------
    ModelError
        If no design keeps the limits.
    """
    task = state.task
    search = SurrogateSearch(task.point_of(task.geometry), task.snap, task.is_allowed)
    compute = partial(_computed, task)

    def own(file: PartFile) -> DesignFigures | None:
        return next(
            iter(map_jobs(partial(figures, task.goal, task.sweep), [file], executor, stop=stop)), None
        )

    def learn() -> None:
        search.points = [point for point, _ in state.designs]
        search.values = [-found.goal for _, found in state.designs]
        search.excess = [state.excess(found) for _, found in state.designs]
        state.best = search.best

    def round_of(points: list[Array]) -> bool:
        """Compute designs; return whether there were any."""
        known = len(state.designs)
        for point, found in zip(points, map_jobs(compute, points, executor, stop=stop), strict=False):
            state.designs.append((point, found))
            learn()
            told(state)
        return len(state.designs) > known

    first = search.first()
    if not first:
        raise ModelError(f"no design within the bounds has walls of {1e3 * task.min_wall_m:g} mm", "vary")
    state.before = own(task.file)
    state.start = _computed(task, task.file)
    if state.before is not None and not state.before.cause and not state.start.cause:
        state.ratio = max(1.0, (state.before.stretch - 1.0) / (state.start.stretch - 1.0))
    round_of(first[:most])
    while not stop() and len(state.designs) < most and not search.ended():
        if not round_of(search.next()[: most - len(state.designs)]):
            break
    for check in range(CHECKS):
        if state.best is None:
            raise ModelError(_none_kept(state), "vary")
        if stop():
            return
        point, found = state.designs[state.best]
        after = state.after = own(task.design(point))
        if after is None or not state.is_beyond or check == CHECKS - 1:
            return
        state.ratio = SPARE * (after.stretch - 1.0) / (found.stretch - 1.0)
        # Another design may be the best from here on.
        state.after = None
        learn()
        for _ in range(MORE):
            round_of(search.next())


def _computed(task: ShapeTask, design: Array | PartFile) -> DesignFigures:
    """Return what a design reaches on the coarse mesh, without its displacements."""
    file = task.design(design) if isinstance(design, np.ndarray) else design
    return without_shape(figures(task.goal, task.sweep, coarse(file)))


def _none_kept(state: ShapeSearch) -> str:
    held = [found for _, found in state.designs if not found.cause]
    limit = f"none of {len(state.designs)} designs keeps the limit on the stretch, {state.task.max_stretch:g}"
    if not held:
        return f"none of {len(state.designs)} designs has an equilibrium: {state.designs[0][1].cause}"
    least = 1.0 + state.ratio * (min(found.stretch for found in held) - 1.0)
    return f"{limit}; the least is {least:.3g}: lower the pressure, or widen the bounds"


def in_unit(goal: str, value: float) -> str:
    """Return a value of a goal as a text with its unit."""
    unit, factor = GOALS[goal]
    return f"{factor * value:.4g} {unit}"
