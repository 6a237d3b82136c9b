"""SMC ITV over RS-232C: `SET n`, `REQ`, `MON`, each answered with one number of 10 bits and CR LF.

An answer does not name its request, and there is no checksum. So only one request is open at a time, the echo
confirms every SET, and REQ periodically checks the confirmed set point, which a device loses when it
restarts. The driver cannot detect a wrong digit in a reading; the monitors of the limiter can.
"""

from __future__ import annotations

import re
from typing import Any

from soro_hardware.port import EMPTY_PA
from soro_hardware.serial_line.config import ItvPlatform, ItvValve
from soro_hardware.serial_line.line.channel import Channel
from soro_hardware.serial_line.line.request import Outcome, Request
from soro_hardware.serial_line.line.session import StartupSession

FULL_COUNTS = 1023
_NUMBER = re.compile(rb"[0-9]{1,4}")
_REFUSALS = (b"UNKNOWN COMMAND", b"OUT OF RANGE")


def parse(line: bytes) -> int | None:
    """Return the counts of an answer, or None if it is no number of 10 bits."""
    if not _NUMBER.fullmatch(line):
        return None
    counts = int(line)
    return counts if counts <= FULL_COUNTS else None


def _zero(line: bytes) -> int | None:
    return 0 if parse(line) == 0 else None


def is_refusal(line: bytes) -> bool:
    """Return whether an answer is a refusal."""
    return any(text in line.upper() for text in _REFUSALS)


class ItvChannel(Channel):
    """One ITV on its own port.

    Parameters
    ----------
    platform : ItvPlatform
        Range and times.
    valve : ItvValve
        Entry of the platform file.
    place : str
        Name of the port.
    """

    wake = b"\r\nREQ\r\n"

    def __init__(self, platform: ItvPlatform, valve: ItvValve, place: str) -> None:
        resolution_pa = platform.full_scale_pa / FULL_COUNTS
        high = int(platform.range.maximum_pa / resolution_pa)
        super().__init__(valve.chamber, place, resolution_pa, 0, high, platform.line)

    def restart(self, now_ns: int) -> None:
        super().restart(now_ns)
        self._last, self._was_check = "", False

    def request(self, now_ns: int) -> Request:
        """Return SET and MON in turn while the set point changes, otherwise MON; REQ periodically."""
        disturbed = self.missed > 0 or any(self.strikes.values())
        kind = self._way_to_zero() if self.must_zero else self._kind(now_ns)
        self._was_check = kind == "check"
        if kind != "check":
            self._last = kind
        elif disturbed and not self.must_zero:
            self._last = "set"  # next is MON, because the last reading is old
        # This ends an incomplete command in the device.
        flush = b"\r\n" if disturbed else b""
        if kind == "set":
            counts = self.setpoint.wanted_counts(now_ns)
            self.sending(counts, now_ns)
            return Request(b"%sSET %d\r\n" % (flush, counts), "set", counts)
        return Request(flush + (b"REQ\r\n" if kind == "check" else b"MON\r\n"), kind)

    def read_answer(self, request: Request, line: bytes, now_ns: int) -> Outcome:
        """Process the answer in this dialect; parameters as in `Channel.answer`."""
        counts = parse(line)
        if counts is None:
            return "refused" if is_refusal(line) else "garbled"
        if request.kind == "set":
            return self.confirm(request.counts, counts)
        if request.kind == "check":
            return self.check(counts, now_ns)
        self.read(counts * self.setpoint.resolution_pa)
        return "good"

    def describe(self, session: StartupSession) -> str:
        kpa = self.setpoint.resolution_pa / 1e3
        setpoint, pressure = (kpa * session.ask(q + b"\r\n", q.decode(), parse) for q in (b"REQ", b"MON"))
        return f"answers: set point {setpoint:.1f}, pressure {pressure:.1f} kPa (an ITV reports no identity)"

    def start(self, session: StartupSession) -> None:
        for question in (b"SET 0", b"REQ"):
            session.ask(question + b"\r\n", question.decode(), _zero)
        counts = session.ask(b"MON\r\n", "MON", parse)
        self.restart(session.now_ns())
        self.read(counts * self.setpoint.resolution_pa)

    def vent_steps(self) -> list[dict[str, Any]]:
        """Return the steps: set point 0 with its echo, and a reading that shows the chamber empty."""
        high = EMPTY_PA / self.setpoint.resolution_pa
        reading = {"send": "MON\r\n", "line": r"(\d{1,4})", "low": -1.0, "high": high}
        return [{"send": "SET 0\r\n", "line": "0+", "of": self.chamber}, {**reading, "of": self.chamber}]

    def _kind(self, now_ns: int) -> str:
        moves = self.confirmed is None or self.setpoint.wanted_counts(now_ns) != self.setpoint.sent_counts
        if self.must_check(now_ns):
            return "check"
        return "set" if moves and self._last != "set" else "read"

    def _way_to_zero(self) -> str:
        """Return SET and MON in turn; REQ after them if the echo of SET is not sufficient."""
        if self.is_first_turn:
            return "set"
        if self._was_check:
            return "check" if self.must_ask_again else "set"
        if self._last == "set":
            return "read"
        return "check" if self.is_doubtful else "set"
