"""Topology optimisation driven by pressure: the linear arch, and a bellow on two grids."""

from __future__ import annotations

import time
from dataclasses import dataclass

from benchmarks.options import Options
from benchmarks.report import figure, met, table
from soro_core.config import changed
from soro_core.design import Reanalysis, Shape, State, load_task, make_domain, optimise, reanalyse, shape
from soro_core.design.task import Task

TITLE = "Topology optimisation"
# Work of the pressure, 1000 at the first iteration, at most.
ARCH = {(100, 50): 16.9, (200, 100): 14.4}
# Most minutes of the processor.
BELLOW_MIN = {(100, 50): 2.0, (200, 100): 6.0}
MOTION_MM, GRIDS_AGREE, GREYNESS, OWN_MESH_AGREES, STROKE_MM = 2.4, 0.02, 0.08, 0.05, 7.0


@dataclass(frozen=True, eq=False)
class Bellow:
    """A run with its final part."""

    state: State
    found: Shape
    moved: Reanalysis
    processor_s: float

    @property
    def motion_mm(self) -> float:
        """On the grid, against the spring."""
        return 1e3 * self.state.rows[-1].motion_m


def run(options: Options) -> str:
    """Run both tasks on both grids."""
    iterations = options.pick(None, 3)
    cells = options.pick(tuple(ARCH), ((20, 10), (24, 12)))
    rows = [row for one, own in zip(cells, ARCH, strict=True) for row in _arch(one, own, iterations, options)]
    bellows = [_bellow(one, iterations, options) for one in cells]
    for one, own, found in zip(cells, BELLOW_MIN, bellows, strict=True):
        rows += _rows(f"bellow, {one[0]} x {one[1]}", found, BELLOW_MIN[own])
    apart = abs(bellows[1].motion_mm / bellows[0].motion_mm - 1.0)
    rows.append(
        ("both bellows", "motion, apart", f"{apart:.1%}", f"<= {GRIDS_AGREE:.0%}", met(apart <= GRIDS_AGREE))
    )
    text = table(("case", "", "found", "target", ""), rows)
    return (
        f"{text}\n\nTasks: `config/design/arch.yaml` and `bellow.yaml`; the bellow after "
        f"{bellows[0].state.rows[-1].iteration} iterations. Times are those of one core, kernels compiled. "
        "Own mesh: the part cut along the contour of its densities, computed by `soro_core.fem` "
        "([how](../docs/design.md))."
    )


def _of(name: str, cells: tuple[int, int], iterations: int | None) -> Task:
    task = changed(load_task(name), cells=cells)
    if name == "arch":
        # Those who compare it state filter and depth in elements.
        edge = task.size_m[0] / cells[0]
        task = changed(task, filter_radius_m=2.4 * edge, air=changed(task.air, depth_m=2.0 * edge))
    if iterations is None:
        return task
    # A test gets a filter that its grid resolves, and a pressure that a grey design bears.
    ramp, low = (0, task.schedule.pressure_pa) if name == "arch" else (iterations, (100.0, 200.0))
    schedule = changed(task.schedule, iterations=iterations, ramp=ramp, pressure_pa=low)
    return changed(task, schedule=schedule, filter_radius_m=2.0 * task.size_m[0] / cells[0])


def _arch(
    cells: tuple[int, int], own: tuple[int, int], iterations: int | None, options: Options
) -> list[tuple[str, ...]]:
    options.say(f"arch, {cells[0]} x {cells[1]}")
    start = time.process_time()
    rows = optimise(_of("arch", cells, iterations)).rows
    spent = time.process_time() - start
    work = 1000.0 * rows[-1].objective / rows[0].objective
    name = f"arch, {cells[0]} x {cells[1]}"
    return [
        (name, "work, 1000 at first", figure(work, 4), f"<= {ARCH[own]}", met(work <= ARCH[own])),
        (name, "time", f"{spent:.0f} s", "", ""),
    ]


def _bellow(cells: tuple[int, int], iterations: int | None, options: Options) -> Bellow:
    task = _of("bellow", cells, iterations)
    name = f"bellow, {cells[0]} x {cells[1]}"
    start = time.process_time()
    state = optimise(task, progress=lambda now: options.say(f"{name}: {now.rows[-1].iteration}"))
    spent = time.process_time() - start
    options.say(f"{name}: own mesh")
    domain = make_domain(task)
    found = shape(domain, state)
    return Bellow(state, found, reanalyse(domain, found), spent)


def _rows(name: str, bellow: Bellow, minutes: float) -> list[tuple[str, ...]]:
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
        (name, "leak", bellow.found.leak or "none", "none", met(not bellow.found.leak)),
        (name, "greyness", f"{last.greyness:.3f}", f"<= {GREYNESS}", met(last.greyness <= GREYNESS)),
        (
            name,
            "own mesh against grid",
            f"{gap:.1%}",
            f"<= {OWN_MESH_AGREES:.0%}",
            met(gap <= OWN_MESH_AGREES),
        ),
        (name, "stroke without spring", f"{stroke:.2f} mm", f">= {STROKE_MM} mm", met(stroke >= STROKE_MM)),
        (name, "thinnest wall", f"{1e3 * bellow.found.wall_m:.2f} mm", "", ""),
        (name, "time", f"{spent:.0f} s", f"<= {minutes:g} min", met(spent <= 60.0 * minutes)),
    ]
