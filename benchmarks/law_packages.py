"""The laws of the example packages beside `composite`: tip error, and CPU time of a tick."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.options import Options
from benchmarks.report import table
from soro_core.control.laws import find_law
from soro_core.errors import SoroError
from soro_core.robot import Robot
from tests.law_packages import FOLDERS, paths_of
from tests.soro_core.loop.loop_harness import Setup
from tests.soro_core.loop.loop_harness import run as run_loop

if TYPE_CHECKING:
    from benchmarks.control import Case

NAMES = (
    "default, 20 g",
    "0 g",
    "40 g",
    "stiffness 0.7",
    "tau 104 ms, delay 10 ms",
    "circle in 2 s",
    "set points",
)


@contextmanager
def importable() -> Iterator[None]:
    """Find the packages of examples/ as if they were installed."""
    before = list(sys.path)
    with TemporaryDirectory() as folder:
        for law in FOLDERS:
            sys.path += paths_of(law, Path(folder) / law)
        try:
            yield
        finally:
            sys.path[:] = before


def run(
    robot: Robot,
    options: Options,
    cases: Sequence[Case],
    setup_of: Callable[[Case, str, int, bool], Setup],
) -> str:
    """Measure and return text and table.

    Parameters
    ----------
    robot : Robot
        As the loop knows it.
    options : Options
        Number of seeds.
    cases : sequence of Case
        Of the section.
    setup_of : callable
        Gives the setup of case, law and seed, and whether a short run suffices.
    """
    chosen = options.pick([case for case in cases if case.name in NAMES], cases[:1])
    seeds, rows, absent = range(1, options.pick(options.seeds, 1) + 1), [], []
    with importable():
        for law in ("composite", *FOLDERS):
            try:
                find_law(law)
            except ValueError as error:
                absent.append(f"`{law}` is not measured: {str(error).partition('; ')[2]}.")
                continue
            for case in chosen:
                found = []
                for seed in seeds:
                    options.say(f"{law}, {case.name}, seed {seed}")
                    try:
                        found.append(run_loop(robot, setup_of(case, law, seed, options.quick)))
                    except (SoroError, AssertionError):  # the plant of a lost arm has no step any more
                        break
                row = ["lost", "-", "-", "-", "-"]
                if len(found) == len(seeds):
                    cpu = np.concatenate([record.cpu_us for record in found])
                    row = [
                        f"{np.mean([1e3 * case.figure(record) for record in found]):.3f}",
                        f"{np.mean([1e3 * record.peak() for record in found]):.2f}",
                        f"{1e-3 * np.mean([record.command_rate() for record in found]):.0f}",
                        f"{1e-3 * np.median(cpu):.2f}",
                        f"{1e-3 * np.quantile(cpu, 0.99):.2f}",
                    ]
                rows.append([law, case.name, *row])
    figures = ("RMS, mm", "largest after 3 s, mm", "rate, kPa/s", "tick median, ms", "tick p99, ms")
    text = (
        f"Laws of the packages in `examples/`, the loop as before, seeds {', '.join(map(str, seeds))}. Tick: "
        "CPU time of estimator and controller on one core; 200 Hz leave 5 ms."
    )
    return "\n\n".join(["### Laws of other packages", text, table(["law", "case", *figures], rows), *absent])
