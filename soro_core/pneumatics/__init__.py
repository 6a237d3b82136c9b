"""Pressure regulators and the air behind them."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.pneumatics.chamber import Gas as Gas
    from soro_core.pneumatics.chamber import chamber_pressures as chamber_pressures
    from soro_core.pneumatics.chamber import inflows as inflows
    from soro_core.pneumatics.chamber import make_gas as make_gas
    from soro_core.pneumatics.chamber import masses_at as masses_at
    from soro_core.pneumatics.regulator import RegulatorModel as RegulatorModel
    from soro_core.pneumatics.regulator import RegulatorState as RegulatorState
    from soro_core.pneumatics.regulator import initial_state as initial_state
    from soro_core.pneumatics.regulator import reading as reading
    from soro_core.pneumatics.regulator import step as step
    from soro_core.pneumatics.regulator import targets as targets
    from soro_core.pneumatics.regulator import vent_time as vent_time
    from soro_core.pneumatics.valve_condition import ValveAction as ValveAction
    from soro_core.pneumatics.valve_condition import ValveCondition as ValveCondition
    from soro_core.pneumatics.valve_condition import healthy as healthy
    from soro_core.pneumatics.valve_model import ValveModel as ValveModel

__all__, __getattr__ = lazy(
    __name__,
    {
        ".chamber": "Gas chamber_pressures inflows make_gas masses_at",
        ".regulator": "RegulatorModel RegulatorState initial_state reading step targets vent_time",
        ".valve_condition": "ValveAction ValveCondition healthy",
        ".valve_model": "ValveModel",
    },
)
