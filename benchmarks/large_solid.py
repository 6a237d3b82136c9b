"""Equilibria of solids of 30,000 to 54,872 elements, by each solver of large solids that is installed."""

from __future__ import annotations

import resource
from importlib.util import find_spec

import numpy as np

from benchmarks.options import Options
from benchmarks.report import figure, table
from benchmarks.solver import PACKAGES, by_one_solver, pulled
from benchmarks.timing import CLOCK, all_cores
from soro_core.arrays import Array
from soro_design.fem import (
    Part,
    RodCounts,
    RodShape,
    block,
    load_material,
    make_part,
    no_loads,
    rod_mesh,
    traction,
)

TITLE = "Large solid"
HEAD = [
    "case",
    "displacements",
    "solver",
    "load steps",
    "iterations",
    "s",
    "CPU s",
    "most GB so far",
    "largest displacement, mm",
    "off by",
]
NOTE = (
    "Wall time of both cores, and processor time where that is less. Most memory is that of the process up to"
    " there. Off by: largest difference of a displacement from that of multigrid, over the largest one."
)


def run(options: Options) -> str:
    """Measure and write."""
    cases = {
        "block pulled": lambda: pulled(options.pick(38, 3)),
        "beam bent by a force": lambda: bent_beam(options.pick(20, 2)),
        "rod bent by a chamber": lambda: bent_rod(options.pick(8, 2)),
    }
    rows: list[list[object]] = []
    with all_cores():
        for name, make in cases.items():
            rows += by_solvers(options, name, make())
    return f"{table(HEAD, rows)}\n\n{NOTE}"


def by_solvers(options: Options, name: str, part: Part) -> list[list[object]]:
    """Rows of a part solved by each solver that is installed; that with the least memory first."""
    rows: list[list[object]] = []
    first: Array | None = None
    for solver in ("multigrid", "pardiso"):
        if not find_spec(PACKAGES[solver]):
            continue
        options.say(f"{name}, {solver}")
        CLOCK.reset()
        done, _ = by_one_solver(part, solver)
        if done.status != "solved":
            raise RuntimeError(f"{name}, {solver}: {done.cause}")
        u = done.last.u
        off = "" if first is None else f"{np.abs(u - first).max() / np.abs(first).max():.0e}"
        first = u if first is None else first
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        counts = [part.mesh.points.size, solver, done.steps, done.iterations]
        seconds = [figure(CLOCK.wall), figure(CLOCK.cpu)]
        rows.append([name, *counts, *seconds, f"{memory:.1f}", figure(1e3 * np.abs(u).max()), off])
    return rows


def bent_beam(n: int) -> Part:
    """A cantilever of 5 n x n x n hex8 of silicone (.49), 100 x 10 x 10 mm, under a force at its tip."""
    mesh = block("hex8", "solid", (5 * n, n, n), (0.1, 0.01, 0.01))
    x = mesh.points[:, 0]
    force = traction(mesh, mesh.faces_at(x > 0.1 - 1e-9), [0.0, 0.0, 540.0])
    loads = no_loads(mesh).pull(force)
    for k in range(3):
        loads = loads.hold(x == 0.0, k)
    return make_part(mesh, load_material("dragonskin_10"), loads)


def bent_rod(n: int) -> Part:
    """A rod of silicone with three chambers, of which one has 20 kPa that follow its walls."""
    shape = RodShape(0.06, 0.012, 3, 0.004, 0.007, 0.003)
    rod = rod_mesh(shape, RodCounts(around=n, across=n // 2, along=8 * n, plug=n // 2))
    loads = no_loads(rod.mesh).press(rod.chambers[0], 20e3)
    for k in range(3):
        loads = loads.hold(rod.base, k)
    return make_part(rod.mesh, load_material("dragonskin_10"), loads)
