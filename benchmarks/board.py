"""Rate of `soro board` and of the published VEAB server at 12 ports."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.options import Options
from benchmarks.report import figure, met, table
from soro_hardware import Regulator, load_platform, open_regulator
from soro_hardware.platform import PlatformBase

TITLE = "Boards of 12 ports over TCP"
# Of the cycles, and of the readings in them, that must be there; both sides keep their own time.
NEAR = 0.995
_TICKS = os.sysconf("SC_CLK_TCK")
SERVERS = {
    "soro_board": ["-m", "benchmarks.board_server", "soro_board"],
    "veab_tcp": ["-m", "soro_hardware.emulation", "veab_tcp"],
}


def run(options: Options) -> str:
    """Measure and write."""
    rows = []
    for name in SERVERS:
        platform = load_platform(name).at_rate(250.0)
        options.say(name)
        with served(name) as (pid, address):
            regulator = open_regulator(platform, address)
            try:
                regulator.configure()
                if name == "soro_board":
                    rows.append(measure(regulator, platform, pid, options.pick(4.0, 0.3), False))
                rows.append(measure(regulator, platform, pid, options.pick(60.0, 0.5), True))
            finally:
                regulator.close()
    head = [
        "server",
        "asked, Hz",
        "cycles",
        "reached, Hz",
        "without fresh reading",
        "target",
        "exchange p50 / p99, ms",
        "CPU driver / server",
    ]
    return (
        "Driver and server in two processes over TCP on this machine. The chips of `soro board` are "
        "emulated, each transfer takes its time on the wire at 400 kHz, and the six buses work beside each "
        f"other. The published server pushes by itself.\n\n{table(head, rows)}"
    )


@contextlib.contextmanager
def served(name: str) -> Iterator[tuple[int, str]]:
    """Process id and address of a server."""
    process = subprocess.Popen([sys.executable, *SERVERS[name]], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = ""
        while not line.startswith("ready: "):
            line = process.stdout.readline()
        yield process.pid, line.removeprefix("ready: ").strip()
    finally:
        process.terminate()
        process.wait(10)
        if process.stdout is not None:
            process.stdout.close()


def measure(
    regulator: Regulator, platform: PlatformBase, pid: int, seconds: float, is_paced: bool
) -> list[object]:
    """Row of the table, at the platform's rate or as fast as answers come; a fault ends the measurement."""
    period_s = 1.0 / platform.cycle_hz if is_paced else 0.0
    title = f"{platform.family}, {f'{platform.cycle_hz:g} Hz' if is_paced else 'unpaced'}"
    asked = f"{platform.cycle_hz:g}" if is_paced else "-"
    took, silent = [], 0
    driver_s, server_s = time.process_time(), cpu_s(pid)
    start = due = time.perf_counter()
    while due < start + seconds:
        before = time.perf_counter()
        phase = 2 * np.pi * (before - start)
        setpoint = 40e3 + 20e3 * np.sin(phase + np.arange(regulator.n_chambers))
        result = regulator.exchange(setpoint, time.monotonic_ns())
        after = time.perf_counter()
        if any(fault.latched for fault in result.faults):
            ended = f"ended: {result.faults[0].message}"
            return [title, asked, len(took), ended, silent, met(False), "-", "-"]
        took.append(1e3 * (after - before))
        silent += not result.fresh.all()
        due = due + period_s if period_s else after
        if (left := due - after) > 0:
            time.sleep(left)
    wall = time.perf_counter() - start
    p50, p99 = np.percentile(took, [50, 99])
    shares = [(time.process_time() - driver_s) / wall, (cpu_s(pid) - server_s) / wall]
    reached = len(took) / wall
    good = reached >= NEAR * platform.cycle_hz and silent <= (1 - NEAR) * len(took)
    return [
        title,
        asked,
        len(took),
        figure(reached, 4),
        silent,
        met(good) if is_paced else "-",
        f"{figure(p50)} / {figure(p99)}",
        " / ".join(f"{100 * share:.0f} %" for share in shares),
    ]


def cpu_s(pid: int) -> float:
    """CPU time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(") ", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS
