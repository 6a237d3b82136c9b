"""A request to a device on a serial line; its answer, split into lines, and the quality of that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

# Quality of an answer: good, invalid, possibly for another request, or a refusal.
Outcome: TypeAlias = Literal["good", "garbled", "mismatch", "refused"]


@dataclass(frozen=True)
class Request:
    """One request; `kind` is the kind of its answer, `counts` the sent set point."""

    data: bytes
    kind: str
    counts: int = 0


def format_bytes(data: bytes) -> str:
    """Return the bytes of a line as text for errors."""
    return repr(data.decode("ascii", "replace").strip())


LONGEST_LINE = 120


class LineSplitter:
    """Splits bytes into lines; every terminator byte ends a line, and empty lines are dropped."""

    def __init__(self, terminators: bytes) -> None:
        self._terminators = terminators
        self._rest = bytearray()
        self.overlong = 0

    def feed(self, chunk: bytes) -> list[bytes]:
        """Process bytes; return the complete lines without their ends."""
        lines = []
        for byte in chunk:
            if byte in self._terminators:
                if self._rest:
                    lines.append(bytes(self._rest))
                self._rest.clear()
            else:
                self._rest.append(byte)
                if len(self._rest) > LONGEST_LINE:
                    self._rest.clear()
                    self.overlong += 1
        return lines

    def clear(self) -> None:
        """Drop an incomplete line."""
        self._rest.clear()
