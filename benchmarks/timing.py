"""Timing on one core, in turns, so that a change of the machine's speed meets all that are compared."""

from __future__ import annotations

import contextlib
import os
import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """Run on one core: no library can use a second one, and no run moves between cores."""
    with _on({max(os.sched_getaffinity(0))} if hasattr(os, "sched_getaffinity") else set()):
        yield


@contextlib.contextmanager
def all_cores() -> Iterator[None]:
    """Run on all cores, in a section of programs that a user starts as they are."""
    with _on(set(range(os.cpu_count() or 1))):
        yield


@contextlib.contextmanager
def _on(cores: set[int]) -> Iterator[None]:
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


class Clock:
    """Stop watch that knows how much of the core it had."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget."""
        self.wall = 0.0
        self.cpu = 0.0

    def time(self, call: Callable[[], object]) -> float:
        """Seconds of one call: wall time, or the process's CPU time where others took the core from it."""
        wall, cpu = time.perf_counter(), time.process_time()
        call()
        cpu = time.process_time() - cpu
        wall = time.perf_counter() - wall
        self.wall += wall
        self.cpu += min(cpu, wall)
        return min(wall, cpu)

    @property
    def share(self) -> float | None:
        """Part of the core that the timed calls had, well below 1 on a busy machine; None without a call."""
        return self.cpu / self.wall if self.wall else None


CLOCK = Clock()


def per_call(
    runs: Mapping[str, Callable[[int], object]], repeats: int = 9, sample_s: float = 0.02
) -> dict[str, float]:
    """Median seconds per call of each, measured in turns.

    Parameters
    ----------
    runs : mapping of name to run(n)
        Each makes n calls.
    repeats : int
        Samples of each.
    sample_s : float
        Least length of a sample [s]; the number of calls follows from it.
    """
    counts = {}
    for name, run in runs.items():
        run(1)
        counts[name] = max(1, round(sample_s / max(CLOCK.time(partial(run, 1)), 1e-9)))
        # One call says little when it is short: count again on a longer sample.
        first = CLOCK.time(partial(run, counts[name])) / counts[name]
        counts[name] = max(1, round(sample_s / max(first, 1e-9)))
    samples: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(repeats):
        for name, run in runs.items():
            samples[name].append(CLOCK.time(partial(run, counts[name])) / counts[name])
    return {name: statistics.median(values) for name, values in samples.items()}
