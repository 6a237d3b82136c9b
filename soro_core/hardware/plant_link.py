"""Plant link: a Unix stream socket between emulated valves and the twin that owns the arm.

The emulator sends one frame after each SYNC (lockstep) or each step (real time): magic, number of chambers,
number of spans, sequence, time; then as float64 the true gauge pressures, the condition of the valves, and
each span with the targets of the valves over it. A twin whose chambers hold the air themselves sends the
pressures back: magic, number of chambers, sequence of the frame that it answers, and the pressures; no
chambers: the air is the emulator's again. All little-endian.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
from dataclasses import astuple
from pathlib import Path
from typing import NamedTuple

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.port import Array
from soro_core.hardware.reason import reason
from soro_core.pneumatics.valve_condition import ValveAction, ValveCondition

_HEADER = struct.Struct("<4sIIQq")
_MAGIC = b"SPL2"
_ANSWER = struct.Struct("<4sIQ")
_ANSWER_MAGIC = b"SPA2"
_ROWS = 1 + len(ValveCondition.__dataclass_fields__)  # pressures and condition
_SEND_S = 5.0  # longest wait for an emulator that does not read
_LONGEST = 4096  # chambers and spans that a frame may have


class PlantFrame(NamedTuple):
    """Pressures [Pa gauge] at a time of the emulated world, and what the valves do up to it from then before.

    `sequence` counts the frames from 1; without a twin that moves the air `action` has no spans.
    """

    sequence: int
    time_ns: int
    pressures: Array
    action: ValveAction


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


def pack_answer(sequence: int, pressures: Array) -> bytes:
    """Bytes of an answer to the frame of that sequence, 0 before the first one."""
    return _ANSWER.pack(_ANSWER_MAGIC, pressures.size, sequence) + pressures.astype("<f8").tobytes()


def take_answer(buffer: bytes) -> tuple[tuple[int, Array] | None, bytes]:
    """Sequence and pressures of the first answer in a buffer, and what follows; as `take_frame`."""
    if len(buffer) < _ANSWER.size:
        return None, buffer
    magic, n, sequence = _ANSWER.unpack_from(buffer)
    _check(magic, _ANSWER_MAGIC, n)
    end = _ANSWER.size + 8 * n
    if len(buffer) < end:
        return None, buffer
    return (sequence, np.frombuffer(buffer, "<f8", n, _ANSWER.size).astype(np.float64)), buffer[end:]


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

    def answer(self, pressures: Array) -> None:
        """Tell the pressures [Pa gauge] of the air after the last frame, which is moved here from now on."""
        self._send(pack_answer(0 if self._last is None else self._last.sequence, pressures))

    def release(self) -> None:
        """Let the emulator move the air again."""
        with contextlib.suppress(HardwareError):  # where it has gone there is nothing to release
            self._send(pack_answer(0, np.empty(0)))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _send(self, answer: bytes) -> None:
        try:
            self._socket.sendall(answer)
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
