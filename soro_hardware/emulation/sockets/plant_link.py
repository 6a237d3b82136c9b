"""Plant link: a Unix stream socket between emulated valves and the twin of the arm.

The emulator sends one frame after each SYNC (lockstep) or each step (real time): magic, number of chambers,
number of spans, sequence, time; then as float64 the gauge pressures, the condition of the valves, and each
span with the targets of the valves during it.

A twin first sends a message that requests the present frame. That frame has the sequence 0; it has no
chambers if the emulator refuses the twin. A twin that computes the chamber pressures claims the air with its
first message, answers each frame with the pressures, and releases the air at its end. A message is magic,
kind, number of chambers, sequence of the answered frame, and the pressures. All numbers are little-endian.
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

from soro_core.arrays import Array
from soro_core.errors import HardwareError
from soro_core.pneumatics.valve_condition import ValveAction, ValveCondition
from soro_hardware.error_text import reason

_HEADER = struct.Struct("<4sIIQq")
_MAGIC = b"SPL2"
_MESSAGE = struct.Struct("<4sIIQ")
_MESSAGE_MAGIC = b"SPM2"
_ROWS = 1 + len(ValveCondition.__dataclass_fields__)  # pressures and condition
_SEND_S = 5.0  # longest wait [s] for an emulator that does not read
_LONGEST = 4096  # largest number of chambers and of spans in a frame
_NO_PRESSURES = np.empty(0)


class PlantMessageType(IntEnum):
    """Kinds of messages of a twin."""

    ASK = 1
    CLAIM = 2
    ANSWER = 3
    RELEASE = 4


class PlantFrame(NamedTuple):
    """One step of the emulated valves.

    Attributes
    ----------
    sequence : int
        Number of the frame, from 1; 0 in a frame that a twin has requested.
    time_ns : int
        Time [ns] of the end of the step.
    pressures : ndarray (n,)
        True pressures [Pa gauge] at that time; if a twin computes them, its last answer.
    action : ValveAction
        Targets and condition of the valves since the last frame; targets only if a twin computes pressures.
    """

    sequence: int
    time_ns: int
    pressures: Array
    action: ValveAction


class Message(NamedTuple):
    """A message of a twin; an answer has the sequence of its frame and the pressures (n,) [Pa gauge]."""

    kind: PlantMessageType
    sequence: int
    pressures: Array


def pack_frame(frame: PlantFrame) -> bytes:
    """Return the bytes of a frame."""
    spans = frame.action.spans
    header = _HEADER.pack(_MAGIC, frame.pressures.size, len(spans), frame.sequence, frame.time_ns)
    rows = np.stack([frame.pressures, *astuple(frame.action.condition)])
    held = [np.concatenate([[span], target]) for span, target in spans]
    return header + np.concatenate([rows.ravel(), *held]).astype("<f8").tobytes()


def take_frame(buffer: bytes) -> tuple[PlantFrame | None, bytes]:
    """Return the first frame of a buffer, None if it is not complete, and the bytes after it.

    Raises
    ------
    ValueError
        If the bytes are not those of a plant link.
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
    """Return the bytes of a message."""
    kind, sequence, pressures = message
    return _MESSAGE.pack(_MESSAGE_MAGIC, kind, pressures.size, sequence) + pressures.astype("<f8").tobytes()


def take_message(buffer: bytes) -> tuple[Message | None, bytes]:
    """Return the first message of a buffer, and the bytes after it, as `take_frame`."""
    if len(buffer) < _MESSAGE.size:
        return None, buffer
    magic, kind, n, sequence = _MESSAGE.unpack_from(buffer)
    _check(magic, _MESSAGE_MAGIC, n)
    end = _MESSAGE.size + 8 * n
    if len(buffer) < end:
        return None, buffer
    pressures = np.frombuffer(buffer, "<f8", n, _MESSAGE.size).astype(np.float64)
    return Message(PlantMessageType(kind), sequence, pressures), buffer[end:]


def _check(magic: bytes, expected: bytes, size: int) -> None:
    if magic != expected:
        raise ValueError(f"starts with {magic!r}")
    if size > _LONGEST:
        raise ValueError(f"{size} chambers")


class PlantLinkClient:
    """The twin's end of the plant link.

    Parameters
    ----------
    path : str or Path
        Path of the Unix socket.

    Raises
    ------
    HardwareError
        If no emulator listens at the path; in the methods, if the emulator has ended or sends other bytes.
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
            raise HardwareError(
                f"no emulator serves this plant link ({reason(error)})", path, "open"
            ) from None
        self._socket.settimeout(_SEND_S)
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def receive(self, timeout_s: float) -> PlantFrame:
        """Return the next frame; `timeout_s` is the longest wait [s].

        Raises
        ------
        HardwareError
            If no frame arrives in time, or the emulator has ended.
        """
        frame = self.wait(timeout_s)
        if frame is None:
            raise HardwareError(f"no pressures from the emulator for {timeout_s:g} s", self._path, "silent")
        return frame

    def wait(self, timeout_s: float) -> PlantFrame | None:
        """Return the next frame, or None after `timeout_s` [s]; raises if the emulator has ended."""
        while (frame := self._take()) is None:
            if not self._poll.poll(1e3 * timeout_s):
                return None
            self._read()
        return frame

    def latest(self) -> PlantFrame | None:
        """Return the newest frame without waiting; None before the first one."""
        while self._poll.poll(0):
            self._read()
            while self._take() is not None:
                pass
        while self._take() is not None:
            pass
        return self._last

    def join(self, moves_air: bool, timeout_s: float = 5.0) -> PlantFrame:
        """Request the present frame, and drop earlier ones.

        Parameters
        ----------
        moves_air : bool
            Whether to claim the air: this twin then computes the chamber pressures.
        timeout_s : float
            Longest wait [s] for each frame.

        Raises
        ------
        HardwareError
            If the emulator does not answer, or another twin has claimed the air.
        """
        self._send(Message(PlantMessageType.CLAIM if moves_air else PlantMessageType.ASK, 0, _NO_PRESSURES))
        while (frame := self.receive(timeout_s)).sequence:
            pass
        if not frame.pressures.size:
            raise HardwareError("another twin computes the pressures of these valves", self._path, "refused")
        self._holds_air = moves_air
        return frame

    def answer(self, frame: PlantFrame, pressures: Array) -> None:
        """Send the pressures (n,) [Pa gauge] at the time of a frame."""
        self._send(Message(PlantMessageType.ANSWER, frame.sequence, pressures))

    def release(self) -> None:
        """Release the air if this twin has claimed it: the emulator computes the pressures again."""
        is_claimed, self._holds_air = self._holds_air, False
        if not is_claimed:
            return
        with contextlib.suppress(HardwareError):  # the emulator may have ended
            self._send(Message(PlantMessageType.RELEASE, 0, _NO_PRESSURES))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _send(self, message: Message) -> None:
        try:
            self._socket.sendall(pack_message(message))
        except OSError as error:
            raise HardwareError(f"the emulator has ended ({reason(error)})", self._path, "gone") from None

    def _read(self) -> None:
        try:
            chunk = self._socket.recv(65536)
        except OSError as error:
            raise HardwareError(f"plant link broken ({reason(error)})", self._path, "gone") from None
        if not chunk:
            raise HardwareError("the emulator has ended", self._path, "gone")
        self._buffer += chunk

    def _take(self) -> PlantFrame | None:
        try:
            frame, self._buffer = take_frame(self._buffer)
        except ValueError as error:
            raise HardwareError(f"this is no plant link ({error})", self._path, "refused") from None
        self._last = frame or self._last
        return frame
