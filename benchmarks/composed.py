"""Twin, estimator and controller in one process, in real time: cycles in time, and what a cycle costs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.can_rates import wait_until
from benchmarks.composed_arm import parameter_file
from benchmarks.composed_process import percentiles_ms
from benchmarks.options import Options
from benchmarks.report import figure, met, table
from benchmarks.timing import all_cores
from soro_hardware.timing import punctual

TITLE = "The loop in one process, in real time"
DOMAIN = "59"
# Rates to reach [1/s], and lower ones that say how far it is.
RATES_HZ = (1000.0, 500.0)
LOWER_HZ = (300.0, 250.0, 200.0, 150.0, 100.0)
IN_TIME, CPU_SHARE, CPU_RATE_HZ = 0.995, 0.60, 500.0
# Time until the cycles count [s]: the transition to the circle, and what is learned first.
FIRST_S = 5.0
# A process that compiles and then takes longer to start has failed [s].
START_S = 240.0
# As that of the loop: the bare one has the same right to the processor.
_PRIORITY = 20
# Terms of the sum that is its work: some 0.1 ms.
_WORK = 2000


def run(options: Options) -> str:
    """Measure and write."""
    seconds, first_s = options.pick((60.0, FIRST_S), (1.0, 0.2))
    rows, parts = [], {}
    with all_cores():
        for rate_hz in options.pick(RATES_HZ, (50.0,)):
            options.say(f"{rate_hz:g} Hz for {seconds:g} s")
            before = _bare(rate_hz, seconds / 4)
            found = _composed(rate_hz, seconds, first_s)
            bare = np.concatenate([before, _bare(rate_hz, seconds / 4)], axis=1)
            rows.append(_row(rate_hz, found, bare))
        for rate_hz in options.pick(LOWER_HZ, ()):
            options.say(f"{rate_hz:g} Hz for {seconds / 4:g} s")
            found = _composed(rate_hz, seconds / 4, first_s)
            rows.append(_row(rate_hz, found, None))
            if _in_time(found) >= IN_TIME:
                break
        parts = found
    head = ["rate, Hz", "cycles", "in time, %", "work ends after, ms", "CPU of a core", "CPU a cycle, ms"]
    head += ["begins late, ms", "bare loop in time, %", "bare loop late, ms", "its work, ms", "others"]
    head += ["at the end"]
    return "\n\n".join(
        [
            "`soro_arm` with two links, the law `composite` and a twin of twice as many links on a circle, "
            f"{seconds:g} s, without a recorder or a viewer. A cycle is in time if the limiter has the "
            "command that answers the readings of a tick before the next tick is due; a skipped tick counts "
            "as late. Times are median, 99th percentile and largest. The bare loop sleeps until each tick is "
            "due, for a quarter of the time before the run and after it, and then does the same small work "
            "each time: it shows how late the machine itself is, and how its speed varies. Others: the part "
            "of all cores that other programs took during the run.",
            table(head, rows),
            "What a cycle of the last line costs, by CPU time; the rest is messages in Python, executor and "
            "middleware:",
            table(["part", "us a cycle", "%"], _parts(parts)),
        ]
    )


def _composed(rate_hz: float, seconds: float, first_s: float) -> dict[str, Any]:
    """Run the process; return what it has printed."""
    environment = {**os.environ, "ROS_DOMAIN_ID": DOMAIN}
    with tempfile.TemporaryDirectory(prefix="soro-") as folder:
        parameters = parameter_file(Path(folder), rate_hz)
        command = [sys.executable, "-m", "benchmarks.composed_process", str(seconds), str(first_s)]
        # No other run of this section is heard.
        command += ["--ros-args", "-r", f"__ns:=/composed{os.getpid()}", "--params-file", str(parameters)]
        done = subprocess.run(
            command,
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
            check=True,
            timeout=seconds + first_s + START_S,
        )
    return dict(json.loads(done.stdout.splitlines()[-1]))


def _bare(rate_hz: float, seconds: float) -> np.ndarray:
    """Lateness, and time of the same small work (2, n) [s], of a loop that does nothing else."""
    found = np.empty((2, round(seconds * rate_hz)))
    with punctual(_PRIORITY):
        begin = time.perf_counter() + 0.1
        for k in range(found.shape[1]):
            wait_until(begin + k / rate_hz)
            woken = time.perf_counter()
            sum(one * one for one in range(_WORK))
            found[:, k] = woken - begin - k / rate_hz, time.perf_counter() - woken
    return found


def _in_time(found: dict[str, Any]) -> float:
    return float(found["in_time"] / found["cycles"])


def _row(rate_hz: float, found: dict[str, Any], bare: np.ndarray | None) -> list[object]:
    part = _in_time(found)
    goal, share = rate_hz in RATES_HZ, f"{100 * found['cpu_share']:.0f} %"
    in_time = f"{100 * part:.2f}" + (f", at least {100 * IN_TIME:g} ({met(part >= IN_TIME)})" if goal else "")
    if rate_hz == CPU_RATE_HZ:
        share += f", at most {100 * CPU_SHARE:.0f} % ({met(found['cpu_share'] <= CPU_SHARE)})"
    alone = ["-"] * 3
    if bare is not None:
        alone = [f"{100 * np.mean(bare[0] < 1.0 / rate_hz):.2f}", *(_listed(percentiles_ms(x)) for x in bare)]
    return [
        f"{rate_hz:g}",
        found["cycles"],
        in_time,
        _listed(found["end_ms"]),
        share,
        figure(found["cycle_us"] / 1e3),
        _listed(found["begin_ms"]),
        *alone,
        f"{100 * found['others_share']:.0f} %",
        f"vented: {found['vented']}" if found["vented"] else "in control",
    ]


def _parts(found: dict[str, Any]) -> list[list[object]]:
    whole, parts = found["cycle_us"], found["parts_us"]
    every = {**parts, "rest": whole - sum(parts.values()), "whole": whole}
    return [[name, f"{us:.0f}", f"{100 * us / whole:.0f}"] for name, us in every.items()]


def _listed(values: list[float]) -> str:
    return " / ".join(figure(value, 2) for value in values) or "-"
