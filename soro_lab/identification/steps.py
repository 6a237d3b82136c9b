"""Step responses in a recording of set points and pressures, and the reasons why others are left out.

Recordings of rigs contain more than steps: flickering commands, readings that the logger repeats until a new
one arrives, frozen sensors. They would distort a fit. Each step is relative to the readings at rest before
and after it, so that the offset of a sensor does not enter the dynamics; `Step` keeps the offsets for
reports.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.errors import ConfigError
from soro_core.files.csv_rows import quoted
from soro_lab.identification.records import read_columns

T63 = 1.0 - np.exp(-1.0)
"""Part of a step that the response of a first-order lag reaches after one time constant."""


@dataclass(frozen=True)
class PressureRecord:
    """Set points and measured pressures of several lines over time.

    Attributes
    ----------
    run : str
        Name of the recording.
    t : array of shape (n_t,)
        Time [s], rising.
    lines : tuple of str
        Names of the n_u lines, regulators or chambers.
    setpoint, pressure : arrays of shape (n_t, n_u)
        Set points and pressures [Pa gauge]; nan if a pressure is missing.
    """

    run: str
    t: Array
    lines: tuple[str, ...]
    setpoint: Array
    pressure: Array

    def fresh(self) -> Flags:
        """Return which rows hold a new reading, (n_t,): rows in which the reading of a line changes."""
        changed = np.diff(np.nan_to_num(self.pressure), axis=0) != 0.0
        return np.concatenate([[True], changed.any(axis=1)])


@dataclass(frozen=True)
class StepLimits:
    """Conditions for a step whose response can be judged."""

    change_pa: float = 10e3
    """Smallest change of the set point [Pa]."""
    before_s: float = 1.0
    """Shortest constant set point before the step [s]."""
    hold_s: float = 3.0
    """Shortest constant set point after the step [s]."""
    flicker_s: float = 0.5
    """Changes of a set point within this time form one step, from the last of them, or a longer ramp [s]."""
    gap_s: float = 0.3
    """Longest time without a new reading while the pressure moves [s]."""
    moved: float = 0.2
    """Largest change of the pressure across a longer gap, as a part of the step."""
    unsettled: float = 0.1
    """Largest change of the pressure at the end, as a part of the step."""
    window_s: float = 10.0
    """Longest part of a response that is used [s]."""


@dataclass(frozen=True)
class Step:
    """One step of a set point and its response.

    Attributes
    ----------
    run, line : str
        Names of the recording and of the line.
    setpoint_pa : tuple of float
        Set points before and after [Pa gauge].
    start_pa, end_pa : float
        Readings at rest before and after [Pa gauge].
    t, pressure : arrays of shape (n,)
        New readings: time since the step [s], pressure [Pa gauge].
    t63_s : float
        Time from the step to 63.2 % of the way from start_pa to end_pa [s].
    noise_pa : float
        Standard deviation of the readings at rest after the step [Pa].
    """

    run: str
    line: str
    setpoint_pa: tuple[float, float]
    start_pa: float
    end_pa: float
    t: Array
    pressure: Array
    t63_s: float
    noise_pa: float

    @property
    def fill(self) -> bool:
        """Whether the pressure rises."""
        return self.end_pa > self.start_pa

    @property
    def change_pa(self) -> float:
        """Measured size of the step [Pa], positive."""
        return abs(self.end_pa - self.start_pa)


@dataclass(frozen=True)
class FoundSteps:
    """Steps of one or more records, and counts of what is left out.

    Attributes
    ----------
    steps : tuple of Step
        Steps that can be judged.
    left_out : Counter
        Number of other commanded steps by reason.
    rows, stale, missing : int
        Rows of the records, rows without a new reading, and missing pressures.
    """

    steps: tuple[Step, ...]
    left_out: Counter[str]
    rows: int
    stale: int
    missing: int

    def __add__(self, other: FoundSteps) -> FoundSteps:
        return FoundSteps(
            self.steps + other.steps,
            self.left_out + other.left_out,
            self.rows + other.rows,
            self.stale + other.stale,
            self.missing + other.missing,
        )

    def __str__(self) -> str:
        reasons = ", ".join(f"{n} {reason}" for reason, n in sorted(self.left_out.items())) or "none"
        return (
            f"{len(self.steps)} steps; left out: {reasons}. {self.rows} rows, {self.stale} of them without a "
            f"new reading, {self.missing} pressures missing"
        )


def read_pressures(path: str | Path) -> PressureRecord:
    """Read a record with the columns t [s] and, for each line NAME, pd_NAME and pm_NAME [Pa gauge].

    pd_NAME is the set point, pm_NAME the measured pressure, which may be missing (empty or nan).

    Raises
    ------
    ConfigError
        If the file is missing, has no line, lacks a column, or holds a value that is not a number.
    """
    columns = read_columns(path, ("t",), lambda name: name.startswith(("pd_", "pm_")), gaps="pm_")
    lines = tuple(name[3:] for name in columns if name.startswith("pd_"))
    if not lines:
        raise ConfigError(str(path), "", "no column pd_NAME", "a set point pd_NAME and a pressure pm_NAME")
    for name in lines:
        if f"pm_{name}" not in columns:
            key, got = quoted(f"pm_{name}"), f"only {quoted(f'pd_{name}')}"
            raise ConfigError(str(path), key, got, "the measured pressure too")
    return PressureRecord(
        Path(path).stem,
        columns["t"],
        lines,
        np.column_stack([columns[f"pd_{name}"] for name in lines]),
        np.column_stack([columns[f"pm_{name}"] for name in lines]),
    )


def find_steps(record: PressureRecord, limits: StepLimits | None = None) -> FoundSteps:
    """Return the steps of every line that can be judged."""
    limits = StepLimits() if limits is None else limits
    fresh = record.fresh()
    steps: list[Step] = []
    left_out: Counter[str] = Counter()
    for line in range(len(record.lines)):
        for rows in _changes(record.t, record.setpoint[:, line], limits.flicker_s):
            found = _step(record, line, rows, fresh, limits)
            if isinstance(found, Step):
                steps.append(found)
            elif found:
                left_out[found] += 1
    missing = int(np.isnan(record.pressure).sum())
    return FoundSteps(tuple(steps), left_out, len(record.t), int((~fresh).sum()), missing)


def crossing(t: Array, part: Array, level: float = T63) -> float:
    """Return the time at which a response passes a level, linear between samples.

    A single sample above the level is noise and does not count.

    Parameters
    ----------
    t : ndarray (n,)
        Times [s].
    part : ndarray (n,)
        Response as a part of the step.
    level : float
        Level as a part of the step.

    Returns
    -------
    float
        Time [s], nan if the response never passes the level.
    """
    above = part >= level
    above[:-1] &= above[1:]
    if not above.any():
        return float("nan")
    k = int(np.argmax(above))
    if k == 0 or part[k] <= part[k - 1]:
        return float(t[k])
    return float(t[k - 1] + (level - part[k - 1]) / (part[k] - part[k - 1]) * (t[k] - t[k - 1]))


class _Rows(NamedTuple):
    """Rows of a change: the set point is constant from `begin` to `first`, and from `start` to `end`."""

    begin: int
    first: int
    start: int
    end: int


def _changes(t: Array, setpoint: Array, flicker_s: float) -> Iterator[_Rows]:
    changes = np.flatnonzero(np.diff(setpoint)) + 1
    groups = np.split(changes, np.flatnonzero(np.diff(t[changes]) >= flicker_s) + 1) if changes.size else []
    begin = 0
    for k, group in enumerate(groups):
        end = int(groups[k + 1][0]) if k + 1 < len(groups) else len(t)
        yield _Rows(begin, int(group[0]), int(group[-1]), end)
        begin = int(group[-1])


def _step(record: PressureRecord, line: int, rows: _Rows, fresh: Flags, limits: StepLimits) -> Step | str:
    """Return the step, or the reason why it is left out; "" if the set point returns to its old value."""
    t, reading = record.t - record.t[rows.start], record.pressure[:, line]
    before, after = (float(record.setpoint[row, line]) for row in (rows.first - 1, rows.start))
    if before == after:
        return ""
    if abs(after - before) < limits.change_pa:
        return "too small"
    if t[rows.first] < -limits.flicker_s:
        return "a ramp"
    if t[rows.first] - t[rows.begin] < limits.before_s or t[rows.end - 1] < limits.hold_s:
        return "not held long enough"
    there = ~np.isnan(reading)
    last = min(float(t[rows.end - 1]), limits.window_s)
    rest = there & (t >= -limits.before_s) & (t < 0.0)
    middle, final = (there & (t >= k * last / 3) & (t <= (k + 1) * last / 3) for k in (1, 2))
    if not (rest.any() and middle.any() and final.any()):
        return "pressure missing"
    low, high = float(np.median(reading[rest])), float(np.median(reading[final]))
    if (high - low) * np.sign(after - before) < 0.5 * abs(after - before):
        return "no response"
    size = abs(high - low)
    if abs(np.median(reading[middle]) - high) > limits.unsettled * size:
        return "not settled"
    kept = fresh & there & (t >= 0.0) & (t <= last)
    time, pressure = t[kept], reading[kept]
    jump = np.abs(np.diff(pressure, prepend=low)) > limits.moved * size
    if (jump & (np.diff(time, prepend=0.0) > limits.gap_s)).any():
        return "frozen while it moved"
    t63 = crossing(np.append(0.0, time), np.append(0.0, (pressure - low) / (high - low)))
    if t63 == 0.0:  # the pressure followed a set point that took longer than its lag
        return "a ramp"
    noise = float(np.std(reading[final]))
    return Step(record.run, record.lines[line], (before, after), low, high, time, pressure, t63, noise)
