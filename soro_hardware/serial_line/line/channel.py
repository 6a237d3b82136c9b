"""One device on a serial line: its next request, the meaning of its answers, its faults."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from typing import Any

from soro_hardware.latch import Latch
from soro_hardware.port import EMPTY_PA, Fault
from soro_hardware.serial_line.config import LineOptions
from soro_hardware.serial_line.line.request import Outcome, Request, format_bytes
from soro_hardware.serial_line.line.session import StartupSession
from soro_hardware.serial_line.line.setpoint import SlewedSetpoint

_FIRST_TURNS = 4  # turns before the others of a device that is not at 0: ask again, 0, a reading, once more
STRIKES = 3  # consecutive wrong answers that are a fault, not a disturbance of the line


class Channel(ABC):
    """State of one device, in its own counts.

    While 0 is wanted and the device has not shown 0, zeros and readings alternate: the front panel or another
    program may have set the device, or it may have its own set point at power-on.

    Parameters
    ----------
    chamber : str
        Name of the chamber.
    place : str
        Place of the device, for messages.
    resolution_pa : float
        Pressure of one count [Pa].
    low, high : int
        Smallest and largest set point in counts.
    options : LineOptions
        Times of the line.

    Attributes
    ----------
    pressure_pa : float
        Newest reading [Pa gauge]; NaN before the first.
    fresh : bool
        Whether the reading arrived in this exchange.
    latched : Latch
        Latch of the driver, for all devices.
    setpoint : SlewedSetpoint
        Set point on its way to the caller's.
    strikes : Counter
        Number of consecutive wrong answers of each kind.
    confirmed : int or None
        Last set point that the device has shown; None if another one was sent since, if the shown set point
        is impossible, or if the device is silent.
    """

    wake: bytes  # request that a device answers as soon as it has booted

    def __init__(
        self, chamber: str, place: str, resolution_pa: float, low: int, high: int, options: LineOptions
    ) -> None:
        self.chamber, self.source, self.options = chamber, f"{chamber} ({place})", options
        self.latched = Latch()
        self.strikes: Counter[str] = Counter()
        self.setpoint = SlewedSetpoint(resolution_pa, low, high, options.slew_pa_s)
        self.pressure_pa = math.nan
        self.fresh = False
        self.restart(0)
        self._unsee()

    def restart(self, now_ns: int) -> None:
        """Reset the state after a start-up, with the device at 0."""
        self.setpoint.restart(now_ns)
        self.confirmed: int | None = 0
        self._before = 0  # confirmed before what was sent last
        self._other: int | None = None  # what it showed last where it cannot have that
        self._read_empty = self._is_doubted = False  # since it was seen at 0
        self._turns = 0  # since 0 is wanted and it was not seen there
        self.missed = 0
        self.strikes.clear()
        self._checked_ns = now_ns
        self.flags: frozenset[str] = frozenset()

    @property
    def is_known(self) -> bool:
        """Whether the answers can be decoded; false if the start-up failed early."""
        return True

    def remember(self, before: Channel) -> None:  # noqa: B027
        """Copy the format of set points of the same device, in case this start-up fails early."""

    @property
    def at_zero(self) -> bool:
        """Whether the device has shown the set point 0, and no other one since."""
        return self.confirmed == 0 and not self.is_doubtful

    @property
    def is_doubtful(self) -> bool:
        """Whether a confirmation is not sufficient, so that the set point must be read."""
        return self._is_doubted or self.strikes["check"] > 0

    @property
    def is_empty(self) -> bool:
        """Whether a reading has shown the chamber empty since the device has shown 0."""
        return self.at_zero and self._read_empty

    @property
    def must_zero(self) -> bool:
        """Whether the wanted set point is 0 and the device has not shown it."""
        return self.setpoint.is_zero and not self.at_zero

    @property
    def must_ask_again(self) -> bool:
        """Whether to repeat the check, because a single wrong set point at rest may be noise."""
        return self.strikes["check"] == 1 and self.missed == 0 and not self.setpoint.jumps

    @property
    def is_silent(self) -> bool:
        """Whether the device gives no answers."""
        return self.missed >= self.options.silent_after

    @property
    def urgency(self) -> int | None:
        """Number of turns before the others that the device has had to reach 0; None if it waits its turn.

        A device that is silent or does not reach 0 does not delay the others.
        """
        is_first = self.is_known and not self.is_silent and self._turns < _FIRST_TURNS
        return self._turns if is_first and self.must_zero else None

    def vent(self) -> None:
        """Set the set point to 0 without slew."""
        self.setpoint.jump_to_zero()
        if not self.at_zero:
            self._unsee()

    def doubt(self) -> None:
        """Discard that the device is at 0 and empty, so that the driver sends 0 and reads it again."""
        self._is_doubted = True
        self._unsee()

    def reconnected(self) -> None:
        """Set the set point to 0 on a line that is open again."""
        self.missed = 0
        self.doubt()
        self.vent()
        self.latch("connection_lost", "its port was lost and is open again")

    def follow(self, target_pa: float, dt: float) -> None:
        """Follow the caller's set point [Pa gauge] for `dt` [s]; zeros do not slow down a vent."""
        if target_pa != 0.0 or self.at_zero:
            self.setpoint.jumps = False
        self.setpoint.follow(target_pa, dt)

    @abstractmethod
    def describe(self, session: StartupSession) -> str:
        """Return a description of the device in one line; sends no commands.

        Raises
        ------
        HardwareError
            If the device differs from the platform file.
        """

    @abstractmethod
    def start(self, session: StartupSession) -> None:
        """Bring the device to 0 and check that it answers all requests of the loop.

        Raises
        ------
        HardwareError
            If a step fails; the message states the device and the step.
        """

    def next_request(self, now_ns: int) -> Request:
        """Return the request to send now."""
        self._turns = self._turns + 1 if self.must_zero else 0
        return self.request(now_ns)

    @property
    def is_first_turn(self) -> bool:
        """Whether this is the first request since 0 is wanted, which sends 0."""
        return self._turns == 1 and not self.must_ask_again

    @abstractmethod
    def request(self, now_ns: int) -> Request:
        """Return the request of the dialect to send now."""

    @abstractmethod
    def vent_steps(self) -> list[dict[str, Any]]:
        """Return the steps of the supervisor: set point 0, and a reading that shows the chamber empty."""

    def answer(self, request: Request, line: bytes, now_ns: int) -> Outcome:
        """Process the answer to a request.

        Parameters
        ----------
        request : Request
            Sent request.
        line : bytes
        now_ns : int
            Time of the line [ns].

        Returns
        -------
        str
            Quality of the answer, an `Outcome`.
        """
        outcome = self.read_answer(request, line, now_ns)
        if outcome == "garbled":
            self.missed_answer()
            return outcome
        self.missed = 0
        if self.strike(f"refused {request.kind}", outcome == "refused"):
            self.latch("command_rejected", f"answers {format_bytes(line)} to {format_bytes(request.data)}")
        return outcome

    @abstractmethod
    def read_answer(self, request: Request, line: bytes, now_ns: int) -> Outcome:
        """Process the answer in the dialect; parameters as in `Channel.answer`."""

    def missed_answer(self) -> None:
        """Count a missing or invalid answer."""
        self.missed += 1
        if self.is_silent:
            self._unsee()  # the device may have restarted when it answers again
            self.latch("device_silent", f"{self.missed} requests in a row without a good answer")

    def sending(self, counts: int, now_ns: int) -> None:
        """Record a set point that is sent."""
        self._unsee()
        self.setpoint.sent(counts, now_ns)

    def confirm(self, requested: int, found: int) -> Outcome:
        """Compare the confirmed set point with the sent one."""
        is_wrong = found != requested
        self.confirmed = None if is_wrong else found
        if is_wrong:
            self._before = found  # the device reports this one, until it accepts the other
        if self.strike("confirm", is_wrong):
            text = f"was sent {self.setpoint.text(requested)} and keeps {self.setpoint.text(found)}"
            self.latch("setpoint_ignored", text)
        return "mismatch" if is_wrong else "good"

    def must_check(self, now_ns: int) -> bool:
        """Return whether to read the set point of the device before the next one is sent.

        After a restart the device does not have the confirmed set point. So this is due periodically, after a
        missing answer, and while the set point differs.
        """
        is_due = (now_ns - self._checked_ns) * 1e-9 >= self.options.check_s
        return self.missed > 0 or self.strikes["check"] > 0 or (is_due and self.confirmed is not None)

    def check(self, found: int, now_ns: int) -> Outcome:
        """Compare the set point of the device with the possible ones.

        These are the confirmed one, or, after a lost confirmation, the sent one and the one before it.
        """
        self._checked_ns = now_ns
        had = self._before if self.confirmed is None else self.confirmed
        is_wrong = found not in (had, self.setpoint.sent_counts)
        # At rest, the same wrong set point twice is a fault: the pressure is already rising.
        is_same = self.setpoint.is_zero and found == self._other
        self._other = found if is_wrong else None
        if self.strike("check", is_wrong) or (is_wrong and is_same):
            text = self.setpoint.text
            message = f"confirmed {text(had)} and has {text(found)}: restarted, or set by another"
            self.latch("rebooted", message)
        if is_wrong:
            self._unsee()
        else:
            self.confirmed = found if found == self.setpoint.sent_counts else None
            self._is_doubted = self._is_doubted and self.confirmed is None
        return "mismatch" if is_wrong else "good"

    def read(self, pressure_pa: float) -> None:
        """Record a reading [Pa gauge], after the set point of the same answer."""
        self.pressure_pa, self.fresh = pressure_pa, True
        self._read_empty = self.at_zero and abs(pressure_pa) < EMPTY_PA

    def device_faults(self) -> list[Fault]:
        """Return the faults that the device reports and that do not latch."""
        return []

    def strike(self, kind: str, is_wrong: bool) -> bool:
        """Count consecutive wrong answers of a kind; return whether they are a fault."""
        self.strikes[kind] = self.strikes[kind] + 1 if is_wrong else 0
        return self.strikes[kind] >= STRIKES

    def latch(self, code: str, message: str) -> None:
        """Latch a fault of this device."""
        self.latched.add(code, self.source, message)

    def _unsee(self) -> None:
        """Mark the set point of the device as unknown: the confirmed one or the next one."""
        if self.confirmed is not None:
            self._before, self.confirmed = self.confirmed, None
        self._read_empty = False
