"""Emulated Alicat pressure controllers on one half-duplex line."""

from __future__ import annotations

import re
from collections.abc import Callable

from soro_core.hardware.emulation.uart import FOREVER_NS, Station, Uart
from soro_core.hardware.serial_line.alicat_codec import MODERN_SETPOINT, SETPOINT_SOURCE, parse_version

_UNITS = {"kPaG": (1e3, 2, 14), "barG": (1e5, 4, 18), "PSIG": (6894.757293168, 2, 22)}  # Pa, decimals, code
_LONGEST_LINE = 64
_IDLE_BYTES = 3.5
_FULL_SCALE_COUNTS = 64000
_STATUS = ("OPL", "POV", "P2O", "TOV", "VOV", "MOV", "OVR", "HLD", "EXH", "LCK")


class EmulatedAlicat:
    """One unit.

    Parameters
    ----------
    unit : str
        Its letter.
    firmware, pressure_unit, full_scale_pa
        What it is.
    reading_pa : callable
        Measured pressure now.
    boot_ns : int
        Silence after power-on.
    up_ns : int
        Time at which it is up for the first time.
    """

    def __init__(
        self,
        unit: str,
        firmware: str,
        pressure_unit: str,
        full_scale_pa: float,
        reading_pa: Callable[[], float],
        boot_ns: int,
        up_ns: int = 0,
    ) -> None:
        version = parse_version(firmware.encode())
        self.version = version or (0, 0)
        self.unit, self.firmware, self._label = unit, firmware, pressure_unit
        self._unit_pa, self._decimals, self._code = _UNITS[pressure_unit]
        self._full_scale_pa, self._reading_pa, self._boot_ns = full_scale_pa, reading_pa, boot_ns
        self._up_ns = up_ns
        self.setpoint = 0.0  # in its unit
        self.source = "S"
        self.flags: set[str] = set()
        self.streaming = False
        self.interval_ns = 50_000_000
        self.held_pa: float | None = None
        self.muted = False

    def demand_pa(self) -> float | None:
        """Set point [Pa gauge], or the pressure that a valve on hold keeps; None for a vent."""
        return self.setpoint * self._unit_pa if self.held_pa is None else self.held_pa

    def reboot(self, now_ns: int) -> None:
        """Lose power and come back, at set point 0 (its power-up set point)."""
        self.setpoint, self._up_ns, self.held_pa = 0.0, now_ns + self._boot_ns, None
        self.flags.clear()

    def unpower(self, now_ns: int, is_off: bool) -> None:
        """Be without power, or start again."""
        self.reboot(now_ns)
        if is_off:
            self._up_ns = FOREVER_NS

    def ignore_setpoints(self, is_on: bool) -> None:
        """Take the set point from the analog input; the last one stays."""
        self.source = "A" if is_on else "S"

    def is_up(self, now_ns: int) -> bool:
        """Whether it has power and has started."""
        return now_ns >= self._up_ns

    def frame(self) -> bytes:
        """Data frame."""
        letter = "@" if self.streaming else self.unit
        values = " ".join(map(self._number, (self._reading_pa() / self._unit_pa, self.setpoint)))
        return " ".join([letter, values, *sorted(self.flags)]).encode()

    def command(self, text: str) -> list[bytes]:
        """Lines of the answer to what follows the letter, in upper case."""
        if text == "":
            return [self.frame()]
        if text.startswith("L") and self.version < (8, 0):
            self.flags.add("LCK")  # any AL... locks the panel on these
            return [self.frame()]
        if re.fullmatch(r"@ @|@=@", text):
            self.streaming = True
            return []
        if (found := re.fullmatch(r"(?:LS) +([+-]?[\d.]+)", text)) and self.version >= MODERN_SETPOINT:
            return self._ls() if self._set(found[1]) else [b"?"]
        if text == "LS" and self.version >= MODERN_SETPOINT:
            return self._ls()
        if found := re.fullmatch(r"S *([+-]?[\d.]+)", text):
            return [self.frame()] if self._set(found[1]) else [b"?"]
        if re.fullmatch(r"\d{1,5}", text):
            counts = int(text) / _FULL_SCALE_COUNTS
            return (
                [self.frame()] if self._set(f"{counts * self._full_scale_pa / self._unit_pa:.6f}") else [b"?"]
            )
        return self._other(text)

    def _other(self, text: str) -> list[bytes]:
        letter = self.unit.encode()
        if text == "VE" and self.version >= (8, 0):
            return [b"%s   %s Jan  9 2025,15:04:07" % (letter, self.firmware.encode())]
        if text == "??M9":
            return [b"%s M09 Software %s" % (letter, self.firmware.encode())]
        if text == "??D*":
            return [row.encode() for row in self._table()]
        if text.startswith("LSS") and self.version >= SETPOINT_SOURCE:
            found = re.fullmatch(r"LSS(?: +([SAU])(?: [01])?)?", text)
            if found is None:
                return [b"?"]
            self.source = found[1] or self.source
            return [letter + b" " + self.source.encode()]
        if text in ("HP", "HC"):
            self.flags.add("HLD")
            self.held_pa = 0.0 if text == "HC" else self._reading_pa()
            return [self.frame()]
        if text == "C":
            self.flags.discard("HLD")
            self.held_pa = None
            return [self.frame()]
        if text == "U":
            self.flags.discard("LCK")
            return [self.frame()]
        if found := re.fullmatch(r"(?:NCS|W91=) *(\d{1,5})", text):
            self.interval_ns = max(int(found[1]), 1) * 1_000_000
            return [self.frame()]
        return [b"?"]

    def _set(self, text: str) -> bool:
        try:
            value = float(text)
        except ValueError:
            return False
        if not 0.0 <= value * self._unit_pa <= self._full_scale_pa * (1 + 1e-9):
            return False
        if self.source == "S":  # otherwise taken and ignored, without a word
            self.setpoint = round(value, self._decimals)
        return True

    def _ls(self) -> list[bytes]:
        reading = self._number(self._reading_pa() / self._unit_pa)
        text = f"{self.unit} {reading} {self._number(self.setpoint)} {self._code} {self._label}"
        return [text.encode()]

    def _number(self, value: float) -> str:
        return f"{round(value, self._decimals) + 0.0:+0{5 + self._decimals}.{self._decimals}f}"

    def _table(self) -> list[str]:
        if self.version < (6, 0):
            return self._old_table()
        width, unit = f"7/{self._decimals}", f"{self._code:03d} 02 {self._label}"
        rows = [
            "ID_ NAME______________________ TYPE_______ WIDTH NOTES___________________",
            "700 Unit ID                    string          1",
            f"006 Gauge Press                s decimal     {width} {unit}",
            f"038 Gauge Press Setpt          s decimal     {width} {unit}",
            "701 *Error                     string          3 ADC",
            *(f"702 *Status                    string          3 {flag}" for flag in _STATUS),
        ]
        return [f"{self.unit} D{number:02d} {row}" for number, row in enumerate(rows)]

    def _old_table(self) -> list[str]:
        full = self._number(self._full_scale_pa / self._unit_pa)
        low = self._number(0.0)
        rows = [
            "NAME_______ TYPE_____ MinVal_  MaxVal_  UNITS__",
            "Unit ID     char         A         Z         na",
            f"Pressure    signed    {low}  {full}     {self._label}",
            f"SetPoint    signed    {low}  {full}     {self._label}",
            "Error       string         na      ADC       na",
            *(
                f"Status      string         na      {flag}       na"
                for flag in ("LCK", "OVR", "POV", "HLD", "MOV")
            ),
        ]
        return [f"{self.unit}  D{number:02d} {row}" for number, row in enumerate(rows)]


class AlicatBus(Station):
    """All units of a line. They act on a command once the line has been idle for 3.5 bytes after its CR."""

    def __init__(self, line: Uart, units: list[EmulatedAlicat], answer_delay_ns: int) -> None:
        self._line, self.units = line, units
        self._delay_ns = answer_delay_ns
        self._idle_ns = round(_IDLE_BYTES * line.byte_ns)
        self._buffer = bytearray()
        self._command: tuple[int, bytes] | None = None  # time at which it is obeyed
        self._stream_ns: int | None = None
        self.hurried = 0  # commands lost because the next byte came too early

    def receive(self, chunk: bytes, end_ns: int) -> None:
        start_ns = end_ns - len(chunk) * self._line.byte_ns
        if self._command is not None and start_ns < self._command[0]:
            if chunk == b"\n":  # to an Alicat the LF after a CR is idle time
                return
            self._command, self.hurried = None, self.hurried + 1
        self._buffer += chunk.rstrip(b"\r\n")[:_LONGEST_LINE]
        del self._buffer[_LONGEST_LINE:]
        if chunk.endswith(b"\r"):
            self._command = (end_ns + self._idle_ns, bytes(self._buffer))
            self._buffer.clear()
        self._plan()

    def act(self, now_ns: int) -> None:
        self.before(now_ns)
        if self._command is not None and self._command[0] <= now_ns:
            line, self._command = self._command[1], None
            self._obey(line, now_ns)
        elif self._stream_ns is not None and self._stream_ns <= now_ns:
            self._stream(now_ns)
        self._plan()

    def _obey(self, line: bytes, now_ns: int) -> None:
        text = line.decode("ascii", "replace").strip().upper()
        if found := re.fullmatch(r"@@[ =]([A-Z])", text):
            for unit in self.units:
                if unit.streaming:
                    unit.streaming, unit.unit = False, found[1]
            return
        for unit in self.units:
            if text[:1] == unit.unit and unit.is_up(now_ns) and not unit.streaming:
                lines = unit.command(text[1:].strip() if len(text) > 1 else "")
                if lines and not unit.muted:
                    self._line.send(b"".join(row + b"\r" for row in lines), now_ns + self._delay_ns)
                if unit.streaming:
                    self._stream_ns = now_ns + unit.interval_ns

    def _stream(self, now_ns: int) -> None:
        self._stream_ns = None
        for unit in self.units:
            if unit.streaming and unit.is_up(now_ns) and not unit.muted:
                self._line.send(unit.frame() + b"\r", now_ns)
            if unit.streaming:
                self._stream_ns = now_ns + unit.interval_ns

    def _plan(self) -> None:
        times = [
            time
            for time in (self._command[0] if self._command else None, self._stream_ns)
            if time is not None
        ]
        self.act_ns = min(times, default=None)
