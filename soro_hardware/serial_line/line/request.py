"""A request to a device on a serial line, and the quality of its answer."""

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
