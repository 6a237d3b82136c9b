"""Pressure regulators and the air behind them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.pneumatics.chamber import (
        Gas,
        chamber_pressures,
        inflows,
        make_gas,
        masses_at,
    )
    from soro_core.pneumatics.regulator import (
        RegulatorModel,
        RegulatorState,
        initial_state,
        reading,
        step,
        targets,
        vent_time,
    )
    from soro_core.pneumatics.valve_condition import ValveAction, ValveCondition, healthy
    from soro_core.pneumatics.valve_model import ValveModel

__all__ = [
    "Gas",
    "RegulatorModel",
    "RegulatorState",
    "ValveAction",
    "ValveCondition",
    "ValveModel",
    "chamber_pressures",
    "healthy",
    "inflows",
    "initial_state",
    "make_gas",
    "masses_at",
    "reading",
    "step",
    "targets",
    "vent_time",
]

__getattr__ = lazy(
    __name__,
    {
        "Gas": "soro_core.pneumatics.chamber",
        "RegulatorModel": "soro_core.pneumatics.regulator",
        "RegulatorState": "soro_core.pneumatics.regulator",
        "ValveAction": "soro_core.pneumatics.valve_condition",
        "ValveCondition": "soro_core.pneumatics.valve_condition",
        "ValveModel": "soro_core.pneumatics.valve_model",
        "chamber_pressures": "soro_core.pneumatics.chamber",
        "healthy": "soro_core.pneumatics.valve_condition",
        "inflows": "soro_core.pneumatics.chamber",
        "initial_state": "soro_core.pneumatics.regulator",
        "make_gas": "soro_core.pneumatics.chamber",
        "masses_at": "soro_core.pneumatics.chamber",
        "reading": "soro_core.pneumatics.regulator",
        "step": "soro_core.pneumatics.regulator",
        "targets": "soro_core.pneumatics.regulator",
        "vent_time": "soro_core.pneumatics.regulator",
    },
)
