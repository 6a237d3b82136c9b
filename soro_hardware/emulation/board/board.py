"""An emulated board: the real server without its sockets, with emulated chips and air."""

from __future__ import annotations

import errno
from collections.abc import Callable

from soro_hardware.board import chips
from soro_hardware.board.config import BoardPlatform
from soro_hardware.board.pi.board import Board
from soro_hardware.board.pi.contact import StopInput
from soro_hardware.board.pi.ports import Ports
from soro_hardware.emulation.board.i2c import EmulatedAds1015, EmulatedI2c, EmulatedMcp4725
from soro_hardware.emulation.devices import ServedDevices
from soro_hardware.emulation.faults.schedule import FaultSchedule


class EmulatedBoard(ServedDevices):
    """Board, chips and air of a platform; parameters as in `EmulatedDevices`.

    In lockstep every SET advances the time by one cycle after its answer.
    """

    def __init__(self, platform: BoardPlatform, lockstep: bool, seed: int = 0) -> None:
        super().__init__(platform, lockstep, seed)
        self.platform = platform
        self._full_scale_v = platform.board.dac_full_scale_v
        wake_pa = platform.emulation.wake_pa
        self.dacs = [
            EmulatedMcp4725() if wake_pa is None else EmulatedMcp4725(self._code_of(n, wake_pa))
            for n in range(len(platform.ports))
        ]
        self.adcs = [EmulatedAds1015(self._sensor(n)) for n in range(len(platform.ports))]
        self.buses: dict[int, EmulatedI2c] = {}
        for wiring, dac, adc in zip(platform.ports, self.dacs, self.adcs, strict=True):
            bus = self.buses.setdefault(wiring.bus, EmulatedI2c({}))
            bus.chips |= {wiring.dac: dac, wiring.adc: adc}
        demands = [self._demand(n) for n in range(len(platform.ports))]
        self.connect_air(demands, (valve.port for valve in platform.valves))
        self.on_fault("reboot", lambda _: self.power_cycle())
        self.while_fault("brownout", lambda port, is_on: self.power(port, not is_on))
        self._boots = 0
        self.board = self._boot()

    def power_cycle(self) -> None:
        """Switch the power of the board off and on; the host's connection ends."""
        for port in range(len(self.dacs)):
            self.brownout(port)
        self.board = self._boot()
        self.line.hang_up = True

    def brownout(self, port: int) -> None:
        """Switch the power of one port's chips off and on at once."""
        self.power(port, False)
        self.power(port, True)

    def power(self, port: int, on: bool) -> None:
        """Switch the power of one port's chips; without power they do not answer and the output is 0 V."""
        wiring, dac = self.platform.ports[port], self.dacs[port]
        broken = self.buses[wiring.bus].broken
        if on:
            dac.power_up()
            self.adcs[port].power_up()
            for address in (wiring.dac, wiring.adc):
                broken.pop(address, None)
        else:
            dac.power_down = 1
            broken |= {wiring.dac: errno.ENXIO, wiring.adc: errno.ENXIO}

    def give_setpoint(self, place: int, pressure_pa: float) -> None:
        self.dacs[place].code = self._code_of(place, pressure_pa)

    def due_ns(self) -> int | None:
        return self.board.next_event_ns

    def work(self, now_ns: int) -> None:
        self._advance(now_ns)
        if not self.lockstep and now_ns >= self.board.next_event_ns:
            self.line.put(self.board.poll(now_ns))

    def poll(self, now_ns: int) -> None:
        self._advance(now_ns)
        # In lockstep only this happens between two SETs; the answer to the next SET states the cause.
        if self.lockstep:
            self.board.watch(now_ns)

    def take(self, chunk: bytes) -> None:
        """Process bytes of the host; in lockstep a SET ends a cycle."""
        before = self.board.set_points
        self.line.put(self.board.feed(chunk, self.now_ns))
        self.line.hang_up = self.line.hang_up or self.board.hang_up
        if self.lockstep and self.board.set_points != before:
            self.end_cycle()

    def refuse_host(self, address: str) -> bytes | None:
        return self.board.refuse_host(address, self.now_ns)

    def connected(self, has_host: bool) -> None:
        if has_host:
            self.board.host_came(self.now_ns)
        else:
            self.board.host_gone(self.now_ns)

    def _boot(self) -> Board:
        self._boots += 1
        ports = Ports(self.platform, self.buses.__getitem__, self._settle)
        contact = self.platform.board.stop
        stop = None if contact is None else StopInput(contact, _EmulatedContact(self.faults))
        board = Board(self.platform, ports, self._boots, stop=stop)
        board.start(self.now_ns)
        return board

    def _settle(self, seconds: float) -> None:
        """Advance the time of the chips during the self-test, for which the host does not wait."""
        self._advance(self.now_ns + round(seconds * 1e9))

    def _advance(self, now_ns: int) -> None:
        for bus in self.buses.values():
            bus.advance(now_ns)

    def _code_of(self, port: int, pressure_pa: float) -> int:
        volts = self.platform.scale_of(port).to_volts(pressure_pa)
        return min(max(round(volts / self._full_scale_v * chips.CODES), 0), chips.CODES - 1)

    def _demand(self, port: int) -> Callable[[], float]:
        scale, dac = self.platform.scale_of(port), self.dacs[port]
        return lambda: scale.asked_pa(dac.fraction * self._full_scale_v)

    def _sensor(self, port: int) -> Callable[[], float]:
        scale, divider = self.platform.scale_of(port), self.platform.board.adc_divider
        return lambda: scale.sensor_volts(self.air.reading_pa(port)) / divider


class _EmulatedContact:
    """The contact of the emergency stop, which a fault opens."""

    def __init__(self, faults: FaultSchedule) -> None:
        self._faults = faults

    def is_open(self) -> bool:
        return self._faults.value("stop_pressed") is not None

    def close(self) -> None:
        pass
