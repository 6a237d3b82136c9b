"""Execution of a first pressurisation: expectations, and the loop around the state machine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from soro_core.errors import ConfigError
from soro_core.robot import Robot
from soro_hardware.hil.bending import bending_of
from soro_hardware.hil.first_pressure import advance, interrupted
from soro_hardware.hil.judge import Expectation, judge_trip
from soro_hardware.hil.paced import CycleSample, PacedRegulator
from soro_hardware.hil.plan import FirstPressureConfig, HilPlan, Order, ProcedureState
from soro_hardware.platform import PlatformBase


def expectation(
    platform: PlatformBase, update_hz: float, config: FirstPressureConfig, robot: Robot | None = None
) -> Expectation:
    """Return the behaviour of a healthy platform and, with a robot, the bending of its arm.

    Parameters
    ----------
    platform : PlatformBase
    update_hz : float
        Rate of exchanges of a chamber [Hz].
    config : FirstPressureConfig
        Steps.
    robot : Robot, optional

    Raises
    ------
    ConfigError
        If a step is beyond the platform's range, or the chambers of robot and platform differ.
    """
    if config.steps_pa[-1] > platform.range.maximum_pa:
        top = f"set points up to the platform's {platform.range.maximum_pa:g} Pa"
        raise ConfigError("first pressurisation", "steps_pa", config.steps_pa[-1], top)
    names, response = platform.chamber_names, platform.regulator
    bending = None if robot is None else bending_of(robot, names, config.steps_pa)
    return Expectation(names, config.steps_pa, response, config.rise_pa_s, 1.0 / update_hz, bending)


def pressurise(
    plan: HilPlan,
    regulator: PacedRegulator,
    record: Callable[[CycleSample], None] = lambda sample: None,
    ask: Callable[[str], None] = lambda question: None,
    answers: Callable[[], str | None] = lambda: None,
    stopped: Callable[[], bool] = lambda: False,
) -> ProcedureState:
    """Execute a plan.

    The exchanges continue during a question: devices vent if their host is silent.

    Parameters
    ----------
    plan : HilPlan
        Steps and expectations.
    regulator : PacedRegulator
        Regulator behind the limiter.
    record : callable
        Called with every sample.
    ask : callable
        Called with a question to the operator.
    answers : callable
        Returns the operator's answer, or None; called only while a question is open.
    stopped : callable
        Returns whether to vent and end.

    Returns
    -------
    ProcedureState
        State at the end.
    """
    state, order = ProcedureState(), Order(np.zeros(len(plan.expected.names)))
    while state.phase != "done":
        if stopped():
            regulator.vent("interrupted")
            return interrupted(plan, state)
        sample = regulator.cycle(order.setpoint_pa)
        record(sample)
        state, order = advance(plan, state, sample, answers() if state.asks else None)
        if order.do == "vent":
            regulator.vent(f"vent of {plan.expected.names[state.chamber]}")
        elif order.do == "reset":
            refusal = regulator.reset()
            if refusal is not None:
                state = interrupted(plan, state, f"the limiter stays vented: {refusal}")
        if order.question:
            ask(order.question)
    # With all set points at 0: this takes longer than a cycle.
    if (bending := plan.expected.bending) is not None and not plan.directions:
        state = replace(state, findings=(*state.findings, *bending.findings(state.holds)))
    if regulator.lost is None or state.tripped:
        return state
    # During a commanded vent no trip reports lost devices.
    return replace(state, findings=(*state.findings, judge_trip("devices", regulator.lost)))
