"""The emulated bus without bytes and processes: a python-can bus on a lockstep world, for unit tests."""

from __future__ import annotations

from collections import Counter, deque

import can

from soro_core.hardware.canopen.config import CanopenPlatform
from soro_core.hardware.emulation.error_counters import ErrorCounters
from soro_core.hardware.emulation.world import World
from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.link import from_message, to_message


class HubBus(can.BusABC):  # type: ignore[misc]
    """Host's end of an emulated bus in lockstep; what has not come with a frame sent never comes.

    Parameters
    ----------
    platform : CanopenPlatform
        What is emulated.
    seed : int
        Seed of the sensor noise.
    """

    def __init__(self, platform: CanopenPlatform, seed: int = 0) -> None:
        self.channel_info = "emulated bus"
        self._frames: deque[Frame] = deque()
        self.world = World(platform, self._frames.append, lockstep=True, seed=seed)
        self.bus_errors: Counter[str] = Counter()
        self.world.host.report = self._on_report
        super().__init__("emulated")
        self._is_shutdown = True  # there is nothing to let go
        self._closed = False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one frame; everything that it causes has happened when this returns."""
        self._check()
        self.world.host_sends(from_message(msg))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Next frame, or None at once."""
        self._check()
        return to_message(self._frames.popleft()) if self._frames else None

    @property
    def state(self) -> can.BusState:
        """State of the host's controller."""
        self._reopen()
        return can.BusState.ERROR if self.world.host.errors.is_off else can.BusState.ACTIVE

    def shutdown(self) -> None:
        """Let the bus go; a controller that had gone off comes back when it is used again."""
        self._closed = True

    def _reopen(self) -> None:
        if self._closed:
            self._closed = False
            self.world.hub.rejoin(self.world.host)

    def _check(self) -> None:
        self._reopen()
        if self.world.faults.value("adapter_unplug") is not None:
            raise can.CanOperationError("the adapter is gone")

    def _on_report(self, errors: ErrorCounters, letter: str) -> None:
        self.bus_errors.update(letter)
