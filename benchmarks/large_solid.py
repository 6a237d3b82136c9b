"""One equilibrium of a solid of 54,872 elements, by each solver of large solids that is installed."""

from __future__ import annotations

import resource

from benchmarks.options import Options
from benchmarks.report import table
from benchmarks.solver import HEAD, by_solvers, pulled
from benchmarks.timing import all_cores

TITLE = "Large solid"


def run(options: Options) -> str:
    """Measure and write."""
    part = pulled(options.pick(38, 3))
    with all_cores():
        rows = by_solvers(options, "block pulled, hex8", part, ["pardiso", "multigrid"])
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    return f"{table(HEAD, rows)}\n\nMost memory of the process: {memory:.1f} GB."
