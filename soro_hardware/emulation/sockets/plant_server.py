"""The emulator's end of the plant link: any number of twins, of which one may compute the pressures."""

from __future__ import annotations

import select
import selectors
from collections.abc import Callable
from pathlib import Path

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import HardwareError
from soro_core.pneumatics.valve_condition import ValveAction, healthy
from soro_hardware.emulation.sockets.plant_link import (
    Message,
    PlantFrame,
    PlantMessageType,
    pack_frame,
    take_message,
)
from soro_hardware.emulation.sockets.unix_socket import SocketClient, UnixServer

_ANSWER_S = 10.0  # longest wait for the twin
_BACKLOG = 65536  # bytes kept for a client that does not read; further frames are dropped whole


class PlantLinkServer(UnixServer):
    """The emulator's end; in lockstep it waits for the twin that computes the pressures (the owner).

    Parameters
    ----------
    path : str or Path
        Path of the Unix socket; the socket of a killed emulator is replaced.
    present_pa : callable
        Returns the true pressures (n,) [Pa gauge] of the chambers.
    selector : selector
        Event loop that calls the server when bytes have arrived.
    lockstep : bool
        Whether `pressures` waits for the answer to the last frame, at most `_ANSWER_S`.

    Attributes
    ----------
    dropped : int
        Number of frames dropped because a client did not read in time.

    Raises
    ------
    HardwareError
        If the socket cannot be made.
    """

    def __init__(
        self,
        path: str | Path,
        present_pa: Callable[[], Array],
        selector: selectors.BaseSelector,
        lockstep: bool = False,
    ) -> None:
        self.dropped = 0
        self._present_pa, self._lockstep = present_pa, lockstep
        self._sequence = self._asked = self._answered = self._time_ns = 0
        self._owner: SocketClient | None = None
        self._pressures: Array = np.empty(0)
        # Last pressures of an owner that has released the air, until the devices have read them.
        self._left: Array | None = None
        super().__init__(path, "a twin", selector)

    def publish(self, time_ns: int, pressures: Array, action: ValveAction) -> None:
        """Send one frame to every client.

        Parameters
        ----------
        time_ns : int
            Time [ns] of the end of the step.
        pressures : ndarray (n,)
            True pressures [Pa gauge].
        action : ValveAction
            Targets and condition of the valves since the last frame.
        """
        self._sequence += 1
        self._asked, self._time_ns = self._sequence, time_ns
        if not self._clients:
            return
        frame = pack_frame(PlantFrame(self._sequence, time_ns, pressures, action))
        for client in list(self._clients):
            if len(client.backlog) + len(frame) > _BACKLOG:
                self.dropped += 1
                self.write(client)
            else:
                self.write(client, frame)

    def pressures(self) -> Array | None:
        """Return the pressures (n,) [Pa gauge] of the owner, or None if there is no owner.

        In real time these are the newest ones, in lockstep the answer to the last frame. After the owner has
        released the air, its last pressures are returned once.

        Raises
        ------
        HardwareError
            If no answer arrives in lockstep.
        """
        while self._lockstep and self._owner is not None and self._answered < self._asked:
            if not select.select([self._owner.socket], [], [], _ANSWER_S)[0]:
                text = f"the twin, which computes the pressures, gave no answer for {_ANSWER_S:g} s"
                raise HardwareError(text, self.path, "silent")
            self.read(self._owner)
        if self._owner is not None:
            return self._pressures
        left, self._left = self._left, None
        return left

    def take(self, client: SocketClient) -> None:
        while True:
            message, client.received = take_message(client.received)
            if message is None:
                return
            self._handle(client, message)

    def drop(self, client: SocketClient) -> None:
        super().drop(client)
        if client is self._owner:
            self._release_air()

    def _handle(self, client: SocketClient, message: Message) -> None:
        if message.kind is PlantMessageType.ANSWER:
            self._take_answer(client, message)
            return
        if message.kind is PlantMessageType.CLAIM and self._owner in (None, client):
            # Start with the present pressures; the first answer is that to the next frame.
            self._pressures, self._asked = self._present_pa(), 0
            self._owner, self._left = client, None
        elif client is self._owner:
            self._release_air()
        if message.kind is not PlantMessageType.RELEASE:
            is_refused = message.kind is PlantMessageType.CLAIM and self._owner is not client
            self._send_present(client, np.empty(0) if is_refused else self._present_pa())

    def _take_answer(self, client: SocketClient, message: Message) -> None:
        pressures = message.pressures
        if client is not self._owner:
            raise ValueError("an answer of a twin that has not claimed the air")
        if pressures.shape != self._pressures.shape or not np.all(np.isfinite(pressures)):
            raise ValueError(f"{pressures} for {self._pressures.size} chambers")
        self._answered, self._pressures = message.sequence, pressures

    def _send_present(self, client: SocketClient, pressures: Array) -> None:
        nothing = ValveAction((), healthy(pressures.size))
        self.write(client, pack_frame(PlantFrame(0, self._time_ns, pressures, nothing)))

    def _release_air(self) -> None:
        self._owner = None
        if self._answered >= self._asked:
            self._left = self._pressures
