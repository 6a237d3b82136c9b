"""What recordings show of air: set points with readings, pumps with duty cycles, closed chambers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soro_core.errors import ConfigError
from soro_core.identification.pump import PumpRun
from soro_core.identification.recording import Recording
from soro_core.identification.regulators.leak import LeakRun
from soro_core.identification.steps import PressureRecord

# A pump that fills moves the pressure by more than this [Pa].
_MOVED_PA = 1e3


def step_records(recordings: Sequence[Recording]) -> list[PressureRecord]:
    """Return measured pressures with the set points at their times, of recordings that have both."""
    found = []
    for one in recordings:
        if one.command is None or one.duty is not None or one.is_stated:
            continue
        # A set point holds until the next one; before the first one it is not known, and taken as the first.
        last = np.clip(np.searchsorted(one.command.t, one.pressure.t, side="right") - 1, 0, None)
        setpoint, pressure = one.command.values[last], one.pressure.values
        found.append(PressureRecord(one.name, one.pressure.t, one.chambers, setpoint, pressure))
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
            duty = one.duty.values[:, k]
            if not duty.any():
                continue
            last = np.clip(np.searchsorted(one.duty.t, one.pressure.t, side="right") - 1, 0, None)
            target = np.nan if one.command is None else float(one.command.values[-1, k])
            run = PumpRun(one.name, None, target, t, one.pressure.values[:, k], duty[last])
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
