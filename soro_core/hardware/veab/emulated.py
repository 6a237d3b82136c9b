"""The published server of the VEAB boards, with its faults: what our driver has to live with.

As read in its sources: one client; it takes 8 bytes a port with one `recv` and ends on any other number of
bytes, at a value that is not from 0 to 1, after 0.5 s of silence, and when the client leaves. When it ends it
means to write 0.5 to every DAC, but assigns to an attribute that the driver of the DAC does not have. Nothing
is written, the chips keep their voltage, and the arm its pressure.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np

from soro_core.hardware.emulation.air import Air
from soro_core.hardware.emulation.ports import ServedPorts
from soro_core.hardware.veab.config import VeabPlatform
from soro_core.hardware.veab.protocol import LOWEST_PA, SAFE, SPAN_PA, volts

_SILENCE_NS = 500_000_000
_CODES, _COUNT_V, _MOST_COUNTS = 4096, 0.005, 2047


class Dac:
    """The published program's object for a DAC, whose one property is `normalized_value`."""

    normalized_value = SAFE


class EmulatedVeabServer(ServedPorts):
    """Server, valves and air of a platform.

    In lockstep every message of the client is answered by one reading and advances everything by a cycle.

    Parameters
    ----------
    platform : VeabPlatform
        What is emulated.
    lockstep : bool
        Whether messages are the clock.
    seed : int
        Seed of the sensor noise.

    Attributes
    ----------
    ended : str or None
        Why the program has ended; its ports are held and nobody listens.
    """

    def __init__(self, platform: VeabPlatform, lockstep: bool, seed: int = 0) -> None:
        emulation = platform.emulation
        self._n, self._lockstep = platform.ports, lockstep
        super().__init__([valve.port for valve in platform.valves], emulation.step_s)
        self._period_ns = round(1e9 / (platform.cycle_hz if lockstep else emulation.push_hz))
        self._restart_ns = None if emulation.restart_s is None else round(emulation.restart_s * 1e9)
        self.dacs = [Dac() for _ in range(self._n)]
        demands = [self._demand(dac) for dac in self.dacs]
        self.air = Air(emulation.regulator, demands, np.random.default_rng(seed))
        self.ended: str | None = None
        self._wanted = [SAFE] * self._n
        self._has_client = False
        self._heard_ns = self._ended_ns = 0
        self._next_ns = self._period_ns

    def connect_faults(self, chambers: tuple[str, ...], seed: int) -> None:
        super().connect_faults(chambers, seed)
        self.faults.supported |= {"reboot"}
        self.faults.on_start["reboot"] = lambda fault: self.end("rebooted")

    def start(self) -> None:
        """Start the program again, by hand; the DACs keep their voltage until a client comes."""
        self.ended = None
        self.line.refuses = False

    def due_ns(self) -> int | None:
        return self._next_ns

    def work(self, now_ns: int) -> None:
        if self._lockstep or now_ns < self._next_ns:
            return
        self._next_ns = now_ns + self._period_ns
        if self.ended is not None:
            if self._restart_ns is not None and now_ns - self._ended_ns >= self._restart_ns:
                self.start()
        elif self._has_client and now_ns - self._heard_ns > _SILENCE_NS:
            self.end("timed out")
        elif self._has_client:
            self._serve()

    def poll(self, now_ns: int) -> None:
        pass

    def take(self, chunk: bytes) -> None:
        """What the server's `recv` gives it."""
        self._heard_ns = self.now_ns
        size = 8 * self._n
        for start in range(0, len(chunk), size):
            if self.ended is not None:
                return
            part = chunk[start : start + size]
            if len(part) != size:
                self.end(f"unpack requires a buffer of {size} bytes")
                return
            self._wanted = list(struct.unpack(f"<{self._n}d", part))
            if self._lockstep:
                self._serve()
                self.tick(self.now_ns + self._period_ns)

    def connected(self, has_host: bool) -> None:
        """Begin or end with the client."""
        if has_host and self.ended is None:
            self._has_client, self._heard_ns = True, self.now_ns
            self._wanted = [SAFE] * self._n
            if self._lockstep:
                self._push()  # as it would soon, by itself
        elif not has_host and self._has_client:
            self.end("the client has left")

    def end(self, why: str) -> None:
        """End as the published program does: the reset at its end does nothing."""
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
            if not 0.0 <= value <= 1.0:  # the DAC's driver asserts it; NaN fails it too
                self.end(f"AssertionError: {value:g} for a DAC")
                return
            dac.normalized_value = value

    def _push(self) -> None:
        readings = [volts(self.air.reading_pa(n)) for n in range(self._n)]
        counted = [min(max(round(value / _COUNT_V), 0), _MOST_COUNTS) * _COUNT_V for value in readings]
        self.line.put(struct.pack(f"<{self._n}d", *counted))

    def _demand(self, dac: Dac) -> Callable[[], float]:
        def demand() -> float:
            code = min(max(int(dac.normalized_value * (_CODES - 1)), 0), _CODES - 1)
            return LOWEST_PA + SPAN_PA * code / (_CODES - 1)

        return demand


def emulate(platform: VeabPlatform, lockstep: bool, seed: int) -> EmulatedVeabServer:
    """Emulated devices of a platform."""
    return EmulatedVeabServer(platform, lockstep, seed)
