"""Integration in time: `simulate`, steppers, derivatives of a step, air, and the balance of energy."""

from soro_core.integrate.simulate import Result, simulate
from soro_core.integrate.simulate_many import Runs, simulate_many
from soro_core.integrate.state import OK, State, Status
from soro_core.integrate.stepper import STEPPERS, Stepper, make_stepper
from soro_core.integrate.warm_up import warm_up

__all__ = [
    "OK",
    "STEPPERS",
    "Result",
    "Runs",
    "State",
    "Status",
    "Stepper",
    "make_stepper",
    "simulate",
    "simulate_many",
    "warm_up",
]
