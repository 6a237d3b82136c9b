"""Processes that are killed: the driver, so that the valves vent, or the devices, so that the driver latches.

Devices, driver and what watches over it are processes of their own here, on the clock of the machine.
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

import numpy as np

from benchmarks.can_rates import apart
from benchmarks.options import Options
from benchmarks.report import met, table
from soro_core.errors import HardwareError
from soro_hardware import Regulator, load_platform, open_regulator
from soro_hardware.emulation.sockets.plant_link import PlantLinkClient

TITLE = "Processes that are killed"
# Names of shipped platforms, and what vents when the driver is killed, within which time [ms].
CASES = {
    "emulated_canopen": ("the valves' own watchdogs", 150.0),
    "soro_board": ("the board's own watchdog", 150.0),
    "veab_tcp": ("the process beside the driver", 300.0),
    "vtem_modbus": ("the process beside the driver", 300.0),
    "itv_serial": ("the process beside the driver", 300.0),
    "alicat_serial": ("the process beside the driver", 300.0),
}
LATCH_MS = 100.0
HELD_PA, FALLEN_PA, EMPTY_PA = 40e3, 38.5e3, 1e3
_PATIENCE_S = 30.0
# A machine that stalls may trip it before its time: it begins again then.
_DRIVER = """
import sys, time
import numpy as np
from soro_core.errors import HardwareError
from soro_hardware import load_platform, open_regulator
platform = load_platform(sys.argv[1])
regulator, ready = open_regulator(platform, sys.argv[2]), False
while True:
    try:
        if not ready:
            regulator.configure()
        found = regulator.exchange(np.full(regulator.n_chambers, 40e3), time.monotonic_ns())
        ready = not any(fault.latched for fault in found.faults)
    except HardwareError:
        ready = False
    time.sleep(0.8 / platform.cycle_hz)
"""


@dataclass(frozen=True)
class Served:
    """An emulator: its process, the host's end, and the socket of its true pressures."""

    process: subprocess.Popen[str]
    device: str
    plant: str


def run(options: Options) -> str:
    """Kill, measure and write."""
    kills = options.pick(10, 1)
    names = list(CASES)[: options.pick(len(CASES), 1)]
    drivers, devices = [], []
    for name in names:
        options.say(f"{name}: driver killed")
        drivers.append(_driver_row(name, [driver_killed(name) for _ in range(kills)]))
        options.say(f"{name}: emulator killed")
        devices.append(_devices_row(name, [devices_killed(name) for _ in range(options.pick(5, 1))]))
    head = ("platform", "what vents", "kills", "median, ms", "slowest, ms", "at most, ms", "target")
    columns = ("platform", "kills", "latched, slowest, ms", "at most, ms", "target", "recovery by reset only")
    return "\n\n".join(
        [
            f"Driver killed (SIGKILL) at {HELD_PA / 1e3:g} kPa: time until the last chamber has started to "
            "vent (the valves' dead time of 5 ms within).",
            table(head, drivers),
            "Emulator killed (SIGKILL) under a driver at its rate: time until an exchange reports a fault "
            "that stays. Then it is started again: pressure is commanded for half a second and must not "
            "come, and must come after `configure` alone, which a reset runs.",
            table(columns, devices),
        ]
    )


def driver_killed(name: str) -> float:
    """Time [ms] from the kill to the last chamber's fall."""
    with served(name) as emulator:
        arguments = [sys.executable, "-c", _DRIVER, name, emulator.device]
        host = subprocess.Popen(arguments, stderr=subprocess.DEVNULL)
        link = PlantLinkClient(emulator.plant)
        try:
            while link.receive(_PATIENCE_S).pressures.min() < FALLEN_PA + 500:
                if host.poll() is not None:
                    raise RuntimeError(f"{name}: the driver has ended by itself")
            while link.wait(0.0) is not None:
                pass
            killed = time.monotonic()
        finally:
            host.kill()
            host.wait()
        while link.receive(_PATIENCE_S).pressures.max() > FALLEN_PA:
            pass
        took = time.monotonic() - killed
        while link.receive(_PATIENCE_S).pressures.max() > EMPTY_PA:  # and to the end
            pass
        link.close()
    return took * 1e3


def devices_killed(name: str) -> tuple[float, bool]:
    """Time [ms] from the kill to the fault, and whether nothing but `configure` brings pressure back."""
    platform = load_platform(name)
    period_s = 1.0 / platform.cycle_hz
    with tempfile.TemporaryDirectory(prefix="soro-") as folder:
        with served(name, folder) as emulator:
            regulator = open_regulator(platform, emulator.device)
            pressed = _comes(regulator, period_s)
            emulator.process.kill()
            killed = time.monotonic()
            while not _latched(regulator):
                time.sleep(period_s)
            latched_ms = (time.monotonic() - killed) * 1e3
            regulator.vent()
        with served(name, folder) as emulator:
            stays = _exchanges(regulator, 0.5, period_s) < 1e3
            comes = _comes(regulator, period_s)
            regulator.close()
    return latched_ms, pressed and stays and comes


def _latched(regulator: Regulator) -> bool:
    try:
        found = regulator.exchange(np.full(regulator.n_chambers, HELD_PA), time.monotonic_ns())
    except HardwareError:
        return True
    return any(fault.latched for fault in found.faults)


def _comes(regulator: Regulator, period_s: float) -> bool:
    """Whether pressure comes after `configure`; where a stalled machine trips the driver, it begins again."""
    end, ready = time.monotonic() + _PATIENCE_S, False
    while time.monotonic() < end:
        with contextlib.suppress(HardwareError):
            if not ready:
                regulator.configure()
            found = regulator.exchange(np.full(regulator.n_chambers, HELD_PA), time.monotonic_ns())
            ready = not any(fault.latched for fault in found.faults)
            if ready and float(np.max(found.pressure_pa)) > 0.5 * HELD_PA:
                return True
        time.sleep(period_s)
    return False


def _exchanges(regulator: Regulator, seconds: float, period_s: float) -> float:
    """Command pressure for a while; the highest of the last readings [Pa gauge]."""
    end, readings = time.monotonic() + seconds, np.zeros(regulator.n_chambers)
    while time.monotonic() < end:
        with contextlib.suppress(HardwareError):
            found = regulator.exchange(np.full(regulator.n_chambers, HELD_PA), time.monotonic_ns())
            readings = np.where(found.fresh, found.pressure_pa, readings)
        time.sleep(period_s)
    return float(readings.max())


@contextlib.contextmanager
def served(name: str, folder: str | None = None) -> Iterator[Served]:
    """An emulator of a platform in a process of its own; in the same folder it is found at the same place."""
    with contextlib.ExitStack() as stack:
        where = Path(folder or stack.enter_context(tempfile.TemporaryDirectory(prefix="soro-")))
        device, plant = where / "device", where / "plant"
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "soro_hardware.emulation", name),
                *("--device-link", str(device), "--plant-link", str(plant)),
            ],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            apart(process.pid)
            assert process.stdout is not None
            process.stdout.readline()
            yield Served(process, str(device), str(plant))
        finally:
            process.terminate()
            process.wait()
            if process.stdout is not None:
                process.stdout.close()


def _driver_row(name: str, times: list[float]) -> list[object]:
    what, most = CASES[name]
    slowest = max(times)
    return [
        name,
        what,
        len(times),
        f"{np.median(times):.0f}",
        f"{slowest:.0f}",
        f"{most:g}",
        met(slowest <= most),
    ]


def _devices_row(name: str, found: list[tuple[float, bool]]) -> list[object]:
    slowest = max(latched_ms for latched_ms, _ in found)
    good = all(by_reset for _, by_reset in found)
    return [
        name,
        len(found),
        f"{slowest:.0f}",
        f"{LATCH_MS:g}",
        met(slowest <= LATCH_MS),
        f"{'yes' if good else 'no'} ({met(good)})",
    ]
