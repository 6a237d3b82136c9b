"""The emulated bus without bytes and processes: a python-can bus on a lockstep world, for unit tests."""

from __future__ import annotations

from collections import deque

import can

from soro_core.hardware.emulation.world import World
from soro_core.hardware.platform import Platform
from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.link import from_message, to_message


class HubBus(can.BusABC):  # type: ignore[misc]
    """Host's end of an emulated bus in lockstep; what has not come with a frame sent never comes.

    Parameters
    ----------
    platform : Platform
        What is emulated.
    seed : int
        Seed of the sensor noise.
    """

    def __init__(self, platform: Platform, seed: int = 0) -> None:
        self.channel_info = "emulated bus"
        self._frames: deque[Frame] = deque()
        self.world = World(platform, self._frames.append, lockstep=True, seed=seed)
        super().__init__("emulated")
        self._is_shutdown = True  # there is nothing to let go

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one frame; everything that it causes has happened when this returns."""
        self.world.host_sends(from_message(msg))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Next frame, or None at once."""
        return to_message(self._frames.popleft()) if self._frames else None
