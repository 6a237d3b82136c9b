"""SMC ITV over RS-232C: `SET n`, `REQ`, `MON`, each answered with one number of 10 bit and CR LF.

An answer does not say to which question it belongs, and nothing has a checksum. So there is one question at
a time; every SET is checked by its echo, and now and then REQ asks whether the device still has the set point
that it confirmed: one that restarted has not. A wrong digit in a reading cannot be told from a right one
here; the limiter's plausibility check is for that.
"""

from __future__ import annotations

import re

from soro_core.hardware.serial_line.channel import Channel, Outcome, Request
from soro_core.hardware.serial_line.config import ItvPlatform, ItvValve
from soro_core.hardware.serial_line.session import Session

FULL_COUNTS = 1023
_NUMBER = re.compile(rb"[0-9]{1,4}")
_REFUSALS = (b"UNKNOWN COMMAND", b"OUT OF RANGE")

# Longest question and answer of SET and of MON: a chamber gets a set point and gives a reading.
PAIR_BYTES = len(b"SET 1023\r\n1023\r\nMON\r\n1023\r\n")


def parse(line: bytes) -> int | None:
    """Counts of an answer, or None if it is no number of 10 bit."""
    if not _NUMBER.fullmatch(line):
        return None
    counts = int(line)
    return counts if counts <= FULL_COUNTS else None


def _zero(line: bytes) -> int | None:
    return 0 if parse(line) == 0 else None


def is_refusal(line: bytes) -> bool:
    """Whether the device has refused the command."""
    return any(text in line.upper() for text in _REFUSALS)


class ItvChannel(Channel):
    """One ITV on a port of its own."""

    wake = b"\r\nREQ\r\n"

    def __init__(self, platform: ItvPlatform, valve: ItvValve, place: str) -> None:
        resolution_pa = platform.full_scale_pa / FULL_COUNTS
        high = int(platform.range.maximum_pa / resolution_pa)
        super().__init__(valve.chamber, place, resolution_pa, 0, high, platform.line)

    def restart(self, now_ns: int) -> None:
        super().restart(now_ns)
        self._last = ""

    def next_request(self, now_ns: int) -> Request:
        """SET and MON in turn while the set point moves, else MON; REQ in between."""
        kind = self._kind(now_ns)
        disturbed = self.missed > 0 or any(self.strikes.values())
        if kind != "check":
            self._last = kind
        elif disturbed:
            self._last = "set"  # the reading comes first now, it is old by then
        # What is left in the device of a command that it has not understood ends here.
        flush = b"\r\n" if disturbed else b""
        if kind == "set":
            counts = self.wanted_counts(now_ns)
            self.sending(counts, now_ns)
            return Request(b"%sSET %d\r\n" % (flush, counts), "set", counts)
        return Request(flush + (b"REQ\r\n" if kind == "check" else b"MON\r\n"), kind)

    def read_answer(self, request: Request, line: bytes, now_ns: int) -> Outcome:
        counts = parse(line)
        if counts is None:
            return "refused" if is_refusal(line) else "garbled"
        if request.kind == "set":
            return self.confirm(request.counts, counts)
        if request.kind == "check":
            return self.check(counts, now_ns)
        self.read(counts * self.resolution_pa, now_ns)
        return "good"

    def look(self, session: Session) -> str:
        kpa = self.resolution_pa / 1e3
        setpoint, pressure = (kpa * session.ask(q + b"\r\n", q.decode(), parse) for q in (b"REQ", b"MON"))
        return f"answers: set point {setpoint:.1f}, pressure {pressure:.1f} kPa (an ITV tells no identity)"

    def start(self, session: Session) -> None:
        for question in (b"SET 0", b"REQ"):
            session.ask(question + b"\r\n", question.decode(), _zero)
        counts = session.ask(b"MON\r\n", "MON", parse)
        self.restart(session.now_ns())
        self.read(counts * self.resolution_pa, session.now_ns())

    def vent_steps(self) -> list[dict[str, str]]:
        """Set point 0 and its echo."""
        return [{"send": "SET 0\r\n", "line": "0+"}]

    def _kind(self, now_ns: int) -> str:
        if self.must_vent:
            return "set"
        moves = self.confirmed is None or self.wanted_counts(now_ns) != self.sent_counts
        if self.must_check(now_ns):
            return "check"
        return "set" if moves and self._last != "set" else "read"
