"""The composed process from within: ``python -m benchmarks.composed_process SECONDS FIRST --ros-args ...``.

A cycle begins when its tick is due, and its work has ended when the limiter has the command that answers the
readings of this tick: by then twin, estimator and controller have run. It is in time if that is before the
next tick is due. A tick that was skipped, or whose command never came, is not.
"""

from __future__ import annotations

import functools
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from soro_core.control import Controller
from soro_core.estimation import Estimator
from soro_core.safety import Limiter
from soro_core.twin import Twin, TwinConfig
from soro_ros.nodes.arm import PROGRAM
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.nodes.twin import TwinNode
from soro_ros.process.node_process import run_nodes

# What the work of a cycle is counted as; all else is Python's messages, the executor and the middleware.
PARTS = {
    "controller": ((Controller, "step"),),
    "estimator": ((Estimator, "step"),),
    "twin": ((Twin, "observe"), (Twin, "step_setpoints")),
    "limiter": ((Limiter, "slew"), (Limiter, "judge"), (Limiter, "offer")),
}


class MeasuredTwin(TwinNode):
    """The twin, which notes when each of its ticks begins and when its command has come."""

    seconds, first_s = 1.0, 0.0
    """Time that counts, and the time before it [s]."""

    def setup(self, config: TwinConfig) -> None:
        super().setup(config)
        count = round(self.seconds * config.rate_hz)
        self._first_tick = round(self.first_s * config.rate_hz)
        self._begins, self._ends = np.full(count, np.nan), np.full(count, np.nan)
        self._start: tuple[float, float, float] | None = None
        self._parts_s = dict.fromkeys(PARTS, 0.0)
        for part, methods in PARTS.items():
            for owner, name in methods:
                self._time(part, owner, name)

    def _time(self, part: str, owner: type[Any], name: str) -> None:
        """Add the CPU time of the calls of a method to a part."""
        method = getattr(owner, name)

        @functools.wraps(method)
        def timed(*arguments: Any, **options: Any) -> Any:
            begin = time.thread_time()
            result = method(*arguments, **options)
            self._parts_s[part] += time.thread_time() - begin
            return result

        setattr(owner, name, timed)

    def _observe(self) -> None:
        k = self.state.tick + self._skipped - self._first_tick
        if k >= 0 and self._start is None:
            self._start = time.process_time(), time.perf_counter(), _busy_s()
            self._parts_s = dict.fromkeys(PARTS, 0.0)
        if 0 <= k < len(self._begins):
            self._begins[k] = time.perf_counter()
        elif k >= len(self._begins) + 5 and not self.finished:  # the last command has had its time
            self._report()
            self.finish()
        super()._observe()

    def _advance_with_commands(self) -> None:
        """Note the time of the command that has come; there is nothing else to do in real time."""
        k = round((self._chambers.seen_ns - self._epoch_ns) / self._period_ns) - self._first_tick
        if 0 <= k < len(self._ends) and np.isnan(self._ends[k]):
            self._ends[k] = time.perf_counter()

    def _report(self) -> None:
        assert self._start is not None
        now = time.process_time(), time.perf_counter(), _busy_s()
        cpu_s, wall_s, busy_s = (end - begin for begin, end in zip(self._start, now, strict=True))
        period_s = self._period_ns * 1e-9
        # The twin makes a tick when its period is over.
        due = self._start_s + (self._first_tick + 1 + np.arange(len(self._begins))) * period_s
        took, late = self._ends - due, self._begins - due
        ran = int(np.isfinite(late).sum())
        found = {
            "cycles": len(due),
            "in_time": int(np.sum(took < period_s)),
            "unanswered": int(np.isnan(took).sum()),
            "cpu_share": cpu_s / wall_s,
            "cycle_us": 1e6 * cpu_s / ran,
            "parts_us": {part: 1e6 * spent / ran for part, spent in self._parts_s.items()},
            "others_share": max(busy_s - cpu_s, 0.0) / wall_s / (os.cpu_count() or 1),
            "end_ms": percentiles_ms(took),
            "begin_ms": percentiles_ms(late),
            "vented": self._limiter.cause or "",
        }
        print(json.dumps(found), flush=True)


def percentiles_ms(seconds: np.ndarray) -> list[float]:
    """Median, 99th percentile and largest [ms] of those that are known."""
    known = seconds[np.isfinite(seconds)]
    return [float(1e3 * value) for value in np.percentile(known, (50, 99, 100))] if known.size else []


def _busy_s() -> float:
    """CPU time of all programs of the machine so far [s]; NaN where it is not known."""
    try:
        user, nice, system, _, _, irq, softirq, *_ = map(
            int, Path("/proc/stat").read_text().splitlines()[0].split()[1:]
        )
    except (OSError, ValueError):
        return float("nan")
    return (user + nice + system + irq + softirq) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Run until the cycles are over."""
    MeasuredTwin.seconds, MeasuredTwin.first_s = map(float, sys.argv[1:3])
    run_nodes((EstimatorNode, ControllerNode, MeasuredTwin), PROGRAM, sys.argv[3:])


if __name__ == "__main__":
    main()
