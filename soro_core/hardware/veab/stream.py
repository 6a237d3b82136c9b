"""Messages of the VEAB client: set points out in one piece, readings in, and who shares the connection."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.port import Array
from soro_core.hardware.supervisor_client import Supervisor, VentPlan, running
from soro_core.hardware.transport.tcp import ByteLink, drain
from soro_core.hardware.veab import protocol
from soro_core.hardware.veab.config import VeabPlatform

# For the supervisor. The readings that are on their way may be older than the set points, and the server
# needs its turn to write.
_ANSWER_S, _LEAST_S, _LONGEST_S = 0.02, 0.05, 10.0


class Stream:
    """Connection to a server; every failure of it is a `HardwareError` of the link.

    Attributes
    ----------
    pressure_pa : ndarray (n,)
        Newest reading [Pa gauge] of each valve, NaN before the first.
    sent_pa : ndarray (n,)
        Last set points [Pa gauge].
    supervisor : Supervisor or None
        The process that vents when this one dies.
    sent, received : int
        Messages.
    """

    def __init__(self, platform: VeabPlatform, link: ByteLink, clock: Callable[[], float]) -> None:
        self.supervisor: Supervisor | None = None
        self.sent = self.received = 0
        self._platform, self._link, self._clock = platform, link, clock
        self._ports = [valve.port for valve in platform.valves]
        self._decoder = protocol.Decoder(platform.ports)
        self._sent_s, self._is_heard = 0.0, True
        self._taken = 0
        self.pressure_pa: Array = np.full(len(self._ports), np.nan)
        self.sent_pa: Array = np.zeros(len(self._ports))

    @property
    def is_open(self) -> bool:
        """Whether there is a connection; it may have failed since."""
        return self._link.is_open

    @property
    def watched(self) -> bool:
        """Whether the process that vents when this one dies is there, where there has to be one."""
        return self.supervisor is None or (self._is_heard and self.supervisor.is_alive)

    @property
    def broken(self) -> str | None:
        """Why the readings make no sense any more, or None."""
        return self._decoder.broken

    def is_empty(self, vented_pa: float) -> bool:
        """Whether the newest reading shows every chamber below a pressure [Pa]."""
        return bool(np.all(np.abs(self.pressure_pa) < vented_pa))  # false for NaN

    @property
    def silent_s(self) -> float:
        """Time since the last set points."""
        return self._clock() - self._sent_s

    @property
    def has_new(self) -> bool:
        """Whether a reading has come since `take_new`."""
        return self.received != self._taken

    def take_new(self) -> bool:
        """Whether a reading has come since the last call."""
        new, self._taken = self.has_new, self.received
        return new

    def supervise(self) -> None:
        """Start the process that vents when this one dies, unless it is there."""
        self.supervisor, self._is_heard = running(self.supervisor), True
        self.supervisor.wait_until_ready()  # before there is a connection: the server waits 0.5 s at most
        if self.is_open:
            self._share()

    def open(self) -> bool:
        """Connect, unless there is a connection in order: the server ends without it; whether it did."""
        if self.is_open and not self.broken:
            with contextlib.suppress(HardwareError):  # it has gone meanwhile
                self.drain()
        if self.is_open and not self.broken:
            return False
        self._link.open()
        self._begin()
        return True

    def reconnect(self) -> bool:
        """Take one step, without waiting, to get a lost connection back; True once it stands."""
        if self.is_open:
            return True
        if not self._link.reconnect():
            return False
        self._begin()
        return True

    def give_up(self) -> None:
        """Leave the server, here and in the process that shares the connection."""
        self._link.close()
        if self.supervisor is not None:
            self.supervisor.let_go()

    def close(self, vented: bool) -> None:
        """Leave the server; where the arm is not known to be empty the other process goes on venting."""
        self._link.close()
        if self.supervisor is not None:
            self.supervisor.dismiss(vented)

    def send(self, setpoint_pa: Array) -> None:
        """Send set points [Pa gauge] (n,); unused ports are asked for 0 Pa."""
        values = [0.0] * self._platform.ports
        for n, port in enumerate(self._ports):
            values[port] = float(setpoint_pa[n])
        self.sent_pa = np.array(setpoint_pa, dtype=np.float64)
        self._sent_s = self._clock()
        self._link.send(protocol.encode(values))
        self.sent += 1
        if self.supervisor is not None:
            self._is_heard = self.supervisor.watches(bool(self.sent_pa.any()))

    def receive(self, timeout_s: float) -> bool:
        """Take what has come, waiting for it at most so long; whether anything came."""
        chunk = self._link.receive(timeout_s)
        for reading in self._decoder.feed(chunk):
            self.received += 1
            self.pressure_pa = np.array([reading[port] for port in self._ports])
        return bool(chunk)

    def drain(self) -> None:
        """Take what has come, without waiting; without an end to it the stream makes no sense."""
        if not drain(self.receive):
            self._decoder.broken = self._decoder.broken or "readings without a pause"

    def _begin(self) -> None:
        self._decoder.reset()
        self._share()

    def _share(self) -> None:
        if self.supervisor is None:
            return
        ports, vented_pa = self._platform.ports, self._platform.host.vented_pa
        step = {
            "send": protocol.encode([0.0] * ports).decode("latin-1"),
            "doubles": ports,
            "low": protocol.volts(-vented_pa),
            "high": protocol.volts(vented_pa),
        }
        plan = VentPlan("VEAB server", (step,), _ANSWER_S, _LONGEST_S, least_s=_LEAST_S)
        self.supervisor.hold([plan], [self._link.fileno()])
