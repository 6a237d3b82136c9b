"""Faults of the messages of a line or a bus: lost, duplicated, late, out of order, corrupted."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Generic, TypeVar

from soro_hardware.emulation.faults.schedule import FaultSchedule
from soro_hardware.emulation.line import Line

ON_BYTES = frozenset({"drop", "corrupt_bits", "truncate", "duplicate", "delay", "reorder", "garbage_line"})
# Longest time [ns] for which a reordered message waits for the next one.
REORDER_NS = 20_000_000

Message = TypeVar("Message")


class Disorder(Generic[Message]):
    """Loses, duplicates, reorders and delays the messages of one direction, as the active faults demand."""

    def __init__(self, faults: FaultSchedule) -> None:
        self._faults = faults
        # Each with the time [ns] at which it is due; a held message is passed on before that by the next one.
        self._late: list[tuple[int, Message]] = []
        self._held: list[tuple[int, Message]] = []

    @property
    def due_ns(self) -> int | None:
        """Time [ns] at which `release` returns the next message, or None."""
        return min((due_ns for due_ns, _ in (*self._late, *self._held)), default=None)

    def take(self, message: Message, now_ns: int) -> list[Message]:
        """Return the messages that pass now, after `message` has arrived."""
        if self._faults.happens("drop"):
            return []
        passed = [message] * (2 if self._faults.happens("duplicate") else 1)
        if self._held:
            passed.append(self._held.pop()[1])
        elif self._faults.happens("reorder"):
            self._held.append((now_ns + REORDER_NS, passed.pop()))
        if (delay_s := self._faults.value("delay")) is not None:
            self._late += [(now_ns + round(delay_s * 1e9), late) for late in passed]
            return []
        return passed

    def release(self, now_ns: int) -> list[tuple[int, Message]]:
        """Return the waiting messages that are due, each with its time [ns]."""
        if not (self._late or self._held):
            return []
        waiting = sorted((*self._late, *self._held), key=lambda late: late[0])
        self._late = [late for late in self._late if late[0] > now_ns]
        self._held = [late for late in self._held if late[0] > now_ns]
        return [late for late in waiting if late[0] <= now_ns]


class LineFaults:
    """Applies the faults of one line; the bytes of one `Line.put` or one read count as one message.

    Parameters
    ----------
    faults : FaultSchedule
        Active faults.
    line : Line
        Line whose bytes the faults change.
    kinds : iterable of str
        Names of the faults that act on the line; on a CAN bus most of them act on the frames instead.
    """

    def __init__(self, faults: FaultSchedule, line: Line, kinds: Iterable[str] = ON_BYTES) -> None:
        self._faults, self._line, self._kinds = faults, line, frozenset(kinds)
        self._to_host, self._to_devices = Disorder[bytes](faults), Disorder[bytes](faults)
        line.to_host = lambda chunk: self._pass(chunk, self._to_host)
        line.to_devices = lambda chunk: self._pass(chunk, self._to_devices)

    def release(self) -> None:
        """Pass on the waiting messages that are due."""
        for _, chunk in self._to_host.release(self._faults.now_ns):
            self._line.output += chunk
        for _, chunk in self._to_devices.release(self._faults.now_ns):
            self._line.take(chunk)

    def _pass(self, chunk: bytes, disorder: Disorder[bytes]) -> bytes:
        if not self._faults.is_active or not chunk:
            return chunk
        if self._happens("corrupt_bits"):
            chunk = flip_bit(chunk, self._faults)
        if self._happens("truncate"):
            chunk = chunk[: int(self._faults.rng.integers(len(chunk)))]
        if self._happens("garbage_line"):
            chunk = self._faults.rng.bytes(int(self._faults.rng.integers(1, 24))) + b"\r" + chunk
        return b"".join(disorder.take(chunk, self._faults.now_ns)) if "drop" in self._kinds else chunk

    def _happens(self, fault: str) -> bool:
        return fault in self._kinds and self._faults.happens(fault)


def flip_bit(data: bytes, faults: FaultSchedule) -> bytes:
    """Return the data with one random bit inverted."""
    changed = bytearray(data)
    bit = int(faults.rng.integers(8 * len(changed)))
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)
