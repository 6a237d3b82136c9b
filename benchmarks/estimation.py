"""The estimator: the time of one tick at 3, 6 and 12 coordinates, and its consistency."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks import consistency
from benchmarks.options import Options
from benchmarks.report import figure, met, table
from soro_core import load_robot
from soro_core.estimation import Estimator, PoseSample
from soro_core.robot import Discretisation

TITLE = "Estimation"
# Pieces of the link, and microseconds to reach with one pose and disturbance.
GOALS_US = {1: 30.0, 2: 50.0, 4: 200.0}
DT, TICKS, WARM = 0.005, 2000, 300


def run(options: Options) -> str:
    """Return the text of the section."""
    robot, rows, good = load_robot("tue_three_bellow"), [], []
    for pieces, goal in GOALS_US.items():
        options.say(f"{pieces} pieces")
        estimator = Estimator(robot, None, DT, Discretisation(links=pieces))
        tick, predict, fuse, forward = _measured(estimator)
        good.append(tick <= goal)
        n = estimator.arm.n_q
        rows.append([f"{n}", *(figure(x) for x in (tick, predict, fuse, forward)), f"{goal:g}"])
    head = ["coordinates", "tick, us", "prediction", "update", "forward dynamics", "goal, us"]
    text = "Median of one tick from Python, a pose in each, with disturbance and a learned force."
    ticks = f"{text}\n\n{table(head, rows)}\n\nGoals: {met(all(good))}"
    return f"{ticks}\n\n{consistency.run(options)}"


def _measured(estimator: Estimator) -> list[float]:
    """Return the medians of a tick, a prediction, an update and the forward dynamics [us]."""
    arm, filter_, n = estimator.arm, estimator.filter, estimator.arm.n_q
    pressure, rng = np.full(arm.n_u, 1e4), np.random.default_rng(1)
    learned, rest = filter_.nothing, arm.pose(np.zeros(n), arm.length)
    state = estimator.initial_state()
    times: list[list[float]] = [[], [], [], []]
    for k in range(1, TICKS + 1):
        position = rest[:3, 3] + 1e-4 * rng.standard_normal(3)
        pose = PoseSample(k * DT, position, np.array([0.0, 0.0, 0.0, 1.0]), arm.length)
        found, spent = _timed(estimator.step, state, pressure, [pose], [], DT, learned)
        state = found[0]
        belief, known = state.belief, state.known
        (ahead, _), predicting = _timed(filter_.predict, belief, pressure, DT, known)
        fusing = _timed(filter_.advance, ahead, pressure, 0.0, known, pose)[1]
        moving = _timed(arm.forward_dynamics, belief.q, belief.qd, pressure)[1]
        for row, one in zip(times, (spent, predicting, fusing, moving), strict=True):
            row.append(one)
    return [float(np.median(row[WARM:])) for row in times]


def _timed(call: Callable[..., Any], *arguments: object) -> tuple[Any, float]:
    """Return the result of a call and its time [us]."""
    start = time.perf_counter_ns()
    result = call(*arguments)
    return result, 1e-3 * (time.perf_counter_ns() - start)
