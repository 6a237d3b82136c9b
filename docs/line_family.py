"""A family of regulators in one file: the example of docs/adding_a_family.md, tested as every other.

The device is a microcontroller on the network that reads one line a cycle and answers with one, in Pa gauge:

    host     S <sequence> <set point> <set point> ...      feeds its watchdog
             Z                                             0 Pa; the device identifies itself
    device   R <sequence> <boot number> <pressure> <pressure> ...

The device vents when no line arrives for `watchdog_s`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from soro_core.arrays import Array
from soro_core.errors import HardwareError
from soro_hardware.emulation.devices import ServedDevices
from soro_hardware.families import Family
from soro_hardware.link_driver import LinkDriver
from soro_hardware.platform import Freshness, TcpPlatform, ValveBase
from soro_hardware.transport.tcp import ByteLink

# -- the platform file -----------------------------------------------------------------------------


class LinePlatform(TcpPlatform):
    """Keys of its platform files; `valves` in the order of the device's outputs."""

    family: Literal["line"]
    valves: Annotated[tuple[ValveBase, ...], Field(strict=False, min_length=1, max_length=16)]
    watchdog_s: float = Field(0.1, gt=0, le=0.5, description="silence after which the device vents")
    host: Freshness = Freshness(stale_cycles=10)


# -- the driver ------------------------------------------------------------------------------------


class LineRegulator(LinkDriver[LinePlatform]):
    """One line there and one back a cycle."""

    kind = "line device"
    device_watchdog = True

    def __init__(
        self, platform: LinePlatform, link: ByteLink, clock: Callable[[], float], lockstep: bool
    ) -> None:
        super().__init__(platform, platform.host, link, clock, lockstep)
        self._bytes, self._sequence, self._received, self._garbled = b"", 0, 0, 0
        self._boot: int | None = None  # of the device that was started

    def counts(self) -> Mapping[str, int]:
        return {
            "frames_sent": self._sequence,
            "frames_received": self._received,
            "frames_garbled": self._garbled,
        }

    def start_up(self) -> None:
        self.link.open()
        self.connected()
        self.link.send(b"Z\n")
        self._boot = self._answer(0, 1.0)
        if self._boot is None:
            raise HardwareError("line device: start-up: no answer; is it this family?")
        self.sent_pa = np.zeros(self.n_chambers)

    def connected(self) -> None:
        self._bytes = b""

    def send_and_receive(self, setpoint_pa: Array) -> bool:
        self._sequence += 1
        values = [round(value) for value in setpoint_pa.tolist()]
        self.sent_pa = np.array(values, dtype=np.float64)
        self.link.send(f"S {self._sequence} {' '.join(map(str, values))}\n".encode())
        boot = self._answer(self._sequence, self.patience_s(self.platform.cycle_budget_s))
        self.answers_lost += boot is None
        if boot not in (None, self._boot):
            self.latch.add("rebooted", self.source, f"boot {boot}")
        return boot is not None

    def _answer(self, sequence: int, patience_s: float) -> int | None:
        """Boot number of the answer to a question, its pressures taken; None if none came in time."""
        deadline = self.clock() + patience_s
        while True:
            *lines, self._bytes = (self._bytes + self.link.receive(0.0)).split(b"\n")
            for line in lines:
                try:
                    number, boot, *pressures = (int(word) for word in line.removeprefix(b"R ").split())
                except ValueError:
                    pressures, number, boot = [], -1, 0
                if len(pressures) != self.n_chambers:
                    self._garbled += 1
                elif number == sequence:
                    self._received += 1
                    self.pressure_pa = np.array(pressures, dtype=np.float64)
                    return boot
            self._bytes = self._bytes[-200:]  # a stream without line ends fills no memory
            if (left_s := deadline - self.clock()) <= 0:
                return None
            self._bytes += self.link.receive(min(left_s, 0.001))


open_driver = LineRegulator.over_tcp


# -- the emulated device ---------------------------------------------------------------------------


class LineDevice(ServedDevices):
    """Firmware and valves; in lockstep every S, once it is answered, ends a cycle."""

    def __init__(self, platform: LinePlatform, lockstep: bool, seed: int) -> None:
        super().__init__(platform, lockstep, seed)
        self._watchdog_ns, self._last_command_ns, self._rest, self.boot = (
            round(platform.watchdog_s * 1e9),
            0,
            b"",
            1,
        )
        self._wake_pa = platform.emulation.wake_pa or 0.0
        self._setpoint_pa = [self._wake_pa] * len(platform.valves)
        self.connect_air([lambda n=n: self._setpoint_pa[n] for n in range(len(platform.valves))])
        self.on_fault("reboot", lambda place: self.reboot())

    def reboot(self) -> None:
        """Lose power and come back."""
        self.boot += 1
        self._setpoint_pa = [self._wake_pa] * len(self._setpoint_pa)

    def give_setpoint(self, place: int, pressure_pa: float) -> None:
        self._setpoint_pa[place] = pressure_pa

    def take(self, chunk: bytes) -> None:
        """Lines of the host."""
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        for line in lines:
            kind, *words = line.split() or [b""]
            if kind not in (b"S", b"Z") or len(words) != (1 + len(self._setpoint_pa)) * (kind == b"S"):
                continue
            values = [int(word) for word in words] or [0] * (1 + len(self._setpoint_pa))
            self.air.advance(self.now_ns)
            self._setpoint_pa, self._last_command_ns = [float(value) for value in values[1:]], self.now_ns
            pressures = " ".join(str(round(self.air.reading_pa(n))) for n in range(len(self._setpoint_pa)))
            self.line.put(f"R {values[0]} {self.boot} {pressures}\n".encode())
            if self.lockstep and kind == b"S":
                self.end_cycle()

    def poll(self, now_ns: int) -> None:
        if now_ns - self._last_command_ns > self._watchdog_ns:
            self._setpoint_pa = [0.0] * len(self._setpoint_pa)


# -- its name, which the entry point `soro.families` of the package announces -----------------------

LINE = Family(
    config="line_family:LinePlatform", driver="line_family:open_driver", emulator="line_family:LineDevice"
)
