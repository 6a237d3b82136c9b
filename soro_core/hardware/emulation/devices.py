"""What the emulator's process needs of the emulated devices of any family: lines of bytes, and time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Literal

from soro_core.hardware.emulation.air import Air
from soro_core.hardware.emulation.faults import OF_THE_AIR, Faults
from soro_core.hardware.emulation.line_faults import ON_BYTES, LineFaults
from soro_core.hardware.port import Array
from soro_core.pneumatics.valve_condition import ValveAction

LONGEST_STEP_NS = 20_000_000


class Line(ABC):
    """One stream of bytes between the host and the devices: a serial port, an adapter, a connection.

    Every byte passes `to_devices` or `to_host`, in which faults change, add and drop bytes.

    Attributes
    ----------
    output : bytearray
        Bytes that the host may have now; the process takes them from the front.
    transport : str
        How the process serves this line; empty for what is usual on the family's devices.
    hang_up : bool
        Set by the devices to have the connection closed; TCP only.
    refuses : bool
        Set by the devices while nobody listens for a new connection; TCP only.
    """

    transport: ClassVar[Literal["", "pty", "tcp"]] = ""

    def __init__(self) -> None:
        self.output = bytearray()
        self.hang_up = self.refuses = False
        self.to_devices: Callable[[bytes], bytes] = _unchanged
        self.to_host: Callable[[bytes], bytes] = _unchanged

    def feed(self, chunk: bytes) -> None:
        """Take bytes from the host, at the time that the devices have been advanced to."""
        self.take(self.to_devices(chunk))

    def put(self, chunk: bytes) -> None:
        """Give bytes to the host."""
        self.output += self.to_host(chunk)

    @abstractmethod
    def take(self, chunk: bytes) -> None:
        """Do what the bytes say; the family's part of `feed`."""

    def turn_away(self, address: str) -> bytes | None:
        """What a new host of this IP address is told before it is hung up on; None lets it in. TCP only."""
        return b"" if self.refuses else None

    def connected(self, has_host: bool) -> None:  # noqa: B027 - a line that cannot tell does nothing
        """Notice that the host has connected or gone; pseudo-terminals cannot tell, TCP can."""


class EmulatedDevices(ABC):
    """Emulated devices of one platform with the air behind them; all time is given from outside.

    In real time `run` advances everything. In lockstep the host does, with whatever ends its cycle on the
    family's line; the family then calls `tick`.

    Attributes
    ----------
    transport : str
        How the process serves `lines`: pseudo-terminals, or TCP on this machine.
    lines : tuple of Line
        One for each port.
    now_ns : int
        Time of the emulated world.
    ticks : int
        Steps of the air so far.
    stalled_ns : int
        Time that the world has been held up.
    on_tick : callable
        Takes the time, the true pressures [Pa gauge] and what the valves did, after each step of the air.
    faults : Faults
        What is wrong with them; `connect_faults` says what the family routes.
    """

    transport: ClassVar[Literal["pty", "tcp"]] = "pty"
    air: Air

    def __init__(self, lines: tuple[Line, ...], step_s: float) -> None:
        self.lines = lines
        self.now_ns = self.ticks = self.stalled_ns = 0
        self.on_tick: Callable[[int, Array, ValveAction], None] = lambda time_ns, pressures, action: None
        self._step_ns = round(step_s * 1e9)
        self._next_step_ns = self._step_ns
        self.faults = Faults(supported=())
        self._line_faults: list[LineFaults] = []

    def connect_faults(self, chambers: tuple[str, ...], seed: int) -> None:
        """Let faults act on the air and on every line; a family adds what only it has."""
        self.faults = self.air.faults = Faults(seed, OF_THE_AIR | ON_BYTES | {"adapter_unplug"})
        self.faults.chambers = self.air_chambers(chambers)
        self._line_faults = [LineFaults(self.faults, line) for line in self.lines]

    def air_chambers(self, chambers: tuple[str, ...]) -> tuple[str, ...]:
        """Chamber at each place of the air, empty for a valve that feeds none; the platform's, by default."""
        return chambers

    @property
    def pressure_pa(self) -> Array:
        """True pressures [Pa gauge] of the chambers."""
        return self.air.pressure_pa[self.places]

    @property
    def places(self) -> list[int]:
        """Valve of each chamber, its place in the air."""
        return list(range(len(self.air.pressure_pa)))

    def connect_plant(self, plant_pa: Callable[[], Array | None]) -> None:
        """Let a plant move the air of the chambers; see `Air.connect_plant`."""
        self.air.connect_plant(plant_pa, self.places)

    @property
    def next_event_ns(self) -> int:
        """Time at which `run` has something to do, in real time."""
        due = self.due_ns()
        return self._next_step_ns if due is None else min(due, self._next_step_ns)

    def run(self, now_ns: int) -> int:
        """Advance to a time, in real time; return how far the world stays behind it [ns].

        A world whose process was held up does not catch up with more than 20 ms: its devices would miss
        what is only waiting to be read, which real devices do not.
        """
        behind = max(now_ns - self.now_ns - LONGEST_STEP_NS, 0)
        self.stalled_ns += behind
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

    def tick(self, now_ns: int, is_cycle: bool = True) -> None:
        """Advance the air to a time, and let the devices look at the clock.

        In lockstep the twin takes each step that it hears of for a cycle of the control loop: of time that
        passes while the host starts its devices, it is told nothing.
        """
        self.now_ns = now_ns
        self.ticks += 1
        self.air.advance(now_ns)
        action = self.air.take_action()
        if is_cycle:  # before anybody looks at the air: it may be moved by who hears of this
            self.on_tick(now_ns, self.air.pressure_pa[self.places], action)
        self.faults.advance(now_ns)
        for line in self._line_faults:
            line.release()
        self.poll(now_ns)
        self.work(now_ns)

    @abstractmethod
    def due_ns(self) -> int | None:
        """Time of the next byte or frame on a line, or None while all are idle."""

    @abstractmethod
    def work(self, now_ns: int) -> None:
        """Carry out what is due on the lines."""

    @abstractmethod
    def poll(self, now_ns: int) -> None:
        """Let the devices act on time that has passed: watchdogs, boots, periodic messages."""


def _unchanged(chunk: bytes) -> bytes:
    return chunk
