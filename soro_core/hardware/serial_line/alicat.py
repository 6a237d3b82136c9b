"""Alicat pressure controllers on one line: data frames by letter, and what differs with the firmware.

Below firmware 9v00 a set point is sent with `AS15.00`, from there on with `ALS 15.00`. On versions 1 to 7
every command that begins with `AL` locks the front panel instead, so that none is sent before the version is
known. A controller whose set point source is not the serial line takes a command, answers, and stays where it
is: the set point that it shows is compared with what it was sent, every time.
"""

from __future__ import annotations

from soro_core.hardware.port import Fault
from soro_core.hardware.serial_line import alicat_codec as codec
from soro_core.hardware.serial_line.alicat_codec import DataFrame, Layout, Version
from soro_core.hardware.serial_line.channel import Channel, Outcome, Request
from soro_core.hardware.serial_line.config import AlicatPlatform, AlicatValve
from soro_core.hardware.serial_line.session import TRIES, Session

_IDLE_BYTES = 3.5  # idle line before a device acts on what it has heard
# A set point and a reading: with `S` in one answer, with `LS` in two.
SET_BYTES = len(b"AS00.00\rA +000.00 +000.00\r") + _IDLE_BYTES
LS_BYTES = len(b"ALS 00.00\rA +000.00 +000.00 14 KPAG\rA\rA +000.00 +000.00\r") + 2 * _IDLE_BYTES
_LOWEST_PA = -110e3
_LISTEN_S = 0.12  # more than twice the period of a stream, 50 ms by default
_TRIES = 5


class AlicatChannel(Channel):
    """One unit on the line."""

    def __init__(self, platform: AlicatPlatform, valve: AlicatValve, place: str) -> None:
        super().__init__(valve.chamber, f"unit {valve.unit} on {place}", 1.0, 0, 0, platform.line)
        self.unit, self.wake = valve.unit, valve.unit.encode() + b"\r"
        self._range = platform.range
        self._always_s = platform.setpoint_command == "S"
        # An answer far beyond what the platform can have is no pressure.
        self._highest_pa = 2 * max(platform.range.maximum_pa, 100e3)
        self._layout: Layout | None = None
        self.version: Version = (0, 0)

    def restart(self, now_ns: int) -> None:
        super().restart(now_ns)
        self._last = ""

    @property
    def is_modern(self) -> bool:
        """Whether set points go with `LS`."""
        return self.version >= codec.MODERN_SETPOINT and not self._always_s

    def next_request(self, now_ns: int) -> Request:
        """A set point while it moves, else a poll; after `LS` a poll, for its answer has no pressure."""
        moves = self.confirmed is None or self.wanted_counts(now_ns) != self.sent_counts
        may_set = self._last != "ls" and not self.must_check(now_ns)
        if moves and (self.must_vent or may_set):
            counts = self.wanted_counts(now_ns)
            self.sending(counts, now_ns)
            self._last = "ls" if self.is_modern else "set"
            return Request(self._set_command(counts), self._last, counts)
        self._last = "poll"
        return Request(b"%s\r" % self.unit.encode(), "poll")

    def read_answer(self, request: Request, line: bytes, now_ns: int) -> Outcome:
        layout = self._known_layout()
        if codec.is_refusal(line):
            return "refused"
        if request.kind == "ls":
            found = codec.parse_setpoint(line, self.unit, layout)
            return "garbled" if found is None else self.confirm(request.counts, found)
        frame = codec.parse_frame(line, self.unit, layout)
        if frame is None:
            return "garbled"
        self.flags = frame.flags
        is_wrong = not _LOWEST_PA <= frame.pressure_pa <= self._highest_pa
        if self.strike("pressure", is_wrong):
            self.latch("sensor_failed", f"reads {frame.pressure_pa / 1e3:.1f} kPa")
        if not is_wrong:
            self.read(frame.pressure_pa, now_ns)
        if request.kind == "set":
            outcome = self.confirm(request.counts, frame.setpoint_counts)
        else:
            outcome = self.check(frame.setpoint_counts, now_ns)
        return "mismatch" if is_wrong else outcome

    def device_faults(self) -> list[Fault]:
        """A valve on hold does not regulate; a pressure beyond the sensor's range is not known."""
        faults = []
        if "HLD" in self.flags:
            faults.append(Fault("not_active", self.source, "its valve is on hold (HLD)"))
        if self.flags & {"POV", "ADC"}:
            text = (
                f"its pressure sensor is beyond its range ({' '.join(sorted(self.flags & {'POV', 'ADC'}))})"
            )
            faults.append(Fault("sensor_failed", self.source, text))
        return faults

    def look(self, session: Session) -> str:
        frame = self._poll(session, self._identify(session))
        major, minor = self.version
        setpoint = frame.setpoint_counts * self.resolution_pa / 1e3
        flags = f", {' '.join(sorted(frame.flags))}" if frame.flags else ""
        return (
            f"firmware {major}v{minor:02d}, {self.resolution_pa:g} Pa a digit: set point {setpoint:.1f}, "
            f"pressure {frame.pressure_pa / 1e3:.1f} kPa{flags}"
        )

    def _identify(self, session: Session) -> Layout:
        """Read version, columns and source of the set point."""
        unit = self.unit.encode()
        self.version = self._read_version(session, unit)
        layout = session.ask_table(
            unit + b"??D*\r", "columns", lambda rows: codec.parse_layout(rows, self.unit)
        )
        self._layout = layout
        self.resolution_pa = layout.resolution_pa
        self.low = -int(-self._range.minimum_pa / self.resolution_pa)
        self.high = int(self._range.maximum_pa / self.resolution_pa)
        if self.version >= codec.SETPOINT_SOURCE:
            source = session.ask(unit + b"LSS\r", "set point source", self._source_of)
            if source != "S":
                text = f"answers '{self.unit} {source}': its set point must come from the serial line (S)"
                raise session.error("set point source", text)
        return layout

    def start(self, session: Session) -> None:
        """Identify the device, read its columns, and bring it to 0."""
        unit, layout = self.unit.encode(), self._identify(session)
        if "HLD" in self._poll(session, layout).flags:
            session.ask(unit + b"C\r", "cancel hold", _any)
        for _ in range(TRIES):
            session.ask(self._set_command(0), "set point 0", _any)
            frame = self._poll(session, layout)
            if frame.setpoint_counts == 0:
                self.restart(session.now_ns())
                self.read(frame.pressure_pa, session.now_ns())
                return
        text = f"keeps {frame.setpoint_counts * self.resolution_pa:.0f} Pa; is its source the serial line?"
        raise session.error("set point 0", text)

    def vent_steps(self) -> list[dict[str, str]]:
        """Set point 0; its confirmation shows 0 as set point."""
        zero = r"[+-]?0+(\.0+)?"
        if self.is_modern:
            expect = rf"{self.unit} +\S+ +{zero} +\S+ +\S+"
        else:
            expect = rf"{self.unit}" + r" +\S+" * (self._known_layout().setpoint - 1) + rf" +{zero}( .*)?"
        return [{"send": self._set_command(0).decode(), "line": expect}]

    def _set_command(self, counts: int) -> bytes:
        decimals = self._known_layout().decimals
        value = f"{counts / 10**decimals:.{decimals}f}"
        return f"{self.unit}{'LS ' if self.is_modern else 'S'}{value}\r".encode()

    def _read_version(self, session: Session, unit: bytes) -> Version:
        """Version by `VE`, and by `??M9` where that is not known."""
        for question in (unit + b"VE\r", unit + b"??M9\r") * TRIES:
            line = session.try_ask(question)
            version = None if line is None else codec.parse_version(line)
            if version is not None:
                return version
        raise session.error("firmware", "does not tell its version")

    def _source_of(self, line: bytes) -> str | None:
        """Source of its set point in an answer to `LSS`."""
        fields = line.decode("ascii", "replace").split()
        return fields[1] if len(fields) == 2 and fields[0] == self.unit and len(fields[1]) == 1 else None

    def _poll(self, session: Session, layout: Layout) -> DataFrame:
        question = self.unit.encode() + b"\r"
        return session.ask(question, "poll", lambda line: codec.parse_frame(line, self.unit, layout))

    def _known_layout(self) -> Layout:
        if self._layout is None:
            raise RuntimeError(f"{self.source}: not started")
        return self._layout


def _any(line: bytes) -> bytes:
    return line


def stop_stream(session: Session, units: tuple[str, ...]) -> None:
    """Bring a device that sends without being asked back to its letter.

    A streaming unit has given its letter away for ``@``; which one it was is found by who does not answer.

    Raises
    ------
    HardwareError
        If it is none of the platform's, or goes on.
    """
    if not session.listen(_LISTEN_S):
        return
    for unit in units:
        letter = unit.encode()
        if not any(_hears(session, letter) for _ in range(_TRIES)):
            # The form of firmware 8 and newer, then the older one; a device ignores the other.
            for stop in (b"@@ " + letter, b"@@=" + letter):
                session.in_gap(b"\r" + stop + b"\r")
                session.listen(_LISTEN_S)
    if session.listen(_LISTEN_S):
        raise session.error("streaming", "a device sends without being asked and cannot be stopped")


def _hears(session: Session, letter: bytes) -> bool:
    session.in_gap(letter + b"\r")
    return any(line.startswith(letter + b" ") for line in session.listen(_LISTEN_S).split(b"\r"))
