"""Alicat pressure controllers on one line: data frames by letter, and differences between firmware versions.

Below firmware 9v00 a set point is sent with `AS15.00`, from 9v00 on with `ALS 15.00`. Versions 1 to 7 lock
the front panel at every command that starts with `AL`, so the driver reads the version first. A controller
with another source of the set point answers a command but ignores it: so the driver compares each set point
in an answer with the sent one.
"""

from __future__ import annotations

from typing import Any

from soro_hardware.port import EMPTY_PA, Fault
from soro_hardware.serial_line import alicat_codec as codec
from soro_hardware.serial_line.alicat_codec import DataFrame, FrameLayout, Version
from soro_hardware.serial_line.config import AlicatPlatform, AlicatValve
from soro_hardware.serial_line.line.channel import Channel
from soro_hardware.serial_line.line.request import Outcome, Request
from soro_hardware.serial_line.line.session import TRIES, StartupSession

_LOWEST_PA = -110e3
_LISTEN_S = 0.12  # more than twice the period of a stream, 50 ms by default
_TRIES = 5
_ZERO = r"[+-]?0+(?:\.0+)?"


class AlicatChannel(Channel):
    """One unit on the line.

    Parameters
    ----------
    platform : AlicatPlatform
        Range and times.
    valve : AlicatValve
        Entry of the platform file.
    place : str
        Name of the port.
    """

    def __init__(self, platform: AlicatPlatform, valve: AlicatValve, place: str) -> None:
        super().__init__(valve.chamber, f"unit {valve.unit} on {place}", 1.0, 0, 0, platform.line)
        self.unit, self.wake = valve.unit, valve.unit.encode() + b"\r"
        self._range = platform.range
        self._always_s = platform.setpoint_command == "S"
        # A reading far beyond the range of the platform is invalid.
        self._highest_pa = 2 * max(platform.range.maximum_pa, 100e3)
        self._layout: FrameLayout | None = None
        self.version: Version = (0, 0)

    def restart(self, now_ns: int) -> None:
        super().restart(now_ns)
        self._last = ""

    @property
    def is_modern(self) -> bool:
        """Whether set points are sent with `LS`."""
        return self.version >= codec.MODERN_SETPOINT and not self._always_s

    @property
    def is_known(self) -> bool:
        return self._layout is not None

    def remember(self, before: Channel) -> None:
        if isinstance(before, AlicatChannel) and before.unit == self.unit:
            self._layout, self.version = before._layout, before.version
            ours, theirs = self.setpoint, before.setpoint
            ours.resolution_pa, ours.low, ours.high = theirs.resolution_pa, theirs.low, theirs.high

    def request(self, now_ns: int) -> Request:
        """Return a set point while it changes, otherwise a poll; a poll also after `LS`, for the pressure."""
        if not self.is_known:
            return Request(self._blind_zero(), "blind")
        if self.must_zero:
            is_set = self.is_first_turn or (self._last == "poll" and not self.must_ask_again)
        else:
            moves = self.confirmed is None or self.setpoint.wanted_counts(now_ns) != self.setpoint.sent_counts
            is_set = moves and self._last != "ls" and not self.must_check(now_ns)
        if is_set:
            counts = self.setpoint.wanted_counts(now_ns)
            self.sending(counts, now_ns)
            self._last = "ls" if self.is_modern else "set"
            return Request(self._set_command(counts), self._last, counts)
        self._last = "poll"
        return Request(b"%s\r" % self.unit.encode(), "poll")

    def read_answer(self, request: Request, line: bytes, now_ns: int) -> Outcome:
        """Process the answer in this dialect; parameters as in `Channel.answer`."""
        if codec.is_refusal(line):
            return "refused"
        if request.kind == "blind":
            return "good"
        layout = self._known_layout()
        if request.kind == "ls":
            found = codec.parse_setpoint(line, self.unit, layout)
            return "garbled" if found is None else self.confirm(request.counts, found)
        frame = codec.parse_frame(line, self.unit, layout)
        if frame is None:
            return "garbled"
        self.flags = frame.flags
        if request.kind == "set":
            outcome = self.confirm(request.counts, frame.setpoint_counts)
        else:
            outcome = self.check(frame.setpoint_counts, now_ns)
        is_wrong = not _LOWEST_PA <= frame.pressure_pa <= self._highest_pa
        if self.strike("pressure", is_wrong):
            self.latch("sensor_failed", f"reads {frame.pressure_pa / 1e3:.1f} kPa")
        if not is_wrong:
            self.read(frame.pressure_pa)
        return "mismatch" if is_wrong else outcome

    def device_faults(self) -> list[Fault]:
        """Return faults for a valve on hold, a pressure beyond the sensor's range, and a temperature."""
        faults = []
        if "HLD" in self.flags:
            faults.append(Fault("not_active", self.source, "its valve is on hold (HLD)"))
        if self.flags & {"POV", "ADC"}:
            text = (
                f"its pressure sensor is beyond its range ({' '.join(sorted(self.flags & {'POV', 'ADC'}))})"
            )
            faults.append(Fault("sensor_failed", self.source, text))
        if "TOV" in self.flags:
            faults.append(Fault("over_temperature", self.source, "its temperature is out of range (TOV)"))
        return faults

    def describe(self, session: StartupSession) -> str:
        frame = self._poll(session, self._identify(session))
        major, minor = self.version
        setpoint = frame.setpoint_counts * self.setpoint.resolution_pa / 1e3
        flags = f", {' '.join(sorted(frame.flags))}" if frame.flags else ""
        return (
            f"firmware {major}v{minor:02d}, {self.setpoint.resolution_pa:g} Pa a digit: "
            f"set point {setpoint:.1f}, pressure {frame.pressure_pa / 1e3:.1f} kPa{flags}"
        )

    def _identify(self, session: StartupSession) -> FrameLayout:
        """Read version, columns and source of the set point."""
        unit = self.unit.encode()
        self.version = self._read_version(session, unit)
        layout = session.ask_table(
            unit + b"??D*\r", "columns", lambda rows: codec.parse_layout(rows, self.unit)
        )
        self._layout = layout
        self.setpoint.resolution_pa = layout.resolution_pa
        self.setpoint.low = -int(-self._range.minimum_pa / layout.resolution_pa)
        self.setpoint.high = int(self._range.maximum_pa / layout.resolution_pa)
        if self.version >= codec.SETPOINT_SOURCE:
            source = session.ask(unit + b"LSS\r", "set point source", self._source_of)
            if source != "S":
                text = f"answers '{self.unit} {source}': its set point must come from the serial line (S)"
                raise session.error("set point source", text)
        return layout

    def start(self, session: StartupSession) -> None:
        """Identify the device, read its columns, and bring it to 0."""
        unit, layout = self.unit.encode(), self._identify(session)
        if "HLD" in self._poll(session, layout).flags:
            session.ask(unit + b"C\r", "cancel hold", _any)
        for _ in range(TRIES):
            session.ask(self._set_command(0), "set point 0", _any)
            frame = self._poll(session, layout)
            if frame.setpoint_counts == 0:
                self.restart(session.now_ns())
                self.read(frame.pressure_pa)
                return
        text = f"keeps {self.setpoint.text(frame.setpoint_counts)}; is its source the serial line?"
        raise session.error("set point 0", text)

    def vent_steps(self) -> list[dict[str, Any]]:
        """Return the steps: set point 0, and a data frame with set point 0 and an empty chamber."""
        if not self.is_known:  # no answer can confirm it
            return [{"send": self._blind_zero().decode(), "line": "(?!)", "of": self.chamber}]
        layout, fields = self._known_layout(), [r"\S+"] * self._known_layout().columns
        fields[0], fields[layout.pressure], fields[layout.setpoint] = self.unit, r"([+-]?\d+\.?\d*)", _ZERO
        high = EMPTY_PA / layout.unit_pa
        frame = {"line": " +".join(fields) + "(?: .*)?", "low": -high, "high": high, "of": self.chamber}
        zero = {"send": self._set_command(0).decode(), "of": self.chamber}
        if not self.is_modern:
            return [{**zero, **frame}]
        answer = rf"{self.unit} +\S+ +{_ZERO} +\S+ +\S+"
        return [{**zero, "line": answer}, {"send": f"{self.unit}\r", **frame}]

    def _blind_zero(self) -> bytes:
        """Return set point 0 for unknown firmware: all versions know `S`."""
        return f"{self.unit}S0\r".encode()

    def _set_command(self, counts: int) -> bytes:
        decimals = self._known_layout().decimals
        value = f"{counts / 10**decimals:.{decimals}f}"
        return f"{self.unit}{'LS ' if self.is_modern else 'S'}{value}\r".encode()

    def _read_version(self, session: StartupSession, unit: bytes) -> Version:
        """Read the version with `VE`, or, because 8v17 does not answer it, from the last row of `??M*`."""
        for _ in range(TRIES):
            rows = [session.try_ask(unit + b"VE\r") or b""]
            if codec.parse_version(rows[0]) is None:
                rows = session.try_ask_table(unit + b"??M*\r")
            for version in filter(None, map(codec.parse_version, rows)):
                return version
        raise session.error("firmware", "does not report its version")

    def _source_of(self, line: bytes) -> str | None:
        """Return the source of the set point in an answer to `LSS`."""
        fields = line.decode("ascii", "replace").split()
        return fields[1] if len(fields) == 2 and fields[0] == self.unit and len(fields[1]) == 1 else None

    def _poll(self, session: StartupSession, layout: FrameLayout) -> DataFrame:
        question = self.unit.encode() + b"\r"
        return session.ask(question, "poll", lambda line: codec.parse_frame(line, self.unit, layout))

    def _known_layout(self) -> FrameLayout:
        if self._layout is None:
            raise RuntimeError(f"{self.source}: not started")
        return self._layout


def _any(line: bytes) -> bytes:
    return line


def stop_stream(session: StartupSession, units: tuple[str, ...]) -> None:
    """Stop a unit that streams data frames.

    A streaming unit has the letter ``@``; so it is the unit that does not answer to its own letter.

    Raises
    ------
    HardwareError
        If the unit is none of the platform's, or does not stop.
    """
    if not session.listen(_LISTEN_S):
        return
    for unit in units:
        letter = unit.encode()
        if not any(_answers(session, letter) for _ in range(_TRIES)):
            # The form of firmware 8 and newer, then the older one; a device ignores the other.
            for stop in (b"@@ " + letter, b"@@=" + letter):
                session.in_gap(b"\r" + stop + b"\r")
                session.listen(_LISTEN_S)
    if session.listen(_LISTEN_S):
        raise session.error("streaming", "a device sends without a request and does not stop", "flood")


def _answers(session: StartupSession, letter: bytes) -> bool:
    session.in_gap(letter + b"\r")
    return any(line.startswith(letter + b" ") for line in session.listen(_LISTEN_S).split(b"\r"))
