"""Rates of the CANopen driver over the paced bus, against `soro emulate` in a process of its own."""

from __future__ import annotations

import contextlib
import os
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
from benchmarks.report import figure, met, table
from soro_hardware import Regulator, load_platform, open_regulator
from soro_hardware.canopen.budget import cycle_bits, highest_rate_hz
from soro_hardware.canopen.config import CanopenPlatform

TITLE = "CANopen over the paced bus"
CPU_SHARE = 0.25


@dataclass(frozen=True)
class Layout:
    """Twelve chambers on some kind of node, and the rate to reach."""

    name: str
    device: str
    channels: int
    rate_hz: float


LAYOUTS = (
    Layout("12 nodes of one valve", "cia408", 1, 250.0),
    Layout("3 nodes of four valves", "cia408_4ch", 4, 500.0),
)
CHAMBERS = 12


@dataclass(frozen=True)
class Measured:
    """What a run has shown."""

    cycles: int
    lost: int
    faults: int
    seconds: float
    cpu_share: float
    p50_ms: float
    p99_ms: float

    @property
    def rate_hz(self) -> float:
        """Cycles per second of wall time."""
        return self.cycles / self.seconds


def platform(layout: Layout) -> dict[str, Any]:
    """Platform file of a layout; patient, since the machine may be shared with others."""
    valves = [
        {
            "chamber": f"link{n // 3}/chamber{n % 3}",
            "node": n // layout.channels + 1,
            "channel": n % layout.channels,
        }
        for n in range(CHAMBERS)
    ]
    return {
        "family": "canopen_408",
        "transport": {"kind": "slcan", "bitrate": 1_000_000},
        "valves": valves,
        "range": {"minimum_pa": 0.0, "maximum_pa": 90e3},
        "cycle_hz": layout.rate_hz,
        "cycle_budget_s": 0.1,
        "canopen": {
            "mapping": {"device": layout.device},
            "sdo_timeout_s": 5.0,
            "boot_timeout_s": 60.0,
            "activation_timeout_s": 5.0,
            "heartbeat_consumer_s": 1.0,
            "rpdo_deadline_s": 0.5,
            "stale_cycles": 100,
            "stale_s": 0.5,
        },
        "regulator": {"maximum_pa": 90e3},
    }


@contextlib.contextmanager
def driven(layout: Layout) -> Iterator[tuple[Regulator, CanopenPlatform]]:
    """A configured driver on an emulator that has the other cores."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "platform.yaml")
        path.write_text(yaml.safe_dump(platform(layout)))
        process = subprocess.Popen(
            [sys.executable, "-m", "soro_hardware.emulation", str(path)],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            apart(process.pid)
            assert process.stdout is not None
            address = process.stdout.readline().strip().removeprefix("ready: ")
            loaded = load_platform(str(path))
            assert isinstance(loaded, CanopenPlatform)
            with contextlib.closing(open_regulator(loaded, address)) as regulator:
                regulator.configure()
                yield regulator, loaded
        finally:
            process.terminate()
            process.wait(10)
            if process.stdout is not None:
                process.stdout.close()


def apart(pid: int) -> None:
    """Let a process have the cores that this one does not."""
    if hasattr(os, "sched_setaffinity"):
        others = set(range(os.cpu_count() or 1)) - os.sched_getaffinity(0)
        os.sched_setaffinity(pid, others or os.sched_getaffinity(0))


def exchange(regulator: Regulator, cycles: int, rate_hz: float | None) -> Measured:
    """Run cycles, each due at its own time and made up when late; without a rate, back to back."""
    setpoints = 30e3 + 20e3 * np.sin(np.linspace(0, 2 * np.pi, cycles)[:, None] + np.arange(CHAMBERS))
    took = np.empty(cycles)
    faults = 0
    before = regulator.statistics
    wall, cpu = time.perf_counter(), time.process_time()
    for cycle in range(cycles):
        if rate_hz is not None:
            wait_until(wall + cycle / rate_hz)
        start = time.perf_counter()
        faults += bool(regulator.exchange(setpoints[cycle], time.monotonic_ns()).faults)
        took[cycle] = time.perf_counter() - start
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    after = regulator.statistics
    p50, p99 = 1e3 * np.percentile(took, (50, 99))
    lost = after.frames_lost - before.frames_lost
    return Measured(after.cycles - before.cycles, lost, faults, wall, cpu / wall, p50, p99)


def wait_until(due: float) -> None:
    """Sleep to a time of `perf_counter`."""
    left = due - time.perf_counter()
    if left > 0:
        time.sleep(left)


def run(options: Options) -> str:
    """Measure and write."""
    seconds = options.pick(60.0, 0.1)
    rows, limits = [], []
    for layout in LAYOUTS:
        with driven(layout) as (regulator, loaded):
            exchange(regulator, options.pick(200, 10), layout.rate_hz)  # caches, scheduler, bus
            options.say(f"{layout.name}, {layout.rate_hz:g} Hz for {seconds:g} s")
            rows.append(
                row(layout, exchange(regulator, round(seconds * layout.rate_hz), layout.rate_hz), loaded)
            )
            options.say(f"{layout.name}, as fast as the bus carries it")
            limits.append(limit(layout, exchange(regulator, options.pick(4000, 20), None), loaded))
    head = ["layout", "asked, Hz", "cycles", "lost answers", "cycles with a fault", "made, Hz"]
    head += ["bus in use", "cycle p50, ms", "p99, ms", "driver CPU"]
    return "\n\n".join(
        [
            f"Twelve chambers over slcan on a pseudo-terminal at 1 Mbit/s for {seconds:g} s; the devices run "
            "in `soro emulate`, which gives every frame the time of its bits with worst-case stuffing. A "
            "cycle that is late is made up; an answer is lost when it has not come within the cycle's time.",
            table(head, rows),
            "Back to back, as fast as the bus carries it:",
            table(["layout", "bits a cycle", "bus allows, Hz", "made, Hz", "not above"], limits),
        ]
    )


def row(layout: Layout, found: Measured, loaded: CanopenPlatform) -> list[object]:
    """Row at the rate to reach."""
    use = layout.rate_hz / highest_rate_hz(loaded)
    share = f"{100 * found.cpu_share:.0f} %"
    if layout.rate_hz == 500.0:
        share += f", at most {100 * CPU_SHARE:.0f} % ({met(found.cpu_share <= CPU_SHARE)})"
    return [
        layout.name,
        f"{layout.rate_hz:g}",
        found.cycles,
        f"{found.lost} ({met(found.lost == 0)})",
        found.faults,
        f"{figure(found.rate_hz, 4)} ({met(found.rate_hz >= 0.999 * layout.rate_hz)})",
        f"{100 * use:.0f} %",
        figure(found.p50_ms),
        figure(found.p99_ms),
        share,
    ]


def limit(layout: Layout, found: Measured, loaded: CanopenPlatform) -> list[object]:
    """Row of the fastest rate."""
    highest = highest_rate_hz(loaded)
    return [
        layout.name,
        cycle_bits(loaded),
        figure(highest, 4),
        figure(found.rate_hz, 4),
        met(found.rate_hz <= highest),
    ]
