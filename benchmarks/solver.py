"""Newton's method and the linear solvers of finite elements: counts against another library, and times."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from benchmarks.options import Options
from benchmarks.report import figure, table
from benchmarks.timing import CLOCK, all_cores
from soro_design.fem import LoadSolution, Mesh, Part, block, load_material, make_part, no_loads, solve, tube
from soro_design.fem.solve import linear
from tests.soro_design.fem import judged_parts as judged

TITLE = "Solver of finite elements"
PACKAGES = {"SuperLU": "scipy", "pardiso": "pypardiso", "multigrid": "pyamg"}
HEAD = ["case", "displacements", "solver", "load steps", "iterations", "CPU s", "energy, mJ"]


def run(options: Options) -> str:
    """Measure and write."""
    with all_cores():
        parts = {
            "Newton's method against another library": another_library(options),
            "Times": times(options),
        }
    return "\n\n".join(f"### {title}\n\n{text}" for title, text in parts.items())


def another_library(options: Options) -> str:
    """Iterations and CPU time of six parts that an independent library has solved too."""
    rows = []
    for name in options.pick(list(judged.OTHER), ["bellow"]):
        if name == "ring" and not find_spec("ipctk"):
            continue
        options.say(name)
        part, other = judged.PARTS[name](), judged.OTHER[name]
        done, spent = timed(part)
        off = np.abs(np.divide(judged.values(name, part, done.last), other.values) - 1.0).max()
        counts = [done.steps, done.iterations, other.iterations]
        rows.append([name, part.mesh.points.size, *counts, spent, figure(other.cpu_s), f"{off:.0e}"])
    head = ["part", "displacements", "load steps", "iterations", "other", "CPU s", "other", "off by"]
    note = (
        "Parts: `tests/soro_design/fem/judged_parts.py`. The times of the other library are of another run;"
        " it left no values of ring and block, which are held against our own of other load steps."
    )
    return f"{table(head, rows)}\n\n{note}"


def times(options: Options) -> str:
    """Times of a section and of solids, by each solver that is installed."""
    n, radii = options.pick(1, 8), (4e-3, 12e-3)
    cases = {
        "tube in plane strain, quad4": (pressed(tube("quad4", (32 // n, 128 // n), radii)), ["SuperLU"]),
        "tube, hex8": (pressed(tube("hex8", (8 // n, 24 // n, 24 // n), radii, 24e-3)), list(PACKAGES)),
        "block pulled, 12,167 hex8": (pulled(options.pick(23, 3)), ["pardiso", "multigrid"]),
    }
    rows = []
    for name, (part, solvers) in cases.items():
        rows += by_solvers(options, name, part, solvers)
    return f"{table(HEAD, rows)}\n\nOnly solvers that were installed. Load factor 1, by `solve`."


def by_solvers(options: Options, name: str, part: Part, solvers: list[str]) -> list[list[object]]:
    """Rows of a part solved by each solver that is installed."""
    rows = []
    for solver in solvers:
        if not find_spec(PACKAGES[solver]):
            continue
        options.say(f"{name}, {solver}")
        done, spent = by_one_solver(part, solver)
        if done.status != "solved":
            raise RuntimeError(f"{name}, {solver}: {done.cause}")
        energy = f"{1e3 * done.last.energy:.9g}"
        rows.append([name, part.mesh.points.size, solver, done.steps, done.iterations, spent, energy])
    return rows


def by_one_solver(part: Part, solver: str) -> tuple[LoadSolution, str]:
    """Solve a part by one of `PACKAGES`; returns as of `timed`."""
    before, never = (linear.MANY, linear.LARGE), 10**9
    linear.MANY = 0 if solver == "pardiso" else never
    linear.LARGE = 0 if solver == "multigrid" else never
    try:
        return timed(part)
    finally:
        linear.MANY, linear.LARGE = before


def timed(part: Part) -> tuple[LoadSolution, str]:
    """Solve a part; return what became of it, and the CPU time [s] with kernels compiled."""
    part.balance(np.zeros_like(part.mesh.points), 0.0)
    done: list[LoadSolution] = []
    seconds = CLOCK.time(lambda: done.append(solve(part)))
    return done[0], figure(seconds)


def pressed(mesh: Mesh) -> Part:
    """A quarter of a tube of silicone under 20 kPa inside."""
    x, y = mesh.points.T[:2]
    inside = mesh.faces_at(np.abs(np.hypot(x, y) - 4e-3) < 1e-9)
    loads = no_loads(mesh).hold(y == 0.0, 1).hold(x == 0.0, 0)
    if mesh.space == "solid":
        z = mesh.points[:, 2]
        loads = loads.hold((z == 0.0) | (z == z.max()), 2)
    return make_part(mesh, load_material("dragonskin_10"), loads.press(inside, 20e3))


def pulled(n: int) -> Part:
    """A block of n**3 hex8 of silicone pulled to twice its length between plates that it sticks to."""
    mesh = block("hex8", "solid", (n,) * 3, (1e-2,) * 3)
    z = mesh.points[:, 2]
    loads = no_loads(mesh)
    for k in range(3):
        loads = loads.hold((z == 0.0) | (z == z.max()), k)
    return make_part(mesh, load_material("dragonskin_10"), loads.hold(z == z.max(), 2, z.max()))
