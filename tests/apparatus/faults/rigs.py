"""Drivers on emulated devices in lockstep, on real lines or in this process, and the loop around them."""

from __future__ import annotations

import queue
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from soro_core import safety
from soro_core.pneumatics.regulator import vent_time
from soro_hardware import Exchange, Regulator, load_platform, open_regulator
from soro_hardware.board.config import BoardPlatform, StopContact
from soro_hardware.board.driver import BoardRegulator
from soro_hardware.canopen.driver import CanopenRegulator
from soro_hardware.emulation.devices import EmulatedDevices
from soro_hardware.emulation.process import Emulator, emulate
from soro_hardware.emulation.veab import EmulatedVeabServer
from soro_hardware.limited_regulator import LimitedRegulator
from soro_hardware.platform import PlatformBase
from soro_hardware.serial_line.config import SerialPlatform
from soro_hardware.serial_line.dialects import AlicatRegulator, ItvRegulator
from soro_hardware.veab.driver import VeabRegulator
from soro_hardware.vtem.driver import VtemRegulator
from tests.apparatus.faults.rows import Row
from tests.soro_hardware.hub_bus import HubBus
from tests.soro_hardware.line_link import LineLink, LinePort


@dataclass
class Rig:
    """A driver on emulated devices in lockstep.

    Attributes
    ----------
    close : callable
        Ends both.
    at_devices : callable
        Calls a function where the devices live.
    mend : callable
        What a person does besides ~/reset: starting a server that has ended.
    vent_s : callable, optional
        Time [s] in which the model of the air vents, from and to a pressure, so many times slower; default
        that of the emulated regulators.
    """

    platform: PlatformBase
    regulator: Regulator
    devices: EmulatedDevices
    close: Callable[[], None]
    at_devices: Callable[[Callable[[], None]], None] = field(default=lambda action: action())
    mend: Callable[[], None] = field(default=lambda: None)
    vent_s: Callable[[float, float, float], float] | None = None

    @property
    def period_s(self) -> float:
        """Time of a cycle."""
        return 1.0 / self.platform.cycle_hz

    def vent_time(self, from_pa: float, to_pa: float, slower: float = 1.0) -> float:
        """Time [s] in which the model of the air vents."""
        if self.vent_s is not None:
            return self.vent_s(from_pa, to_pa, slower)
        model = self.platform.regulator
        return vent_time(model.model_copy(update={"tau_s": model.tau_s * slower}), from_pa, to_pa)


def on_a_line(platform: PlatformBase, seed: int = 1) -> Rig:
    """Any family over its real bytes: the emulator serves in a thread, advanced by the driver's cycles."""
    # What is lost costs this time on the wall; the devices' time stands still meanwhile.
    platform = platform.model_copy(update={"lockstep_timeout_s": 0.1})
    devices = emulate(platform, lockstep=True, seed=seed)
    folder = tempfile.TemporaryDirectory(prefix="soro-")
    link = Path(folder.name) / "line"  # outlives an adapter that is pulled out and put back
    emulator = Emulator(devices, device_link=link)
    waiting: queue.SimpleQueue[tuple[Callable[[], None], threading.Event]] = queue.SimpleQueue()

    def at_devices(action: Callable[[], None]) -> None:
        done = threading.Event()
        waiting.put((action, done))
        emulator.wake()
        if not done.wait(10.0):
            raise RuntimeError("the emulated devices' thread has ended")

    def woken() -> None:
        while not waiting.empty():
            action, done = waiting.get()
            action()
            done.set()

    emulator.on_wake = woken
    serving = threading.Thread(target=emulator.run, args=(time.monotonic_ns,), daemon=True)
    serving.start()
    regulator = open_regulator(platform, str(link), lockstep=True)

    def close() -> None:
        regulator.close()
        emulator.stop()
        emulator.wake()
        serving.join(5.0)
        emulator.close()
        folder.cleanup()

    return Rig(platform, regulator, devices, close, at_devices)


def in_process(platform: PlatformBase, seed: int = 1) -> Rig:
    """Any family without a real line: what has not come when the devices have had their cycle never comes."""
    devices = emulate(platform, lockstep=True, seed=seed)
    if isinstance(platform, SerialPlatform):
        return _on_ports(platform, devices)
    (line,) = devices.lines
    kinds = {"veab_tcp": VeabRegulator, "soro_board": BoardRegulator, "vtem_modbus": VtemRegulator}
    kind = kinds[platform.family]
    regulator: Regulator = kind(platform, LineLink(line), time.monotonic, lockstep=True)

    def plug(is_in: bool) -> None:
        line.hang_up, line.refuses = not is_in, not is_in

    return _unpluggable(Rig(platform, regulator, devices, regulator.close), plug)


def _on_ports(platform: SerialPlatform, devices: EmulatedDevices) -> Rig:
    ports = [LinePort(line, f"port{number}") for number, line in enumerate(devices.lines)]
    kind = ItvRegulator if platform.family == "itv_rs232" else AlicatRegulator

    def plug(is_in: bool) -> None:
        for port in ports:
            port.gone = not is_in

    regulator = kind(platform, lambda: ports, time.monotonic, lockstep=True)
    return _unpluggable(Rig(platform, regulator, devices, regulator.close), plug)


def _unpluggable(rig: Rig, plug: Callable[[bool], None]) -> Rig:
    faults = rig.devices.faults
    faults.on_start["adapter_unplug"] = lambda _: plug(False)
    faults.on_end["adapter_unplug"] = lambda _: plug(True)
    return rig


def canopen(name: str, real: bool) -> Rig:
    """CANopen: frame by frame in this process, but for the faults of the adapter's line."""
    platform = load_platform(name)
    if real:
        return on_a_line(platform)
    bus = HubBus(platform, seed=1)
    driver = CanopenRegulator(platform, lambda: bus, clock=time.monotonic, lockstep=True)
    return Rig(platform, driver, bus.world, driver.close)


def other(name: str, real: bool) -> Rig:
    """Every other family."""
    platform = load_platform(name)
    if isinstance(platform, BoardPlatform):  # two of its six buses; the other ports feed no chamber
        options = platform.board.model_copy(update={"stop": StopContact(line=17)})
        platform = platform.model_copy(update={"ports": platform.ports[:4], "board": options})
    rig = on_a_line(platform) if real else in_process(platform)
    if isinstance(rig.devices, EmulatedVeabServer):
        rig.mend = rig.devices.start  # the published server ends at the first error; a person starts it
    return rig


def rig_of(family: str, row: Row, real: bool = False) -> Rig:
    """The rig of a family for a row, with a real line where the row needs one or it is wanted."""
    make = canopen if family.startswith("canopen") else other
    return make(PLATFORMS[family], real or row.bytes)


PLATFORMS = {
    "canopen_408": "emulated_canopen",
    "canopen_408, 4 channels": "emulated_canopen_4ch",
    "itv_rs232": "itv_serial",
    "alicat": "alicat_serial",
    "veab_tcp": "veab_tcp",
    "soro_board": "soro_board",
    "vtem_modbus": "vtem_modbus",
}


class Loop:
    """What the regulator node does, without ROS, in lockstep and with the limits as shipped."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.limited = LimitedRegulator(rig.platform, rig.regulator, safety.Limits())
        self.cycles = 0
        self.vented_at: int | None = None
        self.exchange: Exchange | None = None

    @property
    def now_ns(self) -> int:
        """Time of the present cycle."""
        return round(self.cycles * self.rig.period_s * 1e9)

    @property
    def vented(self) -> bool:
        """Whether the latch is closed."""
        return self.limited.state.vented

    @property
    def cause(self) -> str | None:
        """Why the limiter has vented, or None."""
        return self.limited.cause

    def cycle(self, command_pa: np.ndarray | None) -> None:
        """One cycle; None for a controller that has stopped."""
        now, devices_ns = self.now_ns, self.rig.devices.now_ns
        if command_pa is not None:
            self.limited.offer(command_pa, now, now)
        self.exchange = self.limited.cycle(now) or self.exchange
        if self.vented and self.vented_at is None:
            self.vented_at = self.cycles
        # Where nothing reaches the devices that they take for a cycle, their time goes on all the same.
        self.rig.at_devices(lambda: self._let_time_go_on(devices_ns))
        self.cycles += 1

    def _let_time_go_on(self, devices_ns: int) -> None:
        devices = self.rig.devices
        if devices.now_ns == devices_ns:
            devices.tick(devices_ns + round(self.rig.period_s * 1e9))

    def reset(self) -> str | None:
        """What ~/reset does; the refusal, or None."""
        refusal = self.limited.reset(lambda: self.now_ns)
        if refusal is None:
            self.vented_at = None
        return refusal
