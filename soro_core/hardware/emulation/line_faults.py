"""Faults of a line: they change, drop, add and delay bytes between host and devices, message by message."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from soro_core.hardware.emulation.faults import Faults

if TYPE_CHECKING:
    from soro_core.hardware.emulation.devices import Line

ON_BYTES = frozenset({"drop", "corrupt_bits", "truncate", "duplicate", "delay", "reorder", "garbage_line"})
# A message that waits for the one behind it goes by itself after this time.
REORDER_NS = 20_000_000


class LineFaults:
    """Faults of one line; what a family gives to `Line.put` or a host sends at once counts as one message.

    Parameters
    ----------
    faults : Faults
        What is active.
    line : Line
        Whose bytes pass here from now on.
    kinds : iterable of str
        What acts on this line; a bus with frames has most of it there.
    """

    def __init__(self, faults: Faults, line: Line, kinds: Iterable[str] = ON_BYTES) -> None:
        self._faults, self._line, self._kinds = faults, line, frozenset(kinds)
        # Messages on their way: when they are due, whether to the host, and their bytes.
        self._late: list[tuple[int, bool, bytes]] = []
        self._held: dict[bool, tuple[int, bytes]] = {}
        line.to_host = lambda chunk: self._pass(chunk, True)
        line.to_devices = lambda chunk: self._pass(chunk, False)

    def release(self) -> None:
        """Give on what has waited long enough."""
        now_ns = self._faults.now_ns
        due = [message for message in self._late if message[0] <= now_ns]
        self._late = [message for message in self._late if message[0] > now_ns]
        for to_host in [side for side, (due_ns, _) in self._held.items() if due_ns <= now_ns]:
            due.append((now_ns, to_host, self._held.pop(to_host)[1]))
        for _, to_host, chunk in due:
            if to_host:
                self._line.output += chunk
            else:
                self._line.take(chunk)

    def _pass(self, chunk: bytes, to_host: bool) -> bytes:
        if not self._faults.is_active or not chunk:
            return chunk
        if self._happens("drop"):
            return b""
        if self._happens("corrupt_bits"):
            chunk = flip_bit(chunk, self._faults)
        if self._happens("truncate"):
            chunk = chunk[: int(self._faults.rng.integers(len(chunk)))]
        if self._happens("garbage_line"):
            chunk = self._faults.rng.bytes(int(self._faults.rng.integers(1, 24))) + b"\r" + chunk
        if self._happens("duplicate"):
            chunk = chunk + chunk
        if "reorder" in self._kinds:
            chunk = self._reordered(chunk, to_host)
        delay_s = self._faults.value("delay") if "delay" in self._kinds else None
        if delay_s is not None and chunk:
            self._late.append((self._faults.now_ns + round(delay_s * 1e9), to_host, chunk))
            return b""
        return chunk

    def _happens(self, fault: str) -> bool:
        return fault in self._kinds and self._faults.happens(fault)

    def _reordered(self, chunk: bytes, to_host: bool) -> bytes:
        held = self._held.pop(to_host, None)
        if held is not None:
            return chunk + held[1]
        if self._faults.happens("reorder"):
            self._held[to_host] = (self._faults.now_ns + REORDER_NS, chunk)
            return b""
        return chunk


def flip_bit(data: bytes, faults: Faults) -> bytes:
    """Turn one bit over."""
    changed = bytearray(data)
    bit = int(faults.rng.integers(8 * len(changed)))
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)
