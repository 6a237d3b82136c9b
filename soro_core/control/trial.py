"""A law on trial before it gets an arm: some seconds of its reference on the model, with load and lag.

A law that cancels the stiffness of the arm, or puts an integrator on its tip, relies on pressures that act
at once. Regulators of 50 ms make it late, and the arm is lost (docs/adr/0005). The trial finds that: state
known, model exact but for the load, regulators as the law believes them. It refuses a law that cannot work;
it proves nothing of a law that it accepts.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from soro_core.arrays import Array
from soro_core.control.command import Command, ControllerState
from soro_core.control.laws.protocol import Law, Setting
from soro_core.control.pressures.actuation import DEFAULT_RATE_HZ
from soro_core.errors import ConfigError
from soro_core.integrate import State, make_stepper
from soro_core.model.discretised import discretised
from soro_core.pneumatics.lag import follow as follow_lag
from soro_core.robot import Discretisation

# A tick, from state, q, qd, time [s], time since the last tick [s] and measured pressures [Pa gauge].
Step: TypeAlias = Callable[
    [ControllerState, Array, Array, float, float, Array], tuple[ControllerState, Command]
]

# Time after the start of the reference [s], and its part that is judged.
_AFTER_S, _JUDGED_S = 6.0, 1.0
# Tip error that is a lost arm, of the length; the verdict of a run has the same.
LOST_PART = 0.1


def refuse_lost_arm(law: Law[Any], begin: ControllerState, step: Step) -> None:
    """Refuse a law that loses the arm with one of the loads that it states.

    Parameters
    ----------
    law : Law
        On trial.
    begin : ControllerState
        State before the first tick.
    step : callable
        A tick of the controller with this law.

    Raises
    ------
    ConfigError
        With the key `law`; what is allowed names the load, the lag and the error.
    """
    for load in law.trial_loads_kg():
        error, setting = tip_error(law.setting, load, begin, step), law.setting
        if not error <= LOST_PART * setting.arm.length:
            lost = f"with {1e3 * load:g} g and a lag of {1e3 * setting.pressures.lag_s:g} ms the tip is"
            allowed = f"law: composite, faster regulators, or a smaller law_options.load_kg: {lost}"
            name = setting.config.law
            raise ConfigError("controller", "law", name, f"{allowed} {1e3 * error:.0f} mm off in a trial")


def tip_error(setting: Setting, load_kg: float, begin: ControllerState, step: Step) -> float:
    """Return the RMS distance of the tip from its reference [m] at the end of a trial, or infinity.

    Parameters
    ----------
    setting : Setting
        Of the law on trial.
    load_kg : float
        Load at the tip that the law does not know of [kg].
    begin, step : ControllerState, callable
        As in `refuse_lost_arm`.
    """
    robot, pressures, dt = setting.arm.robot, setting.pressures, 1.0 / DEFAULT_RATE_HZ
    # The robot of a controller is discretised already.
    arm = discretised(robot.replace(tip_mass=robot.tip_mass + load_kg), Discretisation())
    stepper, state = make_stepper("trapezoidal", arm), begin
    body = State(np.zeros(arm.n_q), np.zeros(arm.n_q), np.zeros(arm.n_internal))
    air = np.zeros(arm.n_u)
    under_way = deque([air] * round(pressures.dead_time_s / dt))
    ticks, judged = round((setting.config.reference.start_s + _AFTER_S) / dt), round(_JUDGED_S / dt)
    errors = []
    for k in range(ticks):
        state, command = step(state, body.q, body.qd, k * dt, dt, air)
        if not command.status.ok:
            return math.inf
        tip = arm.pose(body.q, arm.length)
        errors.append(float(np.linalg.norm(tip[:3, 3] - command.tip_reference[:3, 3])))
        under_way.append(command.setpoint_pa)
        before, air = air, follow_lag(air, under_way.popleft(), dt, pressures.lag_s)
        body, status = stepper.step(body, 0.5 * (before + air), dt)
        if not status.ok:
            return math.inf
    return float(np.sqrt(np.mean(np.square(errors[-judged:]))))
