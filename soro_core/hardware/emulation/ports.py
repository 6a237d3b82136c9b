"""Emulated programs that serve numbered ports over one connection: what board and published server share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence

from soro_core.hardware.emulation.devices import EmulatedDevices, Line


class ServedLine(Line):
    """The connection of the program's host.

    Parameters
    ----------
    take : callable
        Takes bytes of the host.
    connected : callable
        Takes whether there is a host, when that has changed.
    turn_away : callable
        See `Line.turn_away`.
    """

    def __init__(
        self,
        take: Callable[[bytes], None],
        connected: Callable[[bool], None],
        turn_away: Callable[[str], bytes | None],
    ) -> None:
        super().__init__()
        self._take, self._connected, self._turn_away, self._mute = take, connected, turn_away, False

    def mute(self, on: bool) -> None:
        """Keep everything from the host."""
        self._mute = on

    def put(self, chunk: bytes) -> None:
        if not self._mute:
            super().put(chunk)

    def take(self, chunk: bytes) -> None:
        self._take(chunk)

    def turn_away(self, address: str) -> bytes | None:
        told = super().turn_away(address)
        return self._turn_away(address) if told is None else told

    def connected(self, has_host: bool) -> None:
        self._connected(has_host)


class ServedPorts(EmulatedDevices):
    """Devices of which one connection serves all; some ports feed no chamber.

    Parameters
    ----------
    ports : sequence of int
        Port of each chamber.
    step_s : float
        Step of the air in real time [s].
    """

    transport = "tcp"

    def __init__(self, ports: Sequence[int], step_s: float) -> None:
        self.line = ServedLine(
            lambda chunk: self.take(chunk),
            lambda has_host: self.connected(has_host),
            lambda address: self.turn_away(address),
        )
        self._ports = list(ports)
        super().__init__((self.line,), step_s)

    def connect_faults(self, chambers: tuple[str, ...], seed: int) -> None:
        super().connect_faults(chambers, seed)
        self.faults.supported |= {"mute"}
        self.faults.on_start["mute"] = lambda fault: self.line.mute(True)
        self.faults.on_end["mute"] = lambda fault: self.line.mute(False)

    def air_chambers(self, chambers: tuple[str, ...]) -> tuple[str, ...]:
        named = dict(zip(self._ports, chambers, strict=True))
        return tuple(named.get(port, "") for port in range(len(self.air.pressure_pa)))

    @property
    def places(self) -> list[int]:
        return self._ports

    @abstractmethod
    def take(self, chunk: bytes) -> None:
        """Take bytes of the host."""

    def turn_away(self, address: str) -> bytes | None:
        """See `Line.turn_away`; by default every host is let in, in place of the one before."""
        return None

    @abstractmethod
    def connected(self, has_host: bool) -> None:
        """Notice that the host has connected or gone."""
