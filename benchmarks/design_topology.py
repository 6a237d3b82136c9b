"""Topology optimisation driven by pressure: the linear arch, a bellow on two grids, and the other tasks."""

from __future__ import annotations

import time
from dataclasses import dataclass

from benchmarks.options import Options
from benchmarks.report import figure, met, table
from soro_core.config import with_changes
from soro_design.topology import (
    FinalPart,
    OptimiserState,
    Reanalysis,
    Task,
    load_task,
    make_domain,
    optimise,
    reanalyse,
    shape,
)
from soro_design.topology.widths import PRINTABLE_M, least_widths

TITLE = "Topology optimisation"
# Work of the pressure, 1000 at the first iteration, at most.
ARCH = {(100, 50): 16.9, (200, 100): 14.4}
# Most minutes of the processor.
BELLOW_MIN = {(100, 50): 0.5, (200, 100): 1.5, (400, 200): 8.0}
# Other tasks.
OTHERS = ("bellow_folds", "bender", "disc", "gripper", "muscle", "pneunet", "rotary")
MOTION_MM, GRIDS_AGREE, GREYNESS, OWN_MESH_AGREES, STROKE_MM = 2.4, 0.02, 0.08, 0.05, 7.0


@dataclass(frozen=True, eq=False)
class Found:
    """A run with its final part."""

    state: OptimiserState
    part: FinalPart
    moved: Reanalysis
    processor_s: float

    @property
    def motion_mm(self) -> float:
        """On the grid, against the spring."""
        return 1e3 * self.state.rows[-1].motion_m


def topology(options: Options) -> tuple[str, str]:
    """Run arch and bellow on their grids and the other tasks; for tests the arch alone, coarsely."""
    cells = options.pick(tuple(ARCH), ((20, 10), (24, 12)))
    rows = [row for one, own in zip(cells, ARCH, strict=True) for row in _arch(one, own, options)]
    bellows = {}
    for one in options.pick(tuple(BELLOW_MIN), ()):
        name = f"bellow, {one[0]} x {one[1]}"
        bellows[one] = _optimised(with_changes(load_task("bellow"), cells=one), name, options)
        rows += _rows(name, bellows[one], BELLOW_MIN[one])
    if bellows:
        motions = [found.motion_mm for found in bellows.values()]
        apart = max(motions) / min(motions) - 1.0
        agree = f"<= {GRIDS_AGREE:.0%}", met(apart <= GRIDS_AGREE)
        rows.append(("all bellows", "motion, apart", f"{apart:.1%}", *agree))
    for name in options.pick(OTHERS, ()):
        rows += _others_rows(name, _optimised(load_task(name), name, options))
    return TITLE, (
        f"{table(('case', '', 'found', 'target', ''), rows)}\n\n"
        "Tasks: those of `config/design`. Others move the wanted way where their motion "
        "is positive; the jaw of the gripper meets its image after 6 mm. "
        "Times are those of one core, kernels compiled. "
        "Own mesh: the part cut along the contour of its densities, computed by `soro_design.fem` "
        "([how](../docs/design.md))."
    )


def _arch(cells: tuple[int, int], own: tuple[int, int], options: Options) -> list[tuple[str, ...]]:
    options.say(f"arch, {cells[0]} x {cells[1]}")
    task = load_task("arch")
    # The same number of elements on each grid.
    finer = task.cells[0] / cells[0]
    air = with_changes(task.air, depth_m=task.air.depth_m * finer)
    task = with_changes(task, cells=cells, filter_radius_m=task.filter_radius_m * finer, air=air)
    if options.quick:
        task = with_changes(task, schedule=with_changes(task.schedule, iterations=3, ramp=0))
    start = time.process_time()
    rows = optimise(task).rows
    spent = time.process_time() - start
    work = 1000.0 * rows[-1].objective / rows[0].objective
    name = f"arch, {cells[0]} x {cells[1]}"
    return [
        (name, "work, 1000 at first", figure(work, 4), f"<= {ARCH[own]}", met(work <= ARCH[own])),
        (name, "time", f"{spent:.0f} s", "", ""),
    ]


def _optimised(task: Task, name: str, options: Options) -> Found:
    start = time.process_time()
    state = optimise(task, progress=lambda now: options.say(f"{name}: {now.rows[-1].iteration}"))
    spent = time.process_time() - start
    options.say(f"{name}: own mesh")
    domain = make_domain(task)
    found = shape(domain, state)
    return Found(state, found, reanalyse(domain, found), spent)


def _rows(name: str, bellow: Found, minutes: float) -> list[tuple[str, ...]]:
    last, moved = bellow.state.rows[-1], bellow.moved
    gap = abs(1e3 * moved.motion_m / bellow.motion_mm - 1.0)
    stroke = 1e3 * moved.free_m
    spent = bellow.processor_s
    return [
        (
            name,
            "motion",
            f"{bellow.motion_mm:.3f} mm",
            f">= {MOTION_MM} mm",
            met(bellow.motion_mm >= MOTION_MM),
        ),
        (name, "leak", bellow.part.leak or "none", "none", met(not bellow.part.leak)),
        (name, "greyness", f"{last.greyness:.3f}", f"<= {GREYNESS}", met(last.greyness <= GREYNESS)),
        (
            name,
            "own mesh against grid",
            f"{gap:.1%}",
            f"<= {OWN_MESH_AGREES:.0%}",
            met(gap <= OWN_MESH_AGREES),
        ),
        (name, "stroke without spring", f"{stroke:.2f} mm", f">= {STROKE_MM} mm", met(stroke >= STROKE_MM)),
        (name, "thinnest wall", f"{1e3 * bellow.part.wall_m:.2f} mm", "", ""),
        (name, "time", f"{spent:.0f} s", f"<= {minutes:g} min", met(spent <= 60.0 * minutes)),
    ]


def _others_rows(name: str, found: Found) -> list[tuple[str, ...]]:
    least = 1e3 * PRINTABLE_M
    width = 1e3 * least_widths(make_domain(load_task(name)), found.part.mesh).solid_m
    free, leak, last = 1e3 * found.moved.free_m, found.part.leak, found.state.rows[-1]
    gap = abs(found.moved.motion_m / last.motion_m - 1.0)
    agree = (f"<= {OWN_MESH_AGREES:.0%}", met(gap <= OWN_MESH_AGREES))
    return [
        (name, "leak", leak or "none", "none", met(not leak)),
        (name, "motion without spring, own mesh", f"{free:.2f} mm", "> 0", met(free > 0.0)),
        (name, "motion with spring, grid", f"{found.motion_mm:.3f} mm", "", ""),
        (name, "the same, own mesh", f"{1e3 * found.moved.motion_m:.3f} mm", "", ""),
        (name, "own mesh against grid", f"{gap:.1%}", *agree),
        (name, "greyness", f"{last.greyness:.3f}", f"<= {GREYNESS}", met(last.greyness <= GREYNESS)),
        (name, "least wall or hinge", f"{width:.2f} mm", f">= {least:g} mm", met(width >= least)),
        (name, "time", f"{found.processor_s:.0f} s", "", ""),
    ]
