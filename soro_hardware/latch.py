"""Faults that stay until the next start-up of the devices."""

from __future__ import annotations

from collections.abc import Iterator

from soro_hardware.port import Fault


class Latch:
    """Latched faults of one arm: the first one of each code and source."""

    def __init__(self) -> None:
        self._faults: dict[tuple[str, str], Fault] = {}

    def add(self, code: str, source: str, message: str) -> None:
        """Latch a fault, unless one of the same code and source is latched.

        Parameters
        ----------
        code, source, message : str
            Fields of the `Fault`.
        """
        self._faults.setdefault((code, source), Fault(code, source, message, latched=True))

    def has(self, code: str, source: str) -> bool:
        """Return whether a fault of this code and source is latched."""
        return (code, source) in self._faults

    def drop(self, code: str, source: str) -> None:
        """Remove a fault."""
        self._faults.pop((code, source), None)

    def clear(self) -> None:
        """Remove all faults, at the begin of a start-up."""
        self._faults.clear()

    def __iter__(self) -> Iterator[Fault]:
        return iter(tuple(self._faults.values()))

    def __len__(self) -> int:
        return len(self._faults)
