"""One device on a serial line: what it is asked next, what its answers mean, and what is wrong with it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from soro_core.hardware.port import Fault
from soro_core.hardware.serial_line.config import LineOptions

if TYPE_CHECKING:
    from soro_core.hardware.serial_line.session import Session

# How an answer was: as it should be, none at all, one to another question perhaps, or a refusal.
Outcome: TypeAlias = Literal["good", "garbled", "mismatch", "refused"]

STRIKES = 3  # wrong answers in a row that are no disturbance of the line
_SILENT_ROUNDS = 10
_LONGEST_PAUSE_S = 0.1  # for which the slew is made up


@dataclass(frozen=True)
class Request:
    """One question; `kind` says to the channel how to read the answer, `counts` what it asked for."""

    data: bytes
    kind: str
    counts: int = 0


class Channel(ABC):
    """State of one device, in its own counts.

    What goes out follows the caller's set point by at most `slew_pa_s`: from exchange to exchange, so that a
    step is spread over several messages, and from message to message, so that what a pause of the line has
    held up does not come at once. Zero after a fault and a vent are not limited.

    Attributes
    ----------
    pressure_pa : float
        Newest reading [Pa gauge]; NaN before the first.
    fresh : bool
        Whether it came in this exchange.
    sent_pa : float
        Set point last sent.
    latched : dict
        Faults until the next start-up.
    started : bool
        Whether the device has gone through its start-up.
    wake : bytes
        Question that a device answers as soon as it is there.
    """

    wake: bytes

    def __init__(
        self, chamber: str, place: str, resolution_pa: float, low: int, high: int, options: LineOptions
    ) -> None:
        self.chamber = chamber
        self.source = f"{chamber} ({place})"
        self.options = options
        self.resolution_pa, self.low, self.high = resolution_pa, low, high
        self.pressure_pa = math.nan
        self.fresh = False
        self.latched: dict[str, Fault] = {}
        self.restart(0)
        self.started = False

    def restart(self, now_ns: int) -> None:
        """Begin anew after a start-up that has left the device at 0."""
        self.started = True
        self.reference_pa = 0.0
        self.jump = False
        self.sent_counts = 0
        self.confirmed: int | None = 0
        self._before = 0  # confirmed before what was sent last
        self.missed = 0
        self.strikes: Counter[str] = Counter()
        self._sent_ns = self._read_ns = self._checked_ns = now_ns
        self.latched.clear()
        self.flags: frozenset[str] = frozenset()

    @property
    def sent_pa(self) -> float:
        """Set point last sent [Pa gauge]."""
        return self.sent_counts * self.resolution_pa

    @property
    def at_zero(self) -> bool:
        """Whether the device has confirmed 0."""
        return self.confirmed == 0 and self.sent_counts == 0

    @property
    def must_vent(self) -> bool:
        """Whether it is to get 0 before anything else, answers or not."""
        return self.jump and not self.at_zero

    @property
    def urgent(self) -> bool:
        """Whether it comes before the others for that; a silent one does not hold them up."""
        return self.must_vent and "device_silent" not in self.latched

    def due_round(self, number: int) -> bool:
        """Whether it is asked in a round of the line; a silent device must not hold up the others."""
        return "device_silent" not in self.latched or number % _SILENT_ROUNDS == 0

    def vent(self) -> None:
        """Go to 0 without slew."""
        self.reference_pa, self.jump = 0.0, True
        self.confirmed = self.confirmed if self.at_zero else None

    def follow(self, target_pa: float, dt: float) -> None:
        """Take the caller's set point of this cycle; zeros do not slow a vent down that is under way."""
        self.jump = self.jump and target_pa == 0.0 and not self.at_zero
        self.reference_pa = self._towards(self.reference_pa, target_pa, dt)

    def wanted_counts(self, now_ns: int) -> int:
        """Set point to send now, in counts within the platform's range."""
        if self.jump:
            return 0
        wanted = self._towards(self.sent_pa, self.reference_pa, (now_ns - self._sent_ns) * 1e-9)
        return min(max(round(wanted / self.resolution_pa), self.low), self.high)

    @abstractmethod
    def look(self, session: Session) -> str:
        """What the device says of itself, in one line; it is asked only, not commanded.

        Raises
        ------
        HardwareError
            If it is not what it should be.
        """

    @abstractmethod
    def start(self, session: Session) -> None:
        """Bring the device to 0 and see that it answers everything that the loop will ask.

        Raises
        ------
        HardwareError
            One line that names the device and the step.
        """

    @abstractmethod
    def next_request(self, now_ns: int) -> Request:
        """Question to send now."""

    @abstractmethod
    def vent_steps(self) -> list[dict[str, str]]:
        """What the supervisor sends in the driver's place, and the answer that confirms it."""

    def answer(self, request: Request, line: bytes, now_ns: int) -> Outcome:
        """Take the answer to a question."""
        outcome = self.read_answer(request, line, now_ns)
        if outcome == "garbled":
            self._count_missed()
            return outcome
        self.missed = 0
        if self.strike(f"refused {request.kind}", outcome == "refused"):
            self.latch("command_rejected", f"answers {shown(line)} to {shown(request.data)}")
        return outcome

    @abstractmethod
    def read_answer(self, request: Request, line: bytes, now_ns: int) -> Outcome:
        """Take the answer to a question; the dialect's part of `answer`."""

    def missed_answer(self, request: Request, now_ns: int) -> None:
        """Take note that no answer came."""
        self._count_missed()

    def sending(self, counts: int, now_ns: int) -> None:
        """Note that a set point goes out."""
        self._before = self._before if self.confirmed is None else self.confirmed
        self.sent_counts, self.confirmed = counts, None
        self._sent_ns = now_ns

    def confirm(self, requested: int, found: int) -> Outcome:
        """Compare a set point that the device confirms with the one that it was sent."""
        is_wrong = found != requested
        self.confirmed = None if is_wrong else found
        if self.strike("confirm", is_wrong):
            text = f"was sent {self._text(requested)} and keeps {self._text(found)}"
            self.latch("setpoint_ignored", text)
        return "mismatch" if is_wrong else "good"

    def must_check(self, now_ns: int) -> bool:
        """Whether to see, before it gets another set point, that the device has the one that it confirmed.

        It has not when it has restarted. So this is due from time to time, after a missed answer, and as long
        as the answer is another one.
        """
        is_due = (now_ns - self._checked_ns) * 1e-9 >= self.options.check_s
        return self.missed > 0 or self.strikes["check"] > 0 or (is_due and self.confirmed is not None)

    def check(self, found: int, now_ns: int) -> Outcome:
        """Compare the set point that the device has with what it can have.

        That is the one that it confirmed, or, where the confirmation got lost, the one that it was sent or
        the one before.
        """
        self._checked_ns = now_ns
        had = self._before if self.confirmed is None else self.confirmed
        is_wrong = found != had and (self.confirmed is not None or found != self.sent_counts)
        if self.strike("check", is_wrong):
            text = f"confirmed {self._text(had)} and has {self._text(found)}: restarted, or set by another"
            self.latch("rebooted", text)
        if not is_wrong:
            self.confirmed = found if found == self.sent_counts else None
        return "mismatch" if is_wrong else "good"

    def strike(self, kind: str, is_wrong: bool) -> bool:
        """Count what is wrong several times in a row; whether it has been often enough."""
        self.strikes[kind] = self.strikes[kind] + 1 if is_wrong else 0
        return self.strikes[kind] >= STRIKES

    def read(self, pressure_pa: float, now_ns: int) -> None:
        """Take a reading."""
        self.pressure_pa, self.fresh, self._read_ns = pressure_pa, True, now_ns

    def latch(self, code: str, message: str) -> None:
        """Latch a fault; the first of its kind stays."""
        self.latched.setdefault(code, Fault(code, self.source, message, latched=True))

    def faults(self, now_ns: int) -> list[Fault]:
        """Everything that is wrong now."""
        found = list(self.latched.values())
        age_s = (now_ns - self._read_ns) * 1e-9
        if age_s > self.options.stale_s and "device_silent" not in self.latched:
            text = f"no pressure for {age_s * 1e3:.0f} ms (stale at {self.options.stale_s * 1e3:g} ms)"
            found.append(Fault("stale_reading", self.source, text))
        return found + self.device_faults()

    def device_faults(self) -> list[Fault]:
        """What the device says of itself."""
        return []

    def _towards(self, from_pa: float, to_pa: float, dt: float) -> float:
        change = self.options.slew_pa_s * min(dt, _LONGEST_PAUSE_S)
        return min(max(to_pa, from_pa - change), from_pa + change)

    def _text(self, counts: int) -> str:
        return f"{counts * self.resolution_pa:.0f} Pa"

    def _count_missed(self) -> None:
        self.missed += 1
        if self.missed >= self.options.silent_after:
            self.latch("device_silent", f"{self.missed} requests in a row without a good answer")


def shown(data: bytes) -> str:
    """Bytes of a line as an error shows them."""
    return repr(data.decode("ascii", "replace").strip())
