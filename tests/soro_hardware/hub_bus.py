"""A python-can bus on emulated devices in lockstep, without bytes and processes, for unit tests."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

import can

from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.emulation.canopen.hub import ErrorCounters
from soro_hardware.emulation.canopen.world import World
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.link import from_message


class HubBus(can.BusABC):  # type: ignore[misc]
    """The host's end of an emulated bus in lockstep; all answers to a frame arrive during `send`.

    Parameters
    ----------
    platform : CanopenPlatform
        Platform to emulate.
    seed : int
        Seed of the sensor noise and of random faults.
    """

    def __init__(self, platform: CanopenPlatform, seed: int = 0) -> None:
        self.channel_info = "emulated bus"
        self.frames: deque[Frame] = deque()
        self.world = World(platform, self.frames.append, lockstep=True, seed=seed)
        self.bus_errors: Counter[str] = Counter()
        self.world.host.report = self._on_report
        super().__init__("emulated")
        self._is_shutdown = True  # there is nothing to close
        self._closed = False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one frame."""
        self.send_frames([from_message(msg)])

    def send_frames(self, frames: Iterable[Frame]) -> None:
        """Send frames, and process everything that each of them causes."""
        self._check()
        for frame in frames:
            self.world.send(self.world.host, frame)

    def recv_frame(self, timeout_s: float) -> Frame | None:
        """Return the next frame, or None without waiting."""
        self._check()
        return self.frames.popleft() if self.frames else None

    @property
    def state(self) -> can.BusState:
        """State of the host's controller."""
        self._reopen()
        return can.BusState.ERROR if self.world.host.errors.is_off else can.BusState.ACTIVE

    def shutdown(self) -> None:
        """Close the bus; the next use resets a controller in bus-off."""
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
