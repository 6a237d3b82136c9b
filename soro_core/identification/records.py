"""Recorded runs of one segment, as CSV: forced motion (pressures, curvatures) and release (bending angle)."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.errors import ConfigError

Array: TypeAlias = NDArray[np.float64]


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


@dataclass(frozen=True)
class ReleaseRun:
    """Bending angle after the release of the tip.

    Attributes
    ----------
    t : array of shape (n_t,)
        Time [s], from 0.
    bend : array of shape (n_t,)
        Bending angle kappa L (1 + eps) [rad].
    """

    t: Array
    bend: Array


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


def read_release(path: str | Path) -> ReleaseRun:
    """Read a release with the columns t [s] and bend_deg [degrees]; errors as `read_forced`."""
    columns = read_columns(path, ("t", "bend_deg"))
    return ReleaseRun(columns["t"] - columns["t"][0], np.radians(columns["bend_deg"]))


def read_columns(
    path: str | Path, required: tuple[str, ...], also: Callable[[str], bool] | None = None, gaps: str = ""
) -> dict[str, Array]:
    """Return the columns of a CSV file of numbers under one line of names.

    Parameters
    ----------
    path : path
        File.
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
        If the file is missing, lacks a column, holds a value that is not finite, or time does not rise.
    """
    where = str(path)
    columns = read_table(path, required, also)
    for name, column in columns.items():
        bad = np.isinf(column) if gaps and name.startswith(gaps) else ~np.isfinite(column)
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise ConfigError(where, name, f"{column[row]} in data row {row + 1}", "finite numbers")
    if not (np.diff(columns[required[0]]) > 0).all():
        raise ConfigError(where, required[0], "times that do not rise", "strictly rising times [s]")
    return columns


def read_table(
    path: str | Path,
    required: tuple[str, ...],
    also: Callable[[str], bool] | None = None,
    asked_by: Mapping[str, str] | None = None,
) -> dict[str, Array]:
    """Return the columns of a CSV file under one line of names; nan where a field is empty.

    Parameters
    ----------
    path : path
        File.
    required : tuple of str
        Required columns.
    also : callable, optional
        Predicate of the name that selects other columns; all by default.
    asked_by : mapping of str to str, optional
        What asks for each required column, for errors.

    Returns
    -------
    dict of str to ndarray (n,)
        Columns by name.

    Raises
    ------
    ConfigError
        If the file is missing, lacks a column, or holds a value that is no number.
    """
    where = str(path)
    try:
        with open(path, encoding="utf-8") as file:
            names = [name.strip() for name in file.readline().split(",")]
            places = [i for i, name in enumerate(names) if name in required or also is None or also(name)]
            with warnings.catch_warnings():  # a table without rows is refused below
                warnings.simplefilter("ignore", UserWarning)
                table = np.loadtxt(file, delimiter=",", ndmin=2, usecols=places, converters=_number)
    except FileNotFoundError:
        raise ConfigError(
            where, "", "no such file", f"a CSV file with the columns {', '.join(required)}"
        ) from None
    except (OSError, ValueError) as error:
        raise ConfigError(where, "", str(error), "a CSV file of numbers under one line of names") from None
    for name in required:
        if name not in names:
            allowed = f"a column for {asked_by[name]}" if asked_by else "this column is required"
            raise ConfigError(where, name, f"columns {', '.join(names)}", allowed)
    if table.shape[0] < 2:
        raise ConfigError(where, "", f"{table.shape[0]} rows", "two or more rows of numbers")
    return {names[place]: np.ascontiguousarray(table[:, i]) for i, place in enumerate(places)}


def _number(text: str) -> float:
    return float(text) if text.strip() else np.nan
