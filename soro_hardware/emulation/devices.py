"""Emulated devices of any family: lines of bytes, and a clock that the caller advances."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import ClassVar, Literal

import numpy as np

from soro_core.arrays import Array
from soro_core.pneumatics.valve_condition import ValveAction
from soro_hardware.emulation.air import EmulatedPressures
from soro_hardware.emulation.faults.fault_types import OF_THE_AIR, Injection
from soro_hardware.emulation.faults.line_faults import ON_BYTES, LineFaults
from soro_hardware.emulation.faults.schedule import FaultSchedule
from soro_hardware.emulation.line import Line
from soro_hardware.platform import PlatformBase

LONGEST_STEP_NS = 20_000_000


class EmulatedDevices(ABC):
    """Emulated devices of one platform, with the air of their chambers; the caller advances the time.

    In real time `run` advances the time. In lockstep each cycle of the host does: the family calls
    `end_cycle` when it receives the last message of the cycle.

    Parameters
    ----------
    platform : PlatformBase
        Platform to emulate.
    lockstep : bool
        Whether the host's cycles advance the time.
    seed : int
        Seed of the sensor noise and of random faults.

    Attributes
    ----------
    transport : str
        Transport of `lines`: pseudo-terminals, or TCP on this machine.
    air : EmulatedPressures
        Chamber pressures; `connect_air` makes it.
    line_faults : frozenset of str
        Faults that act on the bytes of a line.
    lines : tuple of Line
        One line for each port.
    now_ns : int
        Emulated time [ns].
    period_ns : int
        Length of a cycle [ns].
    ticks : int
        Number of steps of the air.
    on_tick : callable
        Called after each step of the air with time [ns], true pressures (n,) [Pa gauge] and valve action.
    faults : FaultSchedule
        Faults of the devices; `on_fault` adds those of the family.
    """

    transport: ClassVar[Literal["pty", "tcp"]] = "pty"
    line_faults: ClassVar[frozenset[str]] = ON_BYTES
    air: EmulatedPressures

    def __init__(self, platform: PlatformBase, lockstep: bool, seed: int = 0) -> None:
        self.lockstep, self.period_ns = lockstep, round(1e9 / platform.cycle_hz)
        self.lines: tuple[Line, ...] = ()
        self.now_ns = self.ticks = 0
        self.on_tick: Callable[[int, Array, ValveAction], None] = lambda time_ns, pressures, action: None
        self.faults = FaultSchedule(seed, OF_THE_AIR | ON_BYTES | {"adapter_unplug"})
        self.faults.on_start["set_by_another"] = self._set_by_another
        self._model, self._chambers, self._seed = platform.regulator, platform.chamber_names, seed
        self._step_ns = self._next_step_ns = round(platform.emulation.step_s * 1e9)
        self._on_lines: list[LineFaults] = []

    def add_line(self, line: Line) -> None:
        """Add a line."""
        self.lines = (*self.lines, line)
        self._on_lines.append(LineFaults(self.faults, line, self.line_faults))

    def connect_air(
        self, demands: Sequence[Callable[[], float | None]], places: Iterable[int] | None = None
    ) -> None:
        """Make the air of the valves.

        Parameters
        ----------
        demands : sequence of callables
            One for each valve; returns its present set point [Pa gauge], or None while it vents.
        places : iterable of int, optional
            Number of the valve of each chamber of the platform; by default 0, 1, and so on.
        """
        self.places = list(range(len(demands)) if places is None else places)
        named = dict(zip(self.places, self._chambers, strict=True))
        self.faults.chambers = tuple(named.get(place, "") for place in range(len(demands)))
        self.air = EmulatedPressures(self._model, demands, np.random.default_rng(self._seed), self.faults)

    def on_fault(
        self, fault: str, begin: Callable[[int], None], end: Callable[[int], None] = lambda place: None
    ) -> None:
        """Support a device fault.

        Parameters
        ----------
        fault : str
            Name of the fault.
        begin, end : callable
            Called when the fault begins and when it ends, with the number of the valve.
        """
        self.faults.supported |= {fault}
        self.faults.on_start[fault] = lambda injection: begin(self._place_of(injection))
        self.faults.on_end[fault] = lambda injection: end(self._place_of(injection))

    def while_fault(self, fault: str, switch: Callable[[int, bool], None]) -> None:
        """Support a device fault by a switch, which is called with the number of the valve and on or off."""
        self.on_fault(fault, lambda place: switch(place, True), lambda place: switch(place, False))

    @property
    def pressure_pa(self) -> Array:
        """True pressures (n,) [Pa gauge] of the chambers."""
        return self.air.pressure_pa[self.places]

    def connect_plant(self, plant_pa: Callable[[], Array | None]) -> None:
        """Let a plant compute the chamber pressures; see `EmulatedPressures.connect_plant`."""
        self.air.connect_plant(plant_pa, self.places)

    @property
    def next_event_ns(self) -> int:
        """Time [ns] of the next event, in real time."""
        due = self.due_ns()
        return self._next_step_ns if due is None else min(due, self._next_step_ns)

    def run(self, now_ns: int) -> int:
        """Advance to a time [ns], in real time; return by how much the emulated time stays behind it [ns].

        After a stall of the process the emulated time advances by 20 ms at most. Otherwise the watchdogs of
        the devices would trip before the bytes that wait in the lines are read.
        """
        behind = max(now_ns - self.now_ns - LONGEST_STEP_NS, 0)
        target = now_ns - behind
        while self.next_event_ns <= target:
            self.now_ns = max(self.next_event_ns, self.now_ns)
            self.work(self.now_ns)
            if self.now_ns >= self._next_step_ns:
                self._next_step_ns += self._step_ns
                self.tick(self.now_ns)
        self.now_ns = max(target, self.now_ns)
        self.work(self.now_ns)
        return behind

    def end_cycle(self, is_cycle: bool = True) -> None:
        """Advance by one cycle, in lockstep; `is_cycle` as in `tick`."""
        self.tick(self.now_ns + self.period_ns, is_cycle)

    def tick(self, now_ns: int, is_cycle: bool = True) -> None:
        """Advance the air, the faults and the devices to a time [ns].

        Steps with `is_cycle` are published to the twin. In lockstep the twin advances by each of them, so
        the time of the start-up of the devices is not published.
        """
        self.now_ns = now_ns
        self.ticks += 1
        self.air.advance(now_ns)
        action = self.air.take_action()
        if is_cycle:  # first, because the twin may change the pressures
            self.on_tick(now_ns, self.pressure_pa, action)
        self.faults.advance(now_ns)
        for line in self._on_lines:
            line.release()
        self.poll(now_ns)
        self.work(now_ns)

    @abstractmethod
    def give_setpoint(self, place: int, pressure_pa: float) -> None:
        """Set the set point [Pa gauge] of a valve, as its front panel does."""

    def due_ns(self) -> int | None:
        """Return the time [ns] of the next byte or frame on a line, or None while all lines are idle."""
        return None

    def work(self, now_ns: int) -> None:  # noqa: B027 - devices that answer at once have nothing to do
        """Process the bytes and frames that are due on the lines."""

    def poll(self, now_ns: int) -> None:  # noqa: B027 - devices without watchdogs have nothing to do
        """Process the events of the devices that depend on time: watchdogs, boots, periodic messages."""

    def _set_by_another(self, injection: Injection) -> None:
        self.air.advance(self.now_ns)
        self.give_setpoint(self._place_of(injection), injection.parameter)

    def _place_of(self, injection: Injection) -> int:
        return self.faults.chambers.index(injection.chamber)


class ServedDevices(EmulatedDevices):
    """Devices behind one TCP connection, which a fault can mute; parameters as in `EmulatedDevices`."""

    transport = "tcp"

    def __init__(self, platform: PlatformBase, lockstep: bool, seed: int = 0) -> None:
        super().__init__(platform, lockstep, seed)
        self.line = _HostLine(self)
        self.add_line(self.line)
        self.while_fault("mute", lambda _, is_on: self.line.mute(is_on))

    @abstractmethod
    def take(self, chunk: bytes) -> None:
        """Process bytes of the host; `self.line.put` sends the answer."""

    def refuse_host(self, address: str) -> bytes | None:
        """Return the refusal of a new host as `Line.refuse_host`; by default it replaces the present host."""
        return None

    def connected(self, has_host: bool) -> None:
        """Process that the host has connected or disconnected."""


class _HostLine(Line):
    """The connection to the host."""

    def __init__(self, devices: ServedDevices) -> None:
        super().__init__()
        self._devices, self._is_mute = devices, False

    def mute(self, on: bool) -> None:
        """Send nothing to the host while `on`."""
        self._is_mute = on

    def put(self, chunk: bytes) -> None:
        if not self._is_mute:
            super().put(chunk)

    def take(self, chunk: bytes) -> None:
        self._devices.take(chunk)

    def refuse_host(self, address: str) -> bytes | None:
        refusal = super().refuse_host(address)
        return self._devices.refuse_host(address) if refusal is None else refusal

    def connected(self, has_host: bool) -> None:
        self._devices.connected(has_host)
