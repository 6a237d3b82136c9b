"""The published server of the VEAB boards, with its errors, which the driver must handle.

According to its sources the server has one client. It reads 8 bytes for each port with one `recv`, and ends
at any other number of bytes, at a value outside 0 to 1, after 0.5 s without a message, and when the client
disconnects. At its end it should write 0.5 to every DAC, but it assigns to an attribute that the driver of
the DAC does not have. So nothing is written, the DACs keep their voltage, and the arm keeps its pressure.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from soro_hardware.emulation.devices import ServedDevices
from soro_hardware.veab.config import VeabPlatform
from soro_hardware.veab.protocol import LOWEST_PA, SAFE, SPAN_PA, normalised, volts

_SILENCE_NS = 500_000_000
_CODES, _COUNT_V, _MOST_COUNTS = 4096, 0.005, 2047


class Dac:
    """The published server's object for a DAC, whose only property is `normalized_value`."""

    normalized_value = SAFE


class EmulatedVeabServer(ServedDevices):
    """Server, valves and air of a platform; parameters as in `EmulatedDevices`.

    In lockstep the server answers each message with one reading, and each message advances the time by one
    cycle.

    Attributes
    ----------
    ended : str or None
        Why the server has ended; the DACs keep their voltage and no client is accepted.
    """

    def __init__(self, platform: VeabPlatform, lockstep: bool, seed: int = 0) -> None:
        emulation = platform.emulation
        super().__init__(platform, lockstep, seed)
        self._n, self._push_ns = emulation.ports or platform.ports, round(1e9 / emulation.push_hz)
        self._restart_ns = None if emulation.restart_s is None else round(emulation.restart_s * 1e9)
        self.dacs = [Dac() for _ in range(self._n)]
        for place in range(self._n):
            self.give_setpoint(place, emulation.wake_pa or 0.0)
        # Ports of the platform that the server does not have: no set point reaches their valves.
        absent: list[Callable[[], float]] = [lambda: 0.0] * (platform.ports - self._n)
        demands = [self._demand(dac) for dac in self.dacs] + absent
        self.connect_air(demands, (valve.port for valve in platform.valves))
        self.on_fault("reboot", lambda _: self.end("rebooted"))
        self.ended: str | None = None
        self._wanted = [SAFE] * self._n
        self._has_client = False
        self._received_ns = self._ended_ns = 0
        self._next_ns = self._push_ns
        self._gather_ns = round(emulation.gather_s * 1e9)
        self._gathered, self._gathered_ns = b"", 0

    def start(self) -> None:
        """Start the server again; the DACs keep their voltage until a client connects."""
        self.ended = None
        self.line.refuses = False

    def give_setpoint(self, place: int, pressure_pa: float) -> None:
        self.dacs[place].normalized_value = normalised(pressure_pa)

    def due_ns(self) -> int | None:
        return self._next_ns

    def work(self, now_ns: int) -> None:
        if self.lockstep or now_ns < self._next_ns:
            return
        self._next_ns = now_ns + self._push_ns
        if self.ended is not None:
            if self._restart_ns is not None and now_ns - self._ended_ns >= self._restart_ns:
                self.start()
        elif self._has_client and now_ns - self._received_ns > _SILENCE_NS:
            self.end("timed out")
        elif self._has_client:
            self._serve()
            if now_ns - self._gathered_ns >= self._gather_ns:
                self._flush()

    def take(self, chunk: bytes) -> None:
        """Process the bytes that one `recv` of the server returns."""
        self._received_ns = self.now_ns
        size = 8 * self._n
        for start in range(0, len(chunk), size):
            if self.ended is not None:
                return
            part = chunk[start : start + size]
            if len(part) != size:
                self.end(f"unpack requires a buffer of {size} bytes")
                return
            self._wanted = list(struct.unpack(f"<{self._n}d", part))
            if self.lockstep:
                self._serve()
            self._flush()
            if self.lockstep:
                self.end_cycle()

    def connected(self, has_host: bool) -> None:
        """Accept the client; end the server when the client disconnects."""
        if has_host and self.ended is None:
            self._has_client, self._received_ns = True, self.now_ns
            self._wanted = [SAFE] * self._n
            self._gathered, self._gathered_ns = b"", self.now_ns
            if self.lockstep:
                self._push()  # in real time the server sends a reading soon, by itself
                self._flush()
        elif not has_host and self._has_client:
            self.end("the client has left")

    def end(self, why: str) -> None:
        """End as the published server does: without resetting the DACs."""
        if self.ended is None:
            self.ended, self._ended_ns, self._has_client = why, self.now_ns, False
            for dac in self.dacs:
                dac.set_value = SAFE  # type: ignore[attr-defined]
            self.line.hang_up = self.line.refuses = True

    def _serve(self) -> None:
        self._control()
        if self.ended is None:
            self._push()

    def _control(self) -> None:
        for dac, value in zip(self.dacs, self._wanted, strict=True):
            if not 0.0 <= value <= 1.0:  # an assertion of the DAC's driver; NaN fails it too
                self.end(f"AssertionError: {value:g} for a DAC")
                return
            dac.normalized_value = value

    def _push(self) -> None:
        readings = [volts(self.air.reading_pa(n)) for n in range(self._n)]
        counted = [min(max(round(value / _COUNT_V), 0), _MOST_COUNTS) * _COUNT_V for value in readings]
        self._gathered += struct.pack(f"<{self._n}d", *counted)

    def _flush(self) -> None:
        """Send the gathered readings to the host in one piece."""
        self._gathered_ns = self.now_ns
        if self._gathered:
            self.line.put(self._gathered)
            self._gathered = b""

    def _demand(self, dac: Dac) -> Callable[[], float]:
        def demand() -> float:
            code = min(max(int(dac.normalized_value * (_CODES - 1)), 0), _CODES - 1)
            return LOWEST_PA + SPAN_PA * code / (_CODES - 1)

        return demand
