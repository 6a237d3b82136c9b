"""Pressure regulators and the air behind them."""

from soro_core.pneumatics.chamber import (
    Gas,
    ValveModel,
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
    vent_time,
)

__all__ = [
    "Gas",
    "RegulatorModel",
    "RegulatorState",
    "ValveModel",
    "chamber_pressures",
    "inflows",
    "initial_state",
    "make_gas",
    "masses_at",
    "reading",
    "step",
    "vent_time",
]
