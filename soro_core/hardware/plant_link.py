"""Plant link: a Unix stream socket between emulated valves and the twin that owns the arm.

The emulator sends one frame after each SYNC (lockstep) or each step (real time): magic, number of chambers,
number of spans, sequence, time; then as float64 the gauge pressures, the condition of the valves, and each
span with the targets of the valves over it.

A twin begins with a message that asks for the present frame, which comes with the sequence 0, and without
chambers where the twin is refused. One whose chambers hold the air themselves claims it with that message,
answers each frame with the pressures, and releases the air at its end. A message is magic, what it says,
number of chambers, sequence of the frame that it answers, and the pressures. All little-endian.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
from dataclasses import astuple
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.port import Array
from soro_core.hardware.reason import reason
from soro_core.pneumatics.valve_condition import ValveAction, ValveCondition

_HEADER = struct.Struct("<4sIIQq")
_MAGIC = b"SPL2"
_MESSAGE = struct.Struct("<4sIIQ")
_MESSAGE_MAGIC = b"SPM2"
_ROWS = 1 + len(ValveCondition.__dataclass_fields__)  # pressures and condition
_SEND_S = 5.0  # longest wait for an emulator that does not read
_LONGEST = 4096  # chambers and spans that a frame may have
_NO_PRESSURES = np.empty(0)


class Says(IntEnum):
    """What a message of a twin says."""

    ASK = 1
    CLAIM = 2
    ANSWER = 3
    RELEASE = 4


class PlantFrame(NamedTuple):
    """One step of the emulated world.

    Attributes
    ----------
    sequence : int
        Counts the frames from 1; 0 in the one that a twin has asked for.
    time_ns : int
        End of the step.
    pressures : ndarray (n,)
        True pressures [Pa gauge] at that time; where a twin moves the air, those that it has given last.
    action : ValveAction
        What the valves did since the frame before, without spans where no twin moves the air.
    """

    sequence: int
    time_ns: int
    pressures: Array
    action: ValveAction


class Message(NamedTuple):
    """What a twin says, of the frame with that sequence, with pressures [Pa gauge] where it answers."""

    says: Says
    sequence: int
    pressures: Array


def pack_frame(frame: PlantFrame) -> bytes:
    """Bytes of a frame."""
    spans = frame.action.spans
    header = _HEADER.pack(_MAGIC, frame.pressures.size, len(spans), frame.sequence, frame.time_ns)
    rows = np.stack([frame.pressures, *astuple(frame.action.condition)])
    held = [np.concatenate([[span], target]) for span, target in spans]
    return header + np.concatenate([rows.ravel(), *held]).astype("<f8").tobytes()


def take_frame(buffer: bytes) -> tuple[PlantFrame | None, bytes]:
    """First frame of a buffer, None where it is not complete, and what follows it.

    Raises
    ------
    ValueError
        If these are not the bytes of a plant link.
    """
    if len(buffer) < _HEADER.size:
        return None, buffer
    magic, n, n_spans, sequence, time_ns = _HEADER.unpack_from(buffer)
    _check(magic, _MAGIC, max(n, n_spans))
    count = _ROWS * n + n_spans * (1 + n)
    end = _HEADER.size + 8 * count
    if len(buffer) < end:
        return None, buffer
    values = np.frombuffer(buffer, "<f8", count, _HEADER.size).astype(np.float64)
    rows = values[: _ROWS * n].reshape(_ROWS, n)
    spans = tuple((float(row[0]), row[1:]) for row in values[_ROWS * n :].reshape(n_spans, 1 + n))
    action = ValveAction(spans, ValveCondition(*rows[1:]))
    return PlantFrame(sequence, time_ns, rows[0], action), buffer[end:]


def pack_message(message: Message) -> bytes:
    """Bytes of a message."""
    says, sequence, pressures = message
    return _MESSAGE.pack(_MESSAGE_MAGIC, says, pressures.size, sequence) + pressures.astype("<f8").tobytes()


def take_message(buffer: bytes) -> tuple[Message | None, bytes]:
    """First message of a buffer, and what follows it; as `take_frame`."""
    if len(buffer) < _MESSAGE.size:
        return None, buffer
    magic, says, n, sequence = _MESSAGE.unpack_from(buffer)
    _check(magic, _MESSAGE_MAGIC, n)
    end = _MESSAGE.size + 8 * n
    if len(buffer) < end:
        return None, buffer
    pressures = np.frombuffer(buffer, "<f8", n, _MESSAGE.size).astype(np.float64)
    return Message(Says(says), sequence, pressures), buffer[end:]


def _check(magic: bytes, expected: bytes, size: int) -> None:
    if magic != expected:
        raise ValueError(f"starts with {magic!r}")
    if size > _LONGEST:
        raise ValueError(f"{size} chambers")


class PlantLinkClient:
    """The twin's end.

    Raises
    ------
    HardwareError
        If no emulator listens at the path; later, when it has gone or sends something else.
    """

    def __init__(self, path: str | Path) -> None:
        self._path, self._buffer = str(path), b""
        self._last: PlantFrame | None = None
        self._holds_air = False
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(self._path)
        except OSError as error:
            self._socket.close()
            raise HardwareError(f"{path}: no emulator serves this plant link ({reason(error)})") from None
        self._socket.settimeout(_SEND_S)
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def receive(self, timeout_s: float) -> PlantFrame:
        """Take the next frame, in order.

        Raises
        ------
        HardwareError
            If none comes in time, or the emulator has gone.
        """
        frame = self.wait(timeout_s)
        if frame is None:
            raise HardwareError(f"{self._path}: no pressures from the emulator for {timeout_s:g} s")
        return frame

    def wait(self, timeout_s: float) -> PlantFrame | None:
        """Take the next frame, in order, or None if none comes in time; raises if the emulator has gone."""
        while (frame := self._take()) is None:
            if not self._poll.poll(1e3 * timeout_s):
                return None
            self._read()
        return frame

    def latest(self) -> PlantFrame | None:
        """Newest frame that has come, without waiting; None if there has never been one."""
        while self._poll.poll(0):
            self._read()
            while self._take() is not None:
                pass
        while self._take() is not None:
            pass
        return self._last

    def join(self, moves_air: bool, timeout_s: float = 5.0) -> PlantFrame:
        """Ask for the present frame, and with `moves_air` claim the air; what came before is old.

        Raises
        ------
        HardwareError
            If the emulator does not answer, or another twin moves the air.
        """
        self._send(Message(Says.CLAIM if moves_air else Says.ASK, 0, _NO_PRESSURES))
        while (frame := self.receive(timeout_s)).sequence:
            pass
        if not frame.pressures.size:
            raise HardwareError(f"{self._path}: another twin moves the air of these valves")
        self._holds_air = moves_air
        return frame

    def answer(self, frame: PlantFrame, pressures: Array) -> None:
        """Tell the pressures [Pa gauge] of the air at the time of a frame."""
        self._send(Message(Says.ANSWER, frame.sequence, pressures))

    def release(self) -> None:
        """Let the emulator move the air again, once, where this end has claimed it."""
        is_claimed, self._holds_air = self._holds_air, False
        if not is_claimed:
            return
        with contextlib.suppress(HardwareError):  # where it has gone there is nothing to release
            self._send(Message(Says.RELEASE, 0, _NO_PRESSURES))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _send(self, message: Message) -> None:
        try:
            self._socket.sendall(pack_message(message))
        except OSError as error:
            raise HardwareError(f"{self._path}: the emulator has gone ({reason(error)})") from None

    def _read(self) -> None:
        try:
            chunk = self._socket.recv(65536)
        except OSError as error:
            raise HardwareError(f"{self._path}: plant link broken ({reason(error)})") from None
        if not chunk:
            raise HardwareError(f"{self._path}: the emulator has gone")
        self._buffer += chunk

    def _take(self) -> PlantFrame | None:
        try:
            frame, self._buffer = take_frame(self._buffer)
        except ValueError as error:
            raise HardwareError(f"{self._path}: this is no plant link ({error})") from None
        self._last = frame or self._last
        return frame
