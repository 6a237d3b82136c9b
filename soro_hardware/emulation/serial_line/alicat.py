"""An emulated Alicat pressure controller, with the answers of its firmware."""

from __future__ import annotations

import re

from soro_hardware.emulation.serial_line.uart import Station, Uart
from soro_hardware.emulation.serial_line.valve import SerialValve, ValveSetup
from soro_hardware.serial_line.alicat_codec import MODERN_SETPOINT, SETPOINT_SOURCE, parse_version

_UNITS = {"kPaG": (1e3, 2, 14), "barG": (1e5, 4, 18), "PSIG": (6894.757293168, 2, 22)}  # Pa, decimals, code
_FULL_SCALE_COUNTS = 64000
_GAUGE, _SETPOINT = 6, 38  # codes of its pressure and of its set point
# Of the recorded devices only 8v17 does not answer VE; 5v12, 6v21, 7v09, 8v30 and 10v03 to 10v20 do.
_WITHOUT_VE = ((8, 0), (8, 30))
_FIRST_FPF = (6, 0)
_STATUS = ("OPL", "POV", "P2O", "TOV", "VOV", "MOV", "OVR", "HLD", "EXH", "LCK")


class EmulatedAlicat(SerialValve):
    """One unit.

    Parameters
    ----------
    unit : str
        Letter of the unit.
    firmware, pressure_unit : str
        Version of its firmware, and unit of its pressures.
    setup : ValveSetup
        Range, sensor and times.
    """

    def __init__(self, unit: str, firmware: str, pressure_unit: str, setup: ValveSetup) -> None:
        super().__init__(setup)
        self.version = parse_version(firmware.encode()) or (0, 0)
        self.unit, self.firmware, self._label = unit, firmware, pressure_unit
        self._unit_pa, self._decimals, self._code = _UNITS[pressure_unit]
        self.source = "S"
        self.flags: set[str] = set()
        self.streaming = False
        self.interval_ns = 50_000_000
        self.held_pa: float | None = None

    def to_unit(self, pressure_pa: float) -> float:
        return round(pressure_pa / self._unit_pa, self._decimals)

    def demand_pa(self) -> float:
        """Return the set point [Pa gauge], or the pressure that a valve on hold keeps."""
        return self.setpoint * self._unit_pa if self.held_pa is None else self.held_pa

    def reboot(self, now_ns: int) -> None:
        super().reboot(now_ns)
        self.held_pa = None
        self.flags.clear()

    def ignore_setpoints(self, is_on: bool) -> None:
        """Switch to the analog input as source of the set point, which keeps the last one, or back."""
        self.source = "A" if is_on else "S"

    def overheat(self, is_on: bool) -> None:
        """Report a temperature out of range, or none."""
        (self.flags.add if is_on else self.flags.discard)("TOV")

    def frame(self) -> bytes:
        """Return a data frame."""
        letter = "@" if self.streaming else self.unit
        values = " ".join(map(self._number, (self.reading_pa() / self._unit_pa, self.setpoint)))
        return " ".join([letter, values, *sorted(self.flags)]).encode()

    def command(self, text: str) -> list[bytes]:
        """Return the lines of the answer to a command, given without the letter and in upper case."""
        if text == "":
            return [self.frame()]
        text = text.removeprefix("$$")  # the oldest firmware requires it before a command that is no query
        if text.startswith("L") and self.version < MODERN_SETPOINT:
            if self.version < (8, 0):
                self.flags.add("LCK")  # any AL... locks the panel on these
            return [self.frame()]
        if re.fullmatch(r"@ @|@=@", text):
            self.streaming = True
            return []
        if found := re.fullmatch(r"LS +([+-]?[\d.]+)", text):
            return self._ls() if self._set(found[1]) else [b"?"]
        if text == "LS":
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
        if text == "VE":
            if _WITHOUT_VE[0] <= self.version < _WITHOUT_VE[1]:
                return []
            return [b"%s   %s Jan  9 2025,15:04:07" % (letter, self.firmware.encode())]
        if text == "??D*":
            return [row.encode() for row in self._table()]
        if (found := re.fullmatch(r"\?\?M(\*|\d)", text)) is not None:
            rows = self._manufacturer()
            return rows if found[1] == "*" else [rows[int(found[1])]]
        if (found := re.fullmatch(r"FPF +(\d{1,3})", text)) is not None:
            return self._full_scale(int(found[1]))
        if text == "R122" or re.fullmatch(rf"LV(?: +{_SETPOINT})?", text):
            # Controlled quantity: a register in older firmware, a command in newer firmware.
            return [b"%s %s%d" % (letter, b"  122 = " if text == "R122" else b"", _SETPOINT)]
        if text.startswith("LSS") and self.version >= SETPOINT_SOURCE:
            found = re.fullmatch(r"LSS(?: +([SAU])(?: [01])?)?", text)
            if found is None:
                return [b"?"]
            self.source = found[1] or self.source
            return [letter + b" " + self.source.encode()]
        if text in ("HP", "HC"):
            self.flags.add("HLD")
            self.held_pa = 0.0 if text == "HC" else self.reading_pa()
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
        if self.source == "S":  # with another source the unit confirms the set point but ignores it
            self.setpoint = round(value, self._decimals)
        return True

    def _ls(self) -> list[bytes]:
        reading = self._number(self.reading_pa() / self._unit_pa)
        text = f"{self.unit} {reading} {self._number(self.setpoint)} {self._code} {self._label}"
        return [text.encode()]

    def _full_scale(self, code: int) -> list[bytes]:
        """Return the answer to `FPF`: full scale of a statistic, or zero without unit for an unknown one."""
        if self.version < _FIRST_FPF:
            return [b"?"]
        if code not in (_GAUGE, _SETPOINT):
            if self.version < (8, 0):
                return [b"", b"?"]
            return [f"{self.unit} {self._number(0.0)} 1 ---".encode()]
        full = self._number(self._full_scale_pa / self._unit_pa)
        return [f"{self.unit} {full} {self._code} {self._label}".encode()]

    def _manufacturer(self) -> list[bytes]:
        """Return the answer to `??M*`: the ten rows that all recorded firmware versions have."""
        model = f"PC-{round(self._full_scale_pa / self._unit_pa)}{self._label.upper()}-D"
        rows = (
            "ALICAT SCIENTIFIC",
            "www.alicat.com",
            "Ph   520-290-6060",
            "Fax  520-290-0109",
            f"Model Number {model}",
            f"Serial Number {100000 + ord(self.unit)}",
            "Date Manufactured 01/09/2025",
            "Date Calibrated   01/09/2025",
            "Calibrated By     XX",
            f"Software Revision {self.firmware}",
        )
        return [f"{self.unit}  M{number:02d} {row}".encode() for number, row in enumerate(rows)]

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


_LONGEST_LINE = 64
_IDLE_BYTES = 3.5


class AlicatBus(Station):
    """All units of a line; they execute a command when the line has been idle for 3.5 bytes after its CR.

    Parameters
    ----------
    line : Uart
        Line of the units.
    units : list of EmulatedAlicat
        Units on the line.
    answer_delay_ns : int
        Time [ns] from a command to its answer.
    """

    def __init__(self, line: Uart, units: list[EmulatedAlicat], answer_delay_ns: int) -> None:
        self._line, self.units = line, units
        self._delay_ns = answer_delay_ns
        self._idle_ns = round(_IDLE_BYTES * line.byte_ns)
        self._buffer = bytearray()
        self._command: tuple[int, bytes] | None = None  # with the time of its execution
        self._stream_ns: int | None = None
        self.hurried = 0  # commands lost because the next byte arrived too early

    def receive(self, chunk: bytes, end_ns: int) -> None:
        start_ns = end_ns - len(chunk) * self._line.byte_ns
        if self._command is not None and start_ns < self._command[0]:
            if chunk == b"\n":  # an Alicat ignores the LF after a CR
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
