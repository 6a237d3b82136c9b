"""Columns of CSV files, and the forced motion of one segment: pressures and curvatures."""

from __future__ import annotations

import logging
import math
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_core.files.csv_rows import CsvRows, number_of, quoted

# Time [s] by which a late row may be older than the one before; a clock that was set falls back by more.
LATE_S = 0.1
# Lines of units and the like under the line of names.
_UNITS = 2


@dataclass(frozen=True)
class ForcedRun:
    """Measured chamber pressures and curvatures.

    Attributes
    ----------
    t : array of shape (n_t,)
        Time [s], rising.
    pressure : array of shape (n_t, n_u)
        Chamber pressures [Pa gauge].
    curvature : array of shape (n_t, 2)
        Curvatures kx, ky [1/m] in the frame of the measurement.
    """

    t: Array
    pressure: Array
    curvature: Array

    def window(self, start_s: float, end_s: float) -> ForcedRun:
        """Return the samples with start_s <= t < end_s; times stay as recorded."""
        keep = (self.t >= start_s) & (self.t < end_s)
        return ForcedRun(self.t[keep], self.pressure[keep], self.curvature[keep])

    def pressure_at(self, t: float) -> Array:
        """Return the pressures (n_u,) [Pa] at time t [s], linear between samples, then constant."""
        return np.array([np.interp(t, self.t, column) for column in self.pressure.T])

    def curvature_at(self, t: Array) -> Array:
        """Return the curvatures (n, 2) [1/m] at times t (n,) [s], linear between samples."""
        return np.column_stack([np.interp(t, self.t, column) for column in self.curvature.T])


def read_forced(path: str | Path) -> ForcedRun:
    """Read a forced run with the columns t [s], p1, p2, ... [Pa gauge], kx, ky [1/m].

    Raises
    ------
    ConfigError
        If the file is missing, lacks a column, holds a value that is not finite, or time does not rise.
    """
    columns = read_columns(path, ("t", "p1", "kx", "ky"))
    pressures = [columns[name] for name in columns if name[:1] == "p" and name[1:].isdigit()]
    return ForcedRun(
        columns["t"], np.column_stack(pressures), np.column_stack([columns["kx"], columns["ky"]])
    )


def read_columns(
    path: str | Path, required: tuple[str, ...], also: Callable[[str], bool] | None = None, gaps: str = ""
) -> dict[str, Array]:
    """Return the columns of a CSV file of numbers under one line of names.

    Parameters
    ----------
    path : path
    required : tuple of str
        Required columns; the first is the time, which must rise.
    also : callable, optional
        Predicate of the name that selects other columns; all by default.
    gaps : str
        Prefix of columns whose values may be missing (empty or nan); "" for none.

    Returns
    -------
    dict of str to ndarray (n,)
        Columns by name.

    Raises
    ------
    ConfigError
        If the file is missing, lacks a column, most rows have values that are not finite, or time runs
        backwards. What is left out else is logged.
    """
    where = str(path)
    columns, note = read_table(path, required, also)
    notes, count = [note] if note else [], len(columns[required[0]])
    keep = np.ones(count, bool)
    for name, column in columns.items():
        bad = np.isinf(column) if gaps and name.startswith(gaps) else ~np.isfinite(column)
        keep &= ~bad
        if bad.any() and keep.sum() < max(2, 0.5 * count):
            row = int(np.flatnonzero(bad)[0])
            raise ConfigError(where, quoted(name), f"{column[row]} in row {row + 1}", "finite numbers")
    columns = {name: column[keep] for name, column in columns.items()}
    time = columns[required[0]]
    fall = np.concatenate([[-np.inf], np.maximum.accumulate(time)[:-1] - time[1:]])
    if fall.max(initial=-np.inf) > LATE_S or 2 * (fall >= 0.0).sum() >= len(fall):
        raise ConfigError(where, quoted(required[0]), "times that do not rise", "strictly rising times [s]")
    columns = {name: values[fall < 0.0] for name, values in columns.items()}
    if left_out := count - int((fall < 0.0).sum()):
        notes.append(f"{left_out} rows left out: a value is not finite, or the time does not rise")
    for line in notes:
        logging.getLogger("soro_lab").warning("%s: %s", where, line)
    return columns


def read_table(
    path: str | Path,
    required: tuple[str, ...],
    also: Callable[[str], bool] | None = None,
    asked_by: Mapping[str, str] | None = None,
) -> tuple[dict[str, Array], str]:
    """Return the columns of a CSV file of numbers, and what was left out of it; nan where a cell is empty.

    Parameters
    ----------
    path : path
        File, in any layout that `CsvRows` reads; a line of units under the names is skipped.
    required : tuple of str
    also : callable, optional
        Predicate of the name that selects other columns; all by default.
    asked_by : mapping of str to str, optional
        What asks for each required column, for errors.

    Returns
    -------
    tuple of dict of str to ndarray (n,), and str
        Columns by name; one line that counts the rows left out, "" for none.

    Raises
    ------
    ConfigError
        If the file is missing, lacks a column, has one twice, marks decimals in two ways, or has fewer than
        two rows of numbers.
    """
    rows = CsvRows(path, required, asked_by)
    chosen = [name for name in rows.names if name and (name in required or also is None or also(name))]
    places = {name: rows.place(name) for name in chosen}
    found, marks, units = array("d"), set[str](), 0
    for line, cells in rows:
        texts = [cells[place] for place in places.values()]
        try:
            values = [number_of(text, rows.delimiter) for text in texts]
        except ValueError as error:
            if found or units == _UNITS or any(_is_number(text, rows.delimiter) for text in texts):
                rows.leave_out(line, str(error))
            else:
                units += 1
                rows.skip()
            continue
        found.extend(values)
        together = "".join(texts)
        marks.update(mark for mark in ",." if mark in together)
        if len(marks) > 1:
            allowed = "one decimal mark in all numbers, and no marks of thousands"
            raise ConfigError(rows.where, f"line {line}", "decimal commas and decimal points", allowed)
    note = rows.check(least=2)
    table = np.frombuffer(found).reshape(-1, len(places))
    return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(places)}, note


def _is_number(text: str, delimiter: str) -> bool:
    try:
        return not math.isnan(number_of(text, delimiter))
    except ValueError:
        return False
