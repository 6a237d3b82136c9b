"""Serial lines: set points and readings a second over paced lines, and the vent after the driver's death.

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
from soro_core.hardware import load_platform, open_regulator
from soro_core.hardware.plant_link import PlantLinkClient

TITLE = "Serial regulators"
VENT_MS = 300.0
PERIOD_S = 0.005
_DRIVER = """
import sys, time
import numpy as np
from soro_core.hardware import load_platform, open_regulator
platform = load_platform(sys.argv[1])
regulator = open_regulator(platform, sys.argv[2])
regulator.configure()
while True:
    regulator.exchange(np.full(regulator.n_chambers, 40e3), time.monotonic_ns())
    time.sleep(0.004)
"""
_PATIENT = {"answer_timeout_s": 0.2, "silent_after": 10, "stale_s": 5.0}


@dataclass(frozen=True)
class Case:
    """One platform."""

    name: str
    keys: dict[str, Any]
    lines: int
    stated_hz: float  # exchanges a second on a line, as measured without a driver (hardware.md 4.3)


def _itv(n: int) -> dict[str, Any]:
    valves = [{"chamber": f"link0/chamber{k}"} for k in range(n)]
    return {"family": "itv_rs232", "full_scale_pa": 100e3, "valves": valves}


def _alicat(n: int, **keys: Any) -> dict[str, Any]:
    valves = [{"chamber": f"link0/chamber{k}", "unit": chr(65 + k)} for k in range(n)]
    return {"family": "alicat", "valves": valves, **keys}


CASES = (
    Case("ITV, 3 ports at 9600", _itv(3), 3, 43.0),
    Case("ITV, 12 ports at 9600", _itv(12), 12, 43.0),
    Case("Alicat, 12 units at 19200, S", _alicat(12, baud=19200, setpoint_command="S"), 1, 72.0),
    Case("Alicat, 12 units at 115200, S", _alicat(12, baud=115200, setpoint_command="S"), 1, 372.0),
    Case("Alicat, 12 units at 115200, LS", _alicat(12, baud=115200), 1, 186.0),
)


def run(options: Options) -> str:
    """Measure; the section's text."""
    seconds, kills = (1.0, 1) if options.quick else (10.0, 10)
    rows = []
    for case in CASES[:1] if options.quick else CASES:
        for budget_s in (0.0, 0.002, 0.0045):
            options.say(f"{case.name}, waiting {budget_s * 1e3:g} ms")
            rows.append(_rates(case, budget_s, seconds))
    kill_rows = []
    for case in (CASES[0],) if options.quick else (CASES[0], CASES[3], CASES[2]):
        options.say(f"{case.name}: kills")
        kill_rows.append(_kills(case, kills))
    head = (
        "platform",
        "exchange waits",
        "set points/s",
        "readings/s",
        "messages/s a line",
        "line alone",
        "exchange p50 / p99 ms",
        "driver CPU",
        "lost",
    )
    return (
        f"{seconds:g} s each, exchanges at 200 Hz, set points moving all the time (sine, 20 kPa, 1 Hz). "
        "Set points and readings are those of one chamber. *Line alone*: pairs of set point and reading a "
        "second on a line (Alicat with S: one message) when nothing but its bytes takes time.\n\n"
        + table(head, rows)
        + "\n\nDriver killed (SIGKILL) at 40 kPa: time until the last chamber has begun to vent, the valve's "
        "own delay of 5 ms within.\n\n"
        + table(("platform", "kills", "median ms", "slowest ms", f"at most {VENT_MS:g} ms"), kill_rows)
    )


def _rates(case: Case, budget_s: float, seconds: float) -> list[str]:
    with _served(case, budget_s) as (path, device, _):
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
    messages = (after.frames_received - before.frames_received) / seconds
    p50, p99 = (f"{np.percentile(latencies, q) * 1e3:.1f}" for q in (50, 99))
    return [
        case.name,
        f"{budget_s * 1e3:g} ms",
        f"{setpoints.mean() / seconds:.1f}",
        f"{readings.mean() / seconds:.1f}",
        f"{messages / case.lines:.0f}",
        f"{case.stated_hz:g}",
        f"{p50} / {p99}",
        f"{cpu / seconds:.0%}",
        f"{after.frames_lost - before.frames_lost}",
    ]


def _kills(case: Case, kills: int) -> list[str]:
    times = []
    for _ in range(kills):
        with _served(case, 0.002) as (path, device, plant):
            host = subprocess.Popen([sys.executable, "-c", _DRIVER, path, device])
            link = PlantLinkClient(plant)
            try:
                while link.receive(30.0).pressures.min() < 39e3:
                    if host.poll() is not None:
                        raise RuntimeError(f"{case.name}: the driver has ended by itself")
                while link.wait(0.0) is not None:
                    pass
                killed = time.monotonic()
            finally:
                host.kill()
                host.wait()
            while link.receive(30.0).pressures.max() > 38.5e3:
                pass
            times.append((time.monotonic() - killed) * 1e3)
            link.close()
    slowest = max(times)
    return [
        case.name,
        f"{kills}",
        f"{np.median(times):.0f}",
        f"{slowest:.0f}",
        met(slowest <= VENT_MS),
    ]


@contextlib.contextmanager
def _served(case: Case, budget_s: float) -> Iterator[tuple[str, str, str]]:
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
            "emulation": {"regulator": air},
        }
        path.write_text(yaml.safe_dump({**common, **case.keys}))
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "soro_core.hardware.emulation", str(path)),
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
