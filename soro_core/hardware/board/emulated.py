"""An emulated board: the real server without its sockets, on emulated chips, with air behind them."""

from __future__ import annotations

import errno
from collections.abc import Callable

import numpy as np

from soro_core.hardware.board.board import Board
from soro_core.hardware.board.config import BoardPlatform
from soro_core.hardware.board.emulated_i2c import EmulatedAds1015, EmulatedI2c, EmulatedMcp4725
from soro_core.hardware.board.ports import Ports
from soro_core.hardware.emulation.air import Air
from soro_core.hardware.emulation.ports import ServedPorts


class EmulatedBoard(ServedPorts):
    """Board, chips and air of a platform.

    In lockstep every SET, once it is answered, advances everything by one cycle period.

    Parameters
    ----------
    platform : BoardPlatform
        What is emulated.
    lockstep : bool
        Whether SET is the clock.
    seed : int
        Seed of the sensor noise.
    """

    def __init__(self, platform: BoardPlatform, lockstep: bool, seed: int = 0) -> None:
        self.platform, self._lockstep = platform, lockstep
        super().__init__([valve.port for valve in platform.valves], platform.emulation.step_s)
        self._period_ns = round(1e9 / platform.cycle_hz)
        self._full_scale_v = platform.board.dac_full_scale_v
        self.dacs = [EmulatedMcp4725() for _ in platform.ports]
        self.adcs = [EmulatedAds1015(self._sensor(n)) for n in range(len(platform.ports))]
        self.buses: dict[int, EmulatedI2c] = {}
        for wiring, dac, adc in zip(platform.ports, self.dacs, self.adcs, strict=True):
            bus = self.buses.setdefault(wiring.bus, EmulatedI2c({}))
            bus.chips |= {wiring.dac: dac, wiring.adc: adc}
        demands = [self._demand(n) for n in range(len(platform.ports))]
        self.air = Air(platform.emulation.regulator, demands, np.random.default_rng(seed))
        self._boots = 0
        self.board = self._boot()

    def connect_faults(self, chambers: tuple[str, ...], seed: int) -> None:
        super().connect_faults(chambers, seed)
        self.faults.supported |= {"reboot", "brownout"}
        ports = dict(zip(chambers, self._ports, strict=True))
        self.faults.on_start["reboot"] = lambda fault: self.power_cycle()
        self.faults.on_start["brownout"] = lambda fault: self.power(ports[fault.chamber], False)
        self.faults.on_end["brownout"] = lambda fault: self.power(ports[fault.chamber], True)

    def power_cycle(self) -> None:
        """Take the power of the whole board away and give it back: the host's connection ends."""
        for port in range(len(self.dacs)):
            self.brownout(port)
        self.board = self._boot()
        self.line.hang_up = True

    def brownout(self, port: int) -> None:
        """Take the power of one port's chips away and give it back at once."""
        self.power(port, False)
        self.power(port, True)

    def power(self, port: int, on: bool) -> None:
        """Switch the power of one port's chips; without it they do not answer, and the output is 0 V."""
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

    def due_ns(self) -> int | None:
        return self.board.next_event_ns

    def work(self, now_ns: int) -> None:
        self._advance(now_ns)
        if not self._lockstep and now_ns >= self.board.next_event_ns:
            self.line.put(self.board.poll(now_ns))

    def poll(self, now_ns: int) -> None:
        self._advance(now_ns)
        # In lockstep there is nothing between two SETs but this; the next one is answered with the cause.
        if self._lockstep and self.board.watchdog_ns is not None and now_ns >= self.board.watchdog_ns:
            self.board.poll(now_ns)

    def take(self, chunk: bytes) -> None:
        """Take bytes of the host; in lockstep a SET ends a cycle."""
        before = self.board.set_points
        self.line.put(self.board.feed(chunk, self.now_ns))
        if self._lockstep and self.board.set_points != before:
            self.tick(self.now_ns + self._period_ns)

    def turn_away(self, address: str) -> bytes | None:
        return self.board.turn_away(address, self.now_ns)

    def connected(self, has_host: bool) -> None:
        if has_host:
            self.board.host_came(self.now_ns)
        else:
            self.board.host_gone(self.now_ns)

    def _boot(self) -> Board:
        self._boots += 1
        ports = Ports(self.platform, self.buses.__getitem__, self._settle)
        board = Board(self.platform, ports, self._boots)
        board.start(self.now_ns)
        return board

    def _settle(self, seconds: float) -> None:
        """What the self-test waits for takes the chips' time only; the host is not held up."""
        self._advance(self.now_ns + round(seconds * 1e9))

    def _advance(self, now_ns: int) -> None:
        for bus in self.buses.values():
            bus.advance(now_ns)

    def _demand(self, port: int) -> Callable[[], float]:
        scale, dac = self.platform.scale_of(port), self.dacs[port]
        return lambda: scale.asked_pa(dac.fraction * self._full_scale_v)

    def _sensor(self, port: int) -> Callable[[], float]:
        scale, divider = self.platform.scale_of(port), self.platform.board.adc_divider
        return lambda: scale.sensor_volts(self.air.reading_pa(port)) / divider


def emulate(platform: BoardPlatform, lockstep: bool, seed: int) -> EmulatedBoard:
    """Emulated devices of a platform."""
    return EmulatedBoard(platform, lockstep, seed)
