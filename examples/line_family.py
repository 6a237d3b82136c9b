"""A family of regulators in one file: the example of docs/adding_a_family.md, tested as every other.

The device is a microcontroller on the network that takes a line a cycle and answers with one, in Pa gauge:

    host     S <sequence> <set point> <set point> ...      feeds its watchdog
             Z                                             0 Pa, and tell who you are
    device   R <sequence> <boot number> <pressure> <pressure> ...

It vents by itself when it has heard nothing for `watchdog_s`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from soro_core.errors import HardwareError
from soro_core.hardware import rest
from soro_core.hardware.driver_base import ConnectionDriver
from soro_core.hardware.emulation.air import Air
from soro_core.hardware.emulation.devices import EmulatedDevices, Line
from soro_core.hardware.platform import Freshness, PlatformBase, ValveBase
from soro_core.hardware.port import Array, BusStatistics, Exchange
from soro_core.hardware.transport.tcp import ByteLink, TcpTransport, link_to

# -- the platform file -----------------------------------------------------------------------------


class LinePlatform(PlatformBase):
    """Keys of its platform files; `valves` in the order of the device's outputs."""

    family: Literal["line"]
    transport: TcpTransport
    valves: Annotated[tuple[ValveBase, ...], Field(strict=False, min_length=1, max_length=16)]
    watchdog_s: float = Field(0.1, gt=0, le=0.5, description="silence after which the device vents")
    host: Freshness = Freshness(stale_cycles=10)

    @property
    def device(self) -> str | None:
        return self.transport.address


# -- the driver ------------------------------------------------------------------------------------


class LineRegulator(ConnectionDriver[LinePlatform]):
    """One line there and one back a cycle."""

    source = "device"
    device_watchdog = True

    def __init__(
        self, platform: LinePlatform, link: ByteLink, clock: Callable[[], float], lockstep: bool
    ) -> None:
        super().__init__(platform, platform.host, clock, lockstep)
        self._link, self._bytes = link, b""
        self._sequence = self._received = self._garbled = self._lost = 0
        self._boot: int | None = None  # of the device that was configured; None: not configured
        self._sent_pa, self._pressure_pa = np.zeros(self.n_chambers), np.full(self.n_chambers, np.nan)

    @property
    def statistics(self) -> BusStatistics:
        sent, received = self._sequence, self._received
        return BusStatistics(self._cycles, sent, received, self._lost, frames_garbled=self._garbled)

    def configure(self) -> None:
        self._begin()
        self._bytes = b""
        self._link.open()
        self._link.send(b"Z\n")
        if (boot := self._answer(0, 1.0)) is None:
            raise HardwareError("line device: start-up: no answer; is it this family?")
        self._boot, self._sent_pa = boot, np.zeros(self.n_chambers)
        self._configured = True

    def exchange(self, setpoint_pa: Array, now_ns: int) -> Exchange:
        setpoint, refused = self._checked(setpoint_pa)
        answered = self._cycle(np.zeros(self.n_chambers) if refused or self._latched else setpoint)
        fresh = np.full(self.n_chambers, answered)
        faults = (*refused, *self._faults(fresh, now_ns))
        return Exchange(self._sent_pa.copy(), self._pressure_pa.copy(), fresh, faults)

    def vent(self) -> None:
        if self._configured:
            self._cycle(np.zeros(self.n_chambers))

    def close(self) -> None:
        if self._configured:
            fall_pa = self.platform.shutdown_ramp_pa_s / self.platform.cycle_hz
            rest.ramp_down(self._paced, self._sent_pa, fall_pa, 1, round(self.platform.cycle_hz))
        self._closed, self._configured = True, False
        self._link.close()

    def _cycle(self, setpoint_pa: Array) -> bool:
        """Send, and wait for the answer; whether it came. A broken connection is latched."""
        self._sequence += 1
        values = [round(value) for value in setpoint_pa.tolist()]
        patience_s = self._patience_s(self.platform.cycle_budget_s)
        try:
            self._link.send(f"S {self._sequence} {' '.join(map(str, values))}\n".encode())
            self._sent_pa = np.array(values, dtype=np.float64)
            boot = self._answer(self._sequence, patience_s)
        except HardwareError as error:
            self._latch("link_lost", str(error))
            return False
        self._lost += boot is None
        if boot is not None and boot != self._boot:
            self._latch("rebooted", f"boot {boot}")
        return boot is not None

    def _answer(self, sequence: int, patience_s: float) -> int | None:
        """Boot number of the answer to a question, its pressures taken; None if none came in time."""
        deadline = self.clock() + patience_s
        while True:
            *lines, self._bytes = (self._bytes + self._link.receive(0.0)).split(b"\n")
            for line in lines:
                try:
                    number, boot, *pressures = (int(word) for word in line.removeprefix(b"R ").split())
                except ValueError:
                    pressures, number, boot = [], -1, 0
                if len(pressures) != self.n_chambers:
                    self._garbled += 1
                elif number == sequence:
                    self._received += 1
                    self._pressure_pa = np.array(pressures, dtype=np.float64)
                    return boot
            self._bytes = self._bytes[-200:]  # a stream without line ends fills no memory
            if (left_s := deadline - self.clock()) <= 0:
                return None
            self._bytes += self._link.receive(min(left_s, 0.001))

    def _paced(self, setpoint_pa: Array) -> Array:
        """One cycle of the shutdown."""
        end_s = self.clock() + 1.0 / self.platform.cycle_hz
        fresh = self._cycle(setpoint_pa)
        while not self.lockstep and self.clock() < end_s and self._configured:
            self._bytes += self._link.receive(max(end_s - self.clock(), 0.0))
        return self._pressure_pa if fresh else np.full(self.n_chambers, np.nan)


def open_driver(
    platform: LinePlatform, endpoint: str | None, clock: Callable[[], float], lockstep: bool
) -> LineRegulator:
    """Make the driver; nothing is opened yet."""
    address, patience_s = endpoint or platform.device, platform.transport.connect_timeout_s
    return LineRegulator(platform, link_to(address, "line device", patience_s, clock), clock, lockstep)


# -- the emulated device ---------------------------------------------------------------------------


class LineDevice(EmulatedDevices):
    """Firmware and valves; in lockstep every S, once it is answered, ends a cycle."""

    transport = "tcp"

    def __init__(self, platform: LinePlatform, lockstep: bool, seed: int) -> None:
        self.line = HostLine(self)
        super().__init__((self.line,), platform.emulation.step_s)
        self._period_ns, self._lockstep = round(1e9 / platform.cycle_hz), lockstep
        self._watchdog_ns, self._heard_ns, self._rest, self.boot = round(platform.watchdog_s * 1e9), 0, b"", 1
        self._setpoint_pa = [0.0] * len(platform.valves)
        demands = [lambda n=n: self._setpoint_pa[n] for n in range(len(platform.valves))]
        self.air = Air(platform.emulation.regulator, demands, np.random.default_rng(seed))

    def reboot(self) -> None:
        """Lose power and come back."""
        self.boot += 1
        self._setpoint_pa = [0.0] * len(self._setpoint_pa)

    def connect_faults(self, chambers: tuple[str, ...], seed: int) -> None:
        super().connect_faults(chambers, seed)
        self.faults.supported |= {"reboot"}
        self.faults.on_start["reboot"] = lambda fault: self.reboot()

    def take(self, chunk: bytes) -> None:
        """Lines of the host."""
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        for line in lines:
            kind, *words = line.split() or [b""]
            if kind not in (b"S", b"Z") or len(words) != (1 + len(self._setpoint_pa)) * (kind == b"S"):
                continue
            values = [int(word) for word in words] or [0] * (1 + len(self._setpoint_pa))
            self.air.advance(self.now_ns)
            self._setpoint_pa, self._heard_ns = [float(value) for value in values[1:]], self.now_ns
            pressures = " ".join(str(round(self.air.reading_pa(n))) for n in range(len(self._setpoint_pa)))
            self.line.put(f"R {values[0]} {self.boot} {pressures}\n".encode())
            if self._lockstep and kind == b"S":
                self.tick(self.now_ns + self._period_ns)

    def poll(self, now_ns: int) -> None:
        if now_ns - self._heard_ns > self._watchdog_ns:
            self._setpoint_pa = [0.0] * len(self._setpoint_pa)

    def due_ns(self) -> int | None:
        return None

    def work(self, now_ns: int) -> None:
        pass


class HostLine(Line):
    """The host's connection."""

    def __init__(self, device: LineDevice) -> None:
        super().__init__()
        self._device = device

    def take(self, chunk: bytes) -> None:
        self._device.take(chunk)


def emulate(platform: LinePlatform, lockstep: bool, seed: int) -> LineDevice:
    """Make the emulated device."""
    return LineDevice(platform, lockstep, seed)
