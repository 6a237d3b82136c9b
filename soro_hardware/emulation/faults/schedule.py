"""Scheduled and active faults of emulated devices; `fault_types` defines their names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from soro_core.errors import ConfigError
from soro_hardware.emulation.faults.fault_types import CLEAR, KINDS, Injection

# An open dump valve empties a chamber with a time constant of 5 ms; a regulator feeds it ten times slower.
_OPEN = {"burst": 200.0}


class _Entry(NamedTuple):
    injection: Injection
    start_ns: int
    end_ns: int | None


class FaultSchedule:
    """Scheduled and active faults, in emulated time.

    Parameters
    ----------
    seed : int
        Seed of `rng`.
    supported : iterable of str
        Names of the faults that the devices support.

    Attributes
    ----------
    chambers : tuple of str
        Names of the chambers, in order; empty until the platform is known.
    supported : frozenset of str
        Names of the faults that the devices support.
    on_start, on_end : dict
        Functions that the family calls when a fault of a name begins or ends.
    rng : numpy Generator
        Random numbers for the faults with a probability.
    now_ns : int
        Emulated time [ns].
    is_active : bool
        Whether any fault is active; read for every byte and frame.
    """

    def __init__(self, seed: int = 0, supported: Iterable[str] = KINDS) -> None:
        self.chambers: tuple[str, ...] = ()
        self.supported = frozenset(supported)
        self.on_start: dict[str, Callable[[Injection], None]] = {}
        self.on_end: dict[str, Callable[[Injection], None]] = {}
        self.rng = np.random.default_rng([seed, 0xFA])
        self.now_ns = 0
        self._waiting: list[_Entry] = []
        self._active: list[_Entry] = []
        self.is_active = False
        self._values: dict[str, dict[str, float]] = {}
        self._dumped: dict[str, float] = {}

    def add(self, injection: Injection) -> None:
        """Schedule a fault, relative to now; a fault that is due begins at once.

        Raises
        ------
        ConfigError
            If the devices do not support the fault, or the platform has no such chamber.
        """
        if injection.fault != CLEAR and injection.fault not in self.supported:
            allowed = f"on these devices one of {', '.join(k for k in KINDS if k in self.supported)}"
            raise ConfigError("fault", "fault", injection.fault, allowed)
        if injection.chamber and injection.chamber not in self.chambers:
            raise ConfigError(
                "fault", "chamber", injection.chamber, f"one of {', '.join(filter(None, self.chambers))}"
            )
        start_ns = self.now_ns + round(injection.at * 1e9)
        end_ns = start_ns + round(injection.duration_s * 1e9) if injection.duration_s else None
        self._waiting.append(_Entry(injection, start_ns, end_ns))
        self._waiting.sort(key=lambda entry: entry.start_ns)
        self.advance(self.now_ns)

    def advance(self, now_ns: int) -> None:
        """Begin and end the faults that are due at a time [ns]; families call it once a step."""
        self.now_ns = now_ns
        while self._waiting and self._waiting[0].start_ns <= now_ns:
            entry = self._waiting.pop(0)
            if entry.injection.fault == CLEAR:
                self.clear(entry.injection.chamber)
            else:
                self._begin(entry)
        for entry in [e for e in self._active if e.end_ns is not None and e.end_ns <= now_ns]:
            self._end(entry)

    def clear(self, chamber: str = "") -> None:
        """End the active faults and remove the scheduled ones, of one chamber or, by default, of all."""
        self._waiting = [e for e in self._waiting if chamber and e.injection.chamber != chamber]
        for entry in [e for e in self._active if not chamber or e.injection.chamber == chamber]:
            self._end(entry)

    @property
    def active(self) -> tuple[Injection, ...]:
        """Active faults."""
        return tuple(entry.injection for entry in self._active)

    @property
    def waiting(self) -> tuple[tuple[Injection, float], ...]:
        """Scheduled faults, each with the time [s] until it begins."""
        return tuple((entry.injection, (entry.start_ns - self.now_ns) * 1e-9) for entry in self._waiting)

    def value(self, fault: str, chamber: str = "") -> float | None:
        """Return the parameter of an active fault, or None."""
        return self._values.get(chamber, {}).get(fault)

    def of(self, number: int) -> Mapping[str, float]:
        """Return the active faults of a chamber, given its number, with their parameters.

        An open dump valve opens every chamber to the atmosphere, as a burst does.
        """
        if not self._values or not self.chambers:
            return {}
        return self._values.get(self.chambers[number], {}) | self._dumped

    def happens(self, fault: str) -> bool:
        """Draw whether a fault with a probability happens now."""
        p = self.value(fault)
        return p is not None and bool(self.rng.random() < p)

    def _begin(self, entry: _Entry) -> None:
        self._active.append(entry)
        self._collect()
        self.on_start.get(entry.injection.fault, _nothing)(entry.injection)

    def _end(self, entry: _Entry) -> None:
        self._active.remove(entry)
        self._collect()
        self.on_end.get(entry.injection.fault, _nothing)(entry.injection)

    def _collect(self) -> None:
        self.is_active, self._values = bool(self._active), {}
        for injection, _, _ in self._active:
            self._values.setdefault(injection.chamber, {})[injection.fault] = injection.parameter
        of_all = self._values.get("", {})
        is_open = "stop_pressed" in of_all or "dump_valve_open" in of_all
        self._dumped = _OPEN if is_open and "dump_valve_stuck" not in of_all else {}


def _nothing(_: Injection) -> None:
    return
