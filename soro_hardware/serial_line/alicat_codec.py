"""Decoding of Alicat ASCII: version, table of columns (`??D*`), data frame, answer to a set point.

The formats are those of devices with firmware 5v12, 8v17 and 10v20.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

# Pressure units by label, without the letter for gauge (G), absolute (A) or difference (D).
_UNITS_PA = {
    "PA": 1.0,
    "HPA": 100.0,
    "KPA": 1e3,
    "MPA": 1e6,
    "MBAR": 100.0,
    "BAR": 1e5,
    "PSI": 6894.757293168,
}
MODERN_SETPOINT = (9, 0)  # LS; below S
SETPOINT_SOURCE = (10, 5)  # LSS

Version: TypeAlias = tuple[int, int]

_VERSION = re.compile(r"\b(\d{1,2})v(\d{2})\b")
_ROW = re.compile(
    r"([A-Z]) +D\d\d +\d{3} (\*?)(\S.*?) {2,}(?:s decimal|decimal|string|integer) +\d+(?:/(\d+))? *(.*)"
)
_OLD_ROW = re.compile(r"([A-Z]) +D\d\d +(\S.*?) +(signed|unsigned|char|string) +(\S+) +(\S+) +(\S+)")
_FLAG = re.compile(r"[A-Z0-9]{3}")
_NUMBER = re.compile(r"[+-]?\d{1,7}(\.\d{1,4})?")


@dataclass(frozen=True)
class FrameLayout:
    """Columns of pressure and set point in a data frame.

    Attributes
    ----------
    columns : int
        Number of columns of every frame, with the unit letter.
    pressure, setpoint : int
        Index of pressure and set point.
    unit_pa : float
        Unit of both [Pa].
    decimals : int
        Decimals of the set point.
    """

    columns: int
    pressure: int
    setpoint: int
    unit_pa: float
    decimals: int

    @property
    def resolution_pa(self) -> float:
        """Step of a set point [Pa]."""
        return float(self.unit_pa * 10.0**-self.decimals)


@dataclass(frozen=True)
class DataFrame:
    """One data frame: pressure [Pa gauge], set point in counts of the resolution, and status flags."""

    pressure_pa: float
    setpoint_counts: int
    flags: frozenset[str]


def parse_version(line: bytes) -> Version | None:
    """Return the firmware version in an answer to `VE` or `??M*`, for example (10, 20) for 10v20.0-R24."""
    found = _VERSION.search(line.decode("ascii", "replace"))
    return (int(found[1]), int(found[2])) if found else None


def parse_layout(lines: Sequence[bytes], unit: str) -> FrameLayout:
    """Return the layout in the table of a device, which has one of two forms.

    Raises
    ------
    ValueError
        If the table has no gauge pressure with a set point.
    """
    columns: list[tuple[str, int, str]] = []  # name, decimals, label of the unit
    for line in lines:
        text = line.decode("ascii", "replace").rstrip()
        if row := _ROW.fullmatch(text):
            letter, star, name, decimals, notes = row.groups()
            column = (name, int(decimals or 0), notes.split()[-1] if notes.split() else "")
        elif row := _OLD_ROW.fullmatch(text):
            letter, name, _, low, _, label = row.groups()
            star = "*" if name in ("Error", "Status") else ""
            column = (name, len(low.partition(".")[2]), label)
        else:
            continue
        if letter == unit and not star:
            columns.append(column)
    setpoint = _only(columns, lambda name: "setp" in name, "set point")
    pressure = _only(columns, lambda name: "press" in name and "setp" not in name, "pressure")
    unit_pa = _gauge_unit(columns[pressure][2])
    if _gauge_unit(columns[setpoint][2]) != unit_pa:
        raise ValueError(f"set point in {columns[setpoint][2]}, pressure in {columns[pressure][2]}")
    return FrameLayout(len(columns), pressure, setpoint, unit_pa, columns[setpoint][1])


def parse_frame(line: bytes, unit: str, layout: FrameLayout) -> DataFrame | None:
    """Decode a data frame.

    Parameters
    ----------
    line : bytes
        Line of an answer.
    unit : str
        Letter of the unit.
    layout : FrameLayout
        Columns of the frame.

    Returns
    -------
    DataFrame or None
        None if the line is no data frame of the unit.
    """
    fields = _fields(line)
    if len(fields) < layout.columns or fields[0] != unit:
        return None
    values = [_value(fields[column]) for column in (layout.pressure, layout.setpoint)]
    flags = frozenset(fields[layout.columns :])
    if values[0] is None or values[1] is None or not all(map(_FLAG.fullmatch, flags)):
        return None
    return DataFrame(values[0] * layout.unit_pa, round(values[1] * 10**layout.decimals), flags)


def parse_setpoint(line: bytes, unit: str, layout: FrameLayout) -> int | None:
    """Return the set point in counts in an answer to `LS`, or None; parameters as in `parse_frame`.

    The answer is letter, present and requested set point, code and label of the unit.
    """
    fields = _fields(line)
    if len(fields) != 5 or fields[0] != unit:
        return None
    requested = _value(fields[2])
    return None if requested is None else round(requested * 10**layout.decimals)


def is_refusal(line: bytes) -> bool:
    """Return whether a line is the refusal `?`, with or without a letter."""
    return bool(re.fullmatch(rb"([A-Z] )?\?", line.strip()))


def _fields(line: bytes) -> list[str]:
    return line.decode("ascii").split() if line.isascii() else []


def _value(field: str) -> float | None:
    return float(field) if _NUMBER.fullmatch(field) else None


def _only(columns: list[tuple[str, int, str]], is_it: object, what: str) -> int:
    found = [number for number, column in enumerate(columns) if is_it(column[0].lower())]  # type: ignore[operator]
    if len(found) != 1:
        names = ", ".join(column[0] for column in columns) or "none"
        raise ValueError(f"{len(found)} columns of {what} in its data frame (columns: {names})")
    return found[0]


def _gauge_unit(label: str) -> float:
    unit = label.upper()
    if unit not in _UNITS_PA:
        if unit[-1:] in ("A", "D") and unit[:-1] in _UNITS_PA:
            raise ValueError(f"its pressure is in {label}, not in a gauge unit")
        unit = unit.removesuffix("G")
    if unit not in _UNITS_PA:
        raise ValueError(f"its pressure is in {label}; known are {', '.join(_UNITS_PA)}")
    return _UNITS_PA[unit]
