"""Pressure regulators and the air behind them."""

from soro_core.pneumatics.regulator import (
    RegulatorModel,
    RegulatorState,
    initial_state,
    reading,
    step,
    vent_time,
)

__all__ = ["RegulatorModel", "RegulatorState", "initial_state", "reading", "step", "vent_time"]
