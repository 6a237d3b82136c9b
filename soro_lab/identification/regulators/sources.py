"""What recordings show of air: set points with readings, pumps with duty cycles, closed chambers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_lab.identification.pump import PumpRun
from soro_lab.identification.recording import Recording, Series
from soro_lab.identification.regulators.leak import LeakRun
from soro_lab.identification.steps import PressureRecord

# A pump that fills moves the pressure by more than this [Pa].
_MOVED_PA = 1e3


def held(series: Series, t: Array) -> Array:
    """Return the values (len(t), m) of a series at times t [s], each held until the next one."""
    last = np.searchsorted(series.t, t, side="right") - 1
    values: Array = series.values[np.clip(last, 0, None)]
    return values


def step_records(recordings: Sequence[Recording]) -> list[PressureRecord]:
    """Return measured pressures with the set points at their times, of recordings that have both."""
    found = []
    for one in recordings:
        if one.command is None or one.duty is not None or one.is_stated:
            continue
        # Rows at the stamps of both: a step begins when its set point comes, not with the next reading.
        t = np.union1d(one.command.t, one.pressure.t)
        found.append(PressureRecord(one.name, t, one.chambers, held(one.command, t), held(one.pressure, t)))
    return found


def pump_runs(recordings: Sequence[Recording]) -> list[PumpRun]:
    """Return runs of pumps whose duty cycle was recorded, one for each chamber that has one.

    Raises
    ------
    ConfigError
        If a chamber under power stays where it is.
    """
    found = []
    for one in recordings:
        if one.duty is None:
            continue
        t = one.pressure.t - one.pressure.t[0]
        for k, chamber in enumerate(one.chambers):
            duty = held(one.duty, one.pressure.t)[:, k]
            if not duty.any():
                continue
            target = np.nan if one.command is None else float(one.command.values[-1, k])
            run = PumpRun(one.name, None, target, t, one.pressure.values[:, k], duty)
            if run.levels_pa[1] - run.levels_pa[0] < _MOVED_PA:
                low, high = run.levels_pa
                got = f"from {low:.0f} to {high:.0f} Pa under power"
                raise ConfigError(one.name, chamber, got, f"a pump that fills by {_MOVED_PA:.0f} Pa or more")
            found.append(run)
    return found


def leak_runs(recordings: Sequence[Recording]) -> list[LeakRun]:
    """Return closed chambers: those of recordings that have pressures alone."""
    return [
        LeakRun(one.name, chamber, one.pressure.t, values)
        for one in recordings
        if one.command is None and one.duty is None and not one.is_stated and not one.shapes and not one.imus
        for chamber, values in zip(one.chambers, one.pressure.values.T, strict=True)
    ]
