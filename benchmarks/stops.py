"""Each process of the host stopped or killed in turn, in every state: what is left in the chambers.

The processes are the driver and, for families without a watchdog, the supervisor beside it. A stopped driver
is continued: from then on it must not command pressure. A stopped supervisor must not hold up the driver.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.kills import CASES, served
from benchmarks.options import Options
from benchmarks.report import met, table
from soro_hardware import load_platform
from soro_hardware.emulation.sockets.plant_link import PlantLinkClient
from soro_hardware.port import EMPTY_PA

TITLE = "Processes that are stopped or killed, in every state"
STATES = ("starting", "at 0 Pa", "under pressure", "tripped", "closing")
SIGNALS = (signal.SIGSTOP, signal.SIGKILL)
STOPPED_S, AFTER_S = 0.9, 0.6  # until a stopped process continues, and until the end
_PATIENCE_S = 30.0
_HOST = """
import sys, time
import numpy as np
from soro_core.config import with_changes
from soro_core.errors import HardwareError
from soro_hardware import load_platform, open_regulator

name, device, state = sys.argv[1:]
platform = with_changes(load_platform(name), shutdown_ramp_pa_s=20e3)
regulator = open_regulator(platform, device)
known, begin, slowest_s = "", 0.0, 0.0

def say(*words):
    print(*words, flush=True)

try:
    if state == "starting":
        say("now")
    regulator.configure()
    pressure_pa, cycles, is_there = 40e3 if state != "at 0 Pa" else 0.0, 0, False
    while True:
        begin = time.monotonic()
        found = regulator.exchange(np.full(regulator.n_chambers, pressure_pa), time.monotonic_ns())
        took_s, cycles = time.monotonic() - begin, cycles + 1
        codes = ",".join(sorted({fault.code for fault in found.faults if fault.latched}))
        if codes != known or took_s > slowest_s:
            known, slowest_s = codes, max(took_s, slowest_s)
            say("cycle", begin, took_s, codes)
        if not is_there and (found.pressure_pa.min() > 36e3 if pressure_pa else cycles > 20):
            is_there = True
            if state == "tripped":
                regulator.vent()
                pressure_pa = 0.0
            say("now")
            slowest_s = 0.0
            if state == "closing":
                break
        time.sleep(max(1 / platform.cycle_hz - took_s, 0.0))
    regulator.close()
    say("cycle", time.monotonic(), 0.0, ",".join(sorted({fault.code for fault in regulator.latched})))
except HardwareError as error:
    say("cycle", time.monotonic(), 0.0, "refused:", error)
"""


@dataclass
class Outcome:
    """What came of one signal.

    Attributes
    ----------
    pressures : list
        Time after the signal [s] and highest true pressure [Pa gauge] of all chambers.
    cycles : list
        What the driver said: time after the signal [s], duration of a call [s], latched faults.
    """

    pressures: list[tuple[float, float]] = field(default_factory=list)
    cycles: list[tuple[float, float, str]] = field(default_factory=list)

    def left_pa(self, from_s: float, to_s: float = math.inf) -> float:
        """Return the highest pressure [Pa gauge] between two times [s], with the last one before."""
        before = [pressure for at_s, pressure in self.pressures if at_s <= from_s]
        return max(before[-1:] + [pressure for at_s, pressure in self.pressures if from_s < at_s <= to_s])

    @property
    def empty_s(self) -> float:
        """Time [s] after which every chamber stayed empty."""
        return max((at_s for at_s, pressure in self.pressures if pressure > EMPTY_PA), default=0.0)

    @property
    def slowest_s(self) -> float:
        """Longest call [s] of the driver that began after the signal."""
        return max((took_s for at_s, took_s, _ in self.cycles if at_s > 0), default=0.0)

    @property
    def reported_s(self) -> float | None:
        """Time [s] of the first latched fault, or None."""
        return next((at_s + took_s for at_s, took_s, codes in self.cycles if codes and at_s > 0), None)


def run(options: Options) -> str:
    """Signal, measure and write."""
    rows = []
    for name in list(CASES)[: options.pick(len(CASES), 1)]:
        for process in ("driver", "supervisor") if is_supervised(name) else ("driver",):
            for number in SIGNALS[: options.pick(2, 1)]:
                options.say(f"{name}: {process}, {number.name}")
                states = STATES if not options.quick else STATES[2:3]
                rows.append(
                    _row(name, process, number, {s: signalled(name, process, number, s) for s in states})
                )
    columns = ("platform", "process", "signal", *(f"{s}: empty after, ms" for s in STATES[1:]))
    head = (*columns, "fault after, ms", "longest call, ms", "left, kPa", "target")
    return "\n\n".join(
        [
            f"SIGSTOP lasts {STOPPED_S:g} s, then the process continues. Times count from the signal. "
            f"'Empty' is below {EMPTY_PA / 1e3:g} kPa for good. The arm is at 40 kPa; 'closing' is in "
            "the midst of a ramp of 20 kPa/s; a driver that is starting commands 40 kPa afterwards. "
            "'Fault after' and 'longest call' are what the driver says, the largest of all states. "
            f"'Left' is the highest pressure in the {AFTER_S:g} s after the stop, of all states "
            "(starting: in its last 0.3 s). Target: nothing left, and no call longer than 50 ms after "
            "a signal to the supervisor.",
            table(head, rows),
            *two_faults(options),
        ]
    )


def two_faults(options: Options) -> list[str]:
    """Kill driver and supervisor at once, under pressure: what relief valve and dump valve are for."""
    rows = []
    for name in filter(is_supervised, CASES if not options.quick else ()):
        options.say(f"{name}: driver and supervisor, SIGKILL")
        outcome = signalled(name, "both", signal.SIGKILL, "under pressure")
        rows.append([name, f"{left_after(outcome, 'under pressure') / 1e3:.1f}"])
    text = f"Driver and supervisor killed at once under pressure: what is left after {STOPPED_S:g} s."
    return [text, table(("platform", "left, kPa"), rows)] if rows else []


def left_after(outcome: Outcome, state: str) -> float:
    """Return the highest pressure [Pa gauge] from the end of the stop on.

    A driver that was stopped while it started may work afterwards: there, before the end of the stop.
    """
    if state == "starting":
        return outcome.left_pa(STOPPED_S - 0.3, STOPPED_S)
    return outcome.left_pa(STOPPED_S)


def is_supervised(name: str) -> bool:
    """Whether a platform has a process beside its driver."""
    return load_platform(name).is_supervised


def signalled(name: str, process: str, number: signal.Signals, state: str) -> Outcome:
    """Send a signal to the driver, its supervisor or both in a state; `name` is that of a platform."""
    with served(name) as emulator, _host(name, emulator.device, state) as host:
        _await_now(host)
        link = PlantLinkClient(emulator.plant)  # not before: old frames would wait to be read
        try:
            pids = [] if process == "driver" else [_supervisor_of(host)]
            pids += [] if process == "supervisor" else [host.pid]
            if process == "driver" and state in ("starting", "closing"):
                time.sleep(0.05)  # in its midst
            began_s, outcome = time.monotonic(), Outcome()
            for pid in pids:
                os.kill(pid, number)
            _watch(link, began_s, STOPPED_S, outcome)
            if number == signal.SIGSTOP:
                for pid in pids:
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGCONT)
            _watch(link, began_s, STOPPED_S + AFTER_S, outcome)
            outcome.cycles = _said(host, began_s)
        finally:
            link.close()
    return outcome


@contextlib.contextmanager
def _host(name: str, device: str, state: str) -> Iterator[subprocess.Popen[bytes]]:
    arguments = [sys.executable, "-c", _HOST, name, device, state]
    host = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    try:
        yield host
    finally:
        host.kill()
        host.wait()
        if host.stdout is not None:
            host.stdout.close()


def _await_now(host: subprocess.Popen[bytes]) -> None:
    assert host.stdout is not None
    end_s, text = time.monotonic() + _PATIENCE_S, b""
    while b"now\n" not in text:
        left_s = end_s - time.monotonic()
        if left_s <= 0 or not select.select([host.stdout], [], [], left_s)[0]:
            raise RuntimeError(f"the driver does not get there: {text.decode()}")
        chunk = os.read(host.stdout.fileno(), 4096)
        if not chunk:
            raise RuntimeError(f"the driver has ended by itself: {text.decode()}")
        text += chunk


def _supervisor_of(host: subprocess.Popen[bytes]) -> int:
    """Wait for the supervisor of a driver; its process id."""
    end_s = time.monotonic() + _PATIENCE_S
    while time.monotonic() < end_s:
        for pid in Path(f"/proc/{host.pid}/task/{host.pid}/children").read_text().split():
            with contextlib.suppress(OSError):
                if b"supervisor.py" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    return int(pid)
    raise RuntimeError("the driver has no supervisor")


def _watch(link: PlantLinkClient, began_s: float, until_s: float, outcome: Outcome) -> None:
    while (at_s := time.monotonic() - began_s) < until_s:
        outcome.pressures.append((at_s, float(link.receive(_PATIENCE_S).pressures.max())))


def _said(host: subprocess.Popen[bytes], began_s: float) -> list[tuple[float, float, str]]:
    """Return what the driver has said since it was there, with times after the signal [s]."""
    assert host.stdout is not None
    text = b""
    while select.select([host.stdout], [], [], 0.0)[0] and (chunk := os.read(host.stdout.fileno(), 65536)):
        text += chunk
    words = [line.split(maxsplit=3) for line in text.decode().splitlines() if line.startswith("cycle ")]
    return [(float(w[1]) - began_s, float(w[2]), w[3] if len(w) > 3 else "") for w in words]


def _row(name: str, process: str, number: signal.Signals, found: dict[str, Outcome]) -> list[object]:
    reported = [outcome.reported_s for outcome in found.values() if outcome.reported_s is not None]
    slowest_s = max(outcome.slowest_s for outcome in found.values())
    left_pa = max(left_after(outcome, state) for state, outcome in found.items())
    waits = process == "supervisor" and slowest_s > 0.05
    return [
        name,
        process,
        number.name,
        *(f"{1e3 * found[state].empty_s:.0f}" if state in found else "-" for state in STATES[1:]),
        f"{1e3 * max(reported):.0f}" if reported else "-",
        f"{1e3 * slowest_s:.0f}" if process == "supervisor" else "-",
        f"{left_pa / 1e3:.1f}",
        met(left_pa < EMPTY_PA and not waits),
    ]
