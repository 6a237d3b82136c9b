"""What a run of the benchmarks is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

Choice = TypeVar("Choice")


@dataclass(frozen=True)
class Options:
    """Settings that every section sees."""

    peer: bool
    """Measure the peer too."""
    quick: bool
    """The smallest settings that go through every line: for tests, not for figures."""
    folder: Path
    """Where the results and pictures go."""
    say: Callable[[str], None] = lambda text: None
    """Progress."""
    minutes: float = 0.0
    """Minutes of each scene of `force` that nothing touches; 0: none is run."""
    seeds: int = 5
    """Seeds of the closed loop, from 1 on."""
    arms: int = 100
    """Random arms in the closed loop."""
    jobs: int | None = None
    """Random arms at a time; None: one a core."""
    dask: str = ""
    """Address of a Dask cluster that runs them instead; empty for none."""

    @property
    def repeats(self) -> int:
        """Samples of each time."""
        return 1 if self.quick else 9

    def pick(self, full: Choice, quick: Choice) -> Choice:
        """One of the two, by the settings."""
        return quick if self.quick else full
