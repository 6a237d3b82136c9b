"""Serial lines: set points and readings a second over paced lines.

The emulator paces the bytes at the baud rate, in a process of its own; the driver runs in this one, called at
200 Hz as by the regulator node.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.options import Options
from benchmarks.report import met, table
from soro_hardware import load_platform, open_regulator

TITLE = "Serial regulators"
PERIOD_S = 0.005
# How long an exchange waits, and how long the devices take before they answer: 1 ms is what the emulators
# assume, without it only the bytes take time.
WAITS_S = ((0.0, 0.001), (0.002, 0.001), (0.0045, 0.001), (0.0045, 0.0))
NEAR = 0.9  # "about" as much
_PATIENT = {"answer_timeout_s": 0.2, "silent_after": 10, "stale_s": 5.0}


@dataclass(frozen=True)
class Case:
    """One platform."""

    name: str
    keys: dict[str, Any]
    lines: int
    stated_hz: float  # exchanges a second on a line, as measured without a driver
    messages: int = 1  # that an exchange takes: set point and reading, each answered


def _itv(n: int) -> dict[str, Any]:
    valves = [{"chamber": f"link0/chamber{k}"} for k in range(n)]
    return {"family": "itv_rs232", "full_scale_pa": 100e3, "valves": valves}


def _alicat(n: int, **keys: Any) -> dict[str, Any]:
    valves = [{"chamber": f"link0/chamber{k}", "unit": chr(65 + k)} for k in range(n)]
    return {"family": "alicat", "valves": valves, **keys}


CASES = (
    Case("ITV, 3 ports at 9600", _itv(3), 3, 43.0, 2),
    Case("ITV, 12 ports at 9600", _itv(12), 12, 43.0, 2),
    Case("Alicat, 12 units at 19200, S", _alicat(12, baud=19200, setpoint_command="S"), 1, 72.0),
    Case("Alicat, 12 units at 115200, S", _alicat(12, baud=115200, setpoint_command="S"), 1, 372.0),
    Case("Alicat, 12 units at 115200, LS", _alicat(12, baud=115200), 1, 186.0, 2),
)


def run(options: Options) -> str:
    """Measure; the section's text."""
    long, short = options.pick((20.0, 6.0), (1.0, 0.5))
    rows = []
    for case in CASES[:1] if options.quick else CASES:
        for budget_s, answer_s in options.pick(WAITS_S, WAITS_S[2:]):
            options.say(f"{case.name}, waiting {budget_s * 1e3:g} ms")
            rows.append(_rates(case, budget_s, answer_s, short if answer_s else long))
    head = (
        "platform",
        "exchange waits",
        "devices take",
        "asked, Hz",
        "exchanges, Hz",
        "set points, Hz",
        "readings, Hz",
        "target",
        "exchange p50 / p99 ms",
        "driver CPU",
        "lost",
    )
    return (
        f"{long:g} s (devices that take no time) or {short:g} s each, exchanges with the driver at 200 Hz, "
        "set points moving all the time (sine, 20 kPa, 1 Hz). *Asked*: exchanges with a chamber, a set point "
        "and a reading (Alicat with S: one message), that its line allows when only the bytes take time; "
        "what the devices take before each answer comes on top. *Exchanges*: answers, two of them one "
        "exchange where it takes two messages. Some are the question whether a device still has its set "
        "point, which one that has restarted has not; so set points are fewer. A driver that waits sends "
        f"the next question at once; met from {100 * NEAR:g} %, where it waits for 4.5 of its 5 ms and the "
        "devices take no time.\n\n" + table(head, rows)
    )


def _rates(case: Case, budget_s: float, answer_s: float, seconds: float) -> list[str]:
    with _served(case, budget_s, answer_s) as (path, device, _):
        platform = load_platform(path)
        regulator = open_regulator(platform, device)
        regulator.configure()
        phases = np.arange(regulator.n_chambers)
        setpoints, readings = np.zeros(len(phases)), np.zeros(len(phases))
        latencies: list[float] = []
        before, cpu = regulator.statistics, time.process_time()
        start = due = time.monotonic()
        sent = regulator.exchange(np.full(len(phases), 40e3), time.monotonic_ns()).sent_pa
        while (now := time.monotonic()) < start + seconds:
            setpoint = 40e3 + 20e3 * np.sin(2 * np.pi * (now - start) + phases)
            result = regulator.exchange(setpoint, time.monotonic_ns())
            latencies.append(time.monotonic() - now)
            setpoints += result.sent_pa != sent
            readings += result.fresh
            sent = result.sent_pa
            due = max(due + PERIOD_S, time.monotonic())
            time.sleep(max(due - time.monotonic(), 0.0))
        cpu = time.process_time() - cpu
        after = regulator.statistics
        regulator.close()
    asked = case.stated_hz * case.lines / len(phases)
    answers = after.frames_received - before.frames_received
    reached = answers / case.messages / len(phases) / seconds
    p50, p99 = (f"{np.percentile(latencies, q) * 1e3:.1f}" for q in (50, 99))
    return [
        case.name,
        f"{budget_s * 1e3:g} ms",
        f"{answer_s * 1e3:g} ms",
        f"{asked:.1f}",
        f"{reached:.1f}",
        f"{setpoints.mean() / seconds:.1f}",
        f"{readings.mean() / seconds:.1f}",
        "-" if answer_s else met(reached >= NEAR * asked),
        f"{p50} / {p99}",
        f"{cpu / seconds:.0%}",
        f"{after.frames_lost - before.frames_lost}",
    ]


@contextlib.contextmanager
def _served(case: Case, budget_s: float, answer_s: float) -> Iterator[tuple[str, str, str]]:
    """Platform file, device and plant link of an emulator in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="soro-") as name:
        folder = Path(name)
        path, device, plant = folder / "platform.yaml", folder / "device", folder / "plant"
        air = {"hysteresis_pa": 0.0, "reading_noise_pa": 0.0, "command_resolution_pa": 0.0}
        common = {
            "range": {"maximum_pa": 90e3},
            "cycle_hz": 200.0,
            "cycle_budget_s": budget_s,
            "line": _PATIENT,
            "regulator": air,
            "emulation": {"answer_delay_s": answer_s},
        }
        path.write_text(yaml.safe_dump({**common, **case.keys}))
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "soro_hardware.emulation", str(path)),
                *("--device-link", str(device), "--plant-link", str(plant)),
            ],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert process.stdout is not None
            process.stdout.readline()
            yield str(path), str(device), str(plant)
        finally:
            process.terminate()
            process.wait()
            if process.stdout is not None:
                process.stdout.close()
