"""Recordings in CSV files, read with a column map."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.config import find_config, load
from soro_core.errors import ConfigError
from soro_core.robot import Robot
from soro_lab.identification.recording.base_frame import in_frame_of
from soro_lab.identification.recording.clean import Raw, raw, usable, without_stale
from soro_lab.identification.recording.place import Place
from soro_lab.identification.recording.recording import Recording
from soro_lab.identification.recording.sources.columns import (
    FACTORS,
    Columns,
    PoseColumns,
    PressureColumns,
    assumed_directions,
    chambers_of,
    check_columns,
    without_shape,
)
from soro_lab.identification.recording.stale import StaleLimits
from soro_lab.identification.recording.streams import Bend, Curvature, Marker, Plate, Series
from soro_lab.identification.records import read_table


def stated_pressure(steps: Sequence[Sequence[float]], lag_s: Sequence[float], t: Array) -> Array:
    """Return the pressure (n,) at times t: of first order from level to level.

    Parameters
    ----------
    steps : sequence of (time, level)
        Time [s] at which each level is commanded, in order; the first holds before its time too.
    lag_s : (rise, fall)
        Lags [s] towards a higher and a lower level; 0: at once.
    t : (n,)
        Times [s], rising.
    """
    pressure = np.full(len(t), float(steps[0][1]))
    value, begin = float(steps[0][1]), float(steps[0][0])
    target, lag = value, 0.0
    for time, level in steps[1:]:
        value += (target - value) * _share(np.array([time - begin]), lag)[0]
        target, lag, begin = float(level), lag_s[0] if level > value else lag_s[1], float(time)
        later = t >= begin
        pressure[later] = value + (target - value) * _share(t[later] - begin, lag)
    return pressure


def _share(after: Array, lag: float) -> Array:
    """Share of a step that is done at some times [s] after it."""
    return -np.expm1(-after / lag) if lag > 0.0 else np.ones(len(after))


def read_csv(
    path: str | Path, columns: Columns | str | Path, robot: Robot | None, limits: StaleLimits | None = None
) -> Recording:
    """Read a CSV file of numbers under a line of names, as loggers write it (`CsvRows`).

    Parameters
    ----------
    path : path
    columns : Columns or path
        The column map, its YAML file, or the name of a shipped one (config/recordings).
    robot : Robot or None
        Robot of the recording, which names the chambers; None of air alone: the map names chambers.
    limits : StaleLimits, optional
        When readings are repeated or frozen.

    Raises
    ------
    ConfigError
        If a file is missing, the map does not fit robot or file, or a stream has no usable samples.
    """
    map_file = "columns" if isinstance(columns, Columns) else str(find_config(columns, "recordings"))
    columns = columns if isinstance(columns, Columns) else load(map_file, Columns)
    chambers = chambers_of(columns, robot, map_file)
    bare = without_shape(columns) if robot is None else columns
    notes: tuple[str, ...] = (
        () if bare == columns else ("the shape is not read: no robot file says what it is of",)
    )
    columns = bare
    if robot is not None:
        check_columns(columns, robot, map_file)
        notes += assumed_directions(columns, robot)
    file = Path(path).stem
    for key, section in (("pressures", columns.pressures), ("commands", columns.commands)):
        if section is not None:
            _check_chambers(key, section, chambers, file, map_file)
    asked = _asked(columns, map_file)
    table, left_out = read_table(path, tuple(asked), lambda name: False, asked)
    notes += (left_out,) if left_out else ()
    t = table[columns.time.column] * FACTORS[columns.time.unit]
    usual = None if robot is None else pressure_limits(robot)
    found = [
        usable(each, str(path)) for each in _raw_streams(columns, chambers, usual, table, t, file, robot)
    ]
    driving = ("command", "duty")
    found = without_stale(found, driving if columns.pressures.columns else (*driving, "pressure"), limits)
    if columns.base is not None:
        base = next(stream for stream, _ in found if stream.name == "base")
        assert isinstance(base, Plate)
        found = [
            (in_frame_of(base, stream, columns.base.moves, columns.base.turns), faults)
            for stream, faults in found
        ]
    streams = [stream for stream, _ in found]
    series = {stream.name: stream for stream in streams if isinstance(stream, Series)}
    return Recording(
        name=file,
        chambers=chambers,
        pressure=series["pressure"],
        command=series.get("command"),
        duty=series.get("duty"),
        plates=tuple(s for s in streams if isinstance(s, Plate) and s.name != "base"),
        markers=tuple(s for s in streams if isinstance(s, Marker)),
        curvatures=tuple(s for s in streams if isinstance(s, Curvature)),
        bends=tuple(s for s in streams if isinstance(s, Bend)),
        is_stated=not columns.pressures.columns,
        frame="base" if columns.base else columns.frame,
        faults=tuple(faults for _, faults in found),
        notes=notes,
    )


def _check_chambers(
    name: str, section: PressureColumns, chambers: tuple[str, ...], file: str, where: str
) -> None:
    """Refuse a map that gives a chamber no pressure, or two."""
    stated = section.levels(file)
    for chamber in chambers:
        if chamber not in section.columns and chamber not in stated:
            key = f"{name}.stated_by_file.{file}" if section.stated_by_file else f"{name}.columns"
            raise ConfigError(
                where, key, f"nothing for {chamber}", "a column or stated levels of each chamber"
            )
        if chamber in section.columns and chamber in stated:
            raise ConfigError(where, f"{name}.stated.{chamber}", stated[chamber], "no levels beside a column")


def _asked(columns: Columns, where: str) -> dict[str, str]:
    """Return all columns that the map names, and the key of each."""
    asked = {columns.time.column: "time.column"}
    for key, section in (("pressures", columns.pressures), ("commands", columns.commands)):
        if section is not None:
            asked |= {column: f"{key}.columns.{name}" for name, column in section.columns.items()}
    if columns.duty is not None:
        asked |= {column: f"duty.columns.{name}" for name, column in columns.duty.columns.items()}
    bodies: dict[str, PoseColumns] = {f"plates.{name}": body for name, body in columns.plates.items()}
    bodies |= {"base": columns.base} if columns.base else {}
    for key, body in bodies.items():
        asked |= dict.fromkeys(body.position, f"{key}.position")
        asked |= dict.fromkeys(body.quaternion, f"{key}.quaternion")
        asked |= {body.ok: f"{key}.ok"} if body.ok else {}
    for name, marker in columns.markers.items():
        asked |= dict.fromkeys(marker.position, f"markers.{name}.position")
    for name, curvature in columns.curvatures.items():
        asked |= dict.fromkeys(curvature.columns, f"curvatures.{name}.columns")
    asked |= {bend.column: f"bends.{name}.column" for name, bend in columns.bends.items()}
    return {column: f"{key} of {where}" for column, key in asked.items()}


def _raw_streams(
    columns: Columns,
    chambers: tuple[str, ...],
    usual: Array | None,
    table: dict[str, Array],
    t: Array,
    file: str,
    robot: Robot | None,
) -> list[Raw]:
    def stack(names: tuple[str, ...], unit: str = "m") -> Array:
        return np.column_stack([table[name] for name in names]) * FACTORS[unit]

    def plate(name: str, body: PoseColumns, place: Place) -> Raw:
        bad = None if body.ok is None else ~(table[body.ok] > 0.0)
        turn = np.column_stack([table[column] for column in body.quaternion])
        return raw(Plate(name, t, place, stack(body.position, body.unit), turn, columns.frame), bad)

    found = [_pressures("pressure", columns.pressures, chambers, usual, table, t, file)]
    if columns.commands is not None:
        found.append(_pressures("command", columns.commands, chambers, usual, table, t, file))
    if columns.duty is not None:
        values = np.zeros((len(t), len(chambers)))
        for chamber, column in columns.duty.columns.items():
            values[:, chambers.index(chamber)] = table[column] / columns.duty.full
        found.append(raw(Series("duty", t, values), None, _outside(values, np.array([0.0, 1.0]))))
    if columns.base is not None:
        found.append(plate("base", columns.base, Place(0, 0.0)))
    found += [plate(name, body, body.place) for name, body in columns.plates.items()]
    for name, marker in columns.markers.items():
        position = stack(marker.position, marker.unit)
        found.append(raw(Marker(name, t, marker.place, position, marker.offset_m, columns.frame)))
    for name, curvature in columns.curvatures.items():
        values = stack(curvature.columns, curvature.unit)
        limits = None if curvature.range is None else np.array(curvature.range) * FACTORS[curvature.unit]
        found.append(raw(Curvature(name, t, curvature.link, values), None, _outside(values, limits)))
    for name, bend in columns.bends.items():
        assert robot is not None, "without a robot no shape is read"
        towards = bend.direction(robot.links[bend.link])
        found.append(raw(Bend(name, t, bend.link, stack((bend.column,), bend.unit)[:, 0], towards)))
    return found


def _pressures(
    name: str,
    section: PressureColumns,
    chambers: tuple[str, ...],
    usual: Array | None,
    table: dict[str, Array],
    t: Array,
    file: str,
) -> Raw:
    """Return pressures or set points (n, n_u) [Pa]; set points of chambers without any are not finite."""
    stated = section.levels(file)
    values = np.full((len(t), len(chambers)), np.nan)
    for k, chamber in enumerate(chambers):
        if chamber in section.columns:
            values[:, k] = table[section.columns[chamber]]
        elif chamber in stated:
            values[:, k] = stated_pressure(stated[chamber], section.stated_lag_s, t)
    values = values * section.factor + section.offset_pa
    limits = usual
    if section.range is not None:
        limits = np.array(section.range) * section.factor + section.offset_pa
    return raw(Series(name, t, values), None, _outside(values, limits) if section.columns else None)


def pressure_limits(robot: Robot) -> Array:
    """Return the pressures [Pa] (2,) beyond which a reading cannot be one: the robot's range, half wider."""
    low, high = robot.pressure_range_pa
    half = 0.5 * (high - low)
    return np.array([low - half, high + half])


def _outside(values: Array, limits: Array | None) -> Flags | None:
    if limits is None:
        return None
    out: Flags = ((values < limits[0]) | (values > limits[1])).any(axis=1)
    return out
