"""Faults of a driver: those that stay until the next start-up of the devices, and those of old readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soro_core.arrays import Flags
from soro_hardware.platform import ReadingAge
from soro_hardware.port import Fault


class Latch(dict[tuple[str, str], Fault]):
    """Latched faults of one arm by code and source, of each the first one."""

    def add(self, code: str, source: str, message: str) -> None:
        """Latch a fault, unless one of the same code and source is latched.

        Parameters
        ----------
        code, source, message : str
            Fields of the `Fault`.
        """
        self.setdefault((code, source), Fault(code, source, message, latched=True))


class Lateness:
    """Ages of the readings of n chambers.

    Parameters
    ----------
    limits : ReadingAge
        Limits of the age.
    n : int
        Number of chambers.

    Attributes
    ----------
    missed : ndarray (n,) of int
        Number of consecutive cycles without a reading.
    """

    def __init__(self, limits: ReadingAge, n: int) -> None:
        self._limits = limits
        self.missed, self._read_ns = np.zeros(n, dtype=np.int64), np.full(n, -1, dtype=np.int64)

    def restart(self) -> None:
        """Reset all ages, at a start-up."""
        self.missed[:], self._read_ns[:] = 0, -1

    def end_cycle(
        self, fresh: Flags, now_ns: int, sources: Sequence[str], is_one_answer: bool
    ) -> list[Fault]:
        """Count a cycle and return the faults of readings that are too old.

        Parameters
        ----------
        fresh : ndarray (n,) of bool
            Whether each chamber was sampled in this cycle.
        now_ns : int
            Time of the cycle [ns].
        sources : sequence of str
            Names of the chambers in faults.
        is_one_answer : bool
            Whether one answer has all readings, so that equally late chambers are one fault.
        """
        self.missed = np.where(fresh, 0, self.missed + 1)
        self._read_ns = np.where(fresh | (self._read_ns < 0), now_ns, self._read_ns)
        late: dict[tuple[str, int], list[str]] = {}
        for n in map(int, np.flatnonzero(self.missed)):
            missed, age_ns = int(self.missed[n]), int(now_ns - self._read_ns[n])
            if self._limits.is_stale(missed, age_ns):
                answer = 0 if is_one_answer else n
                late.setdefault((self._limits.too_old(missed, age_ns), answer), []).append(sources[n])
        return [Fault("stale_reading", ", ".join(names), text) for (text, _), names in late.items()]
