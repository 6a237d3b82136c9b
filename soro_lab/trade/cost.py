"""Cost of a candidate: CPU time of whole runs and of single ticks, with compiled kernels."""

from __future__ import annotations

import math
import statistics
import time
from dataclasses import dataclass

import numpy as np

from soro_core.integrate import make_stepper, simulate
from soro_core.model.discretised import discretised
from soro_lab.trade.candidate import Candidate
from soro_lab.trade.case import TradeCase

# The minimum of several equal ticks is free of interruptions.
_TICK_REPEATS = 3
_TICK_SECONDS = 1.0
_LONG_RUN_S = 2.0


@dataclass(frozen=True)
class Cost:
    """CPU times of one core.

    Attributes
    ----------
    cpu_s_per_s : float
        CPU time of a simulated second in the compiled loop, with the step of the case: median of the repeats.
    spread : float
        Ratio of the slowest to the fastest repeat.
    worst_tick_us, typical_tick_us : float
        Longest and median computation of a tick, called from Python step by step [us]; of a step if that is
        longer than a tick.
    startup_s : float
        CPU time from the robot to the end of the first step, with compiled and loaded kernels [s].
    repeats : int
        Number of repeats.
    """

    cpu_s_per_s: float
    spread: float
    worst_tick_us: float
    typical_tick_us: float
    startup_s: float
    repeats: int


def measure(case: TradeCase, candidate: Candidate, repeats: int = 3) -> Cost:
    """Measure the CPU times of a candidate in this process, which should be otherwise idle.

    Parameters
    ----------
    case : TradeCase
        Run.
    candidate : Candidate
        Discretisation, stepper and step.
    repeats : int
        Largest number of runs; long runs are not repeated.

    Raises
    ------
    ModelError
        If the run fails.
    """
    warm(case, candidate)
    start_s = time.process_time()
    arm = discretised(case.robot, candidate.model)
    stepper = make_stepper(candidate.integrator, arm)
    stepper.step(stepper.initial_state(), np.zeros(arm.n_u), candidate.dt_s)
    startup = time.process_time() - start_s
    dt_s = case.step_s(candidate.dt_s)
    start = case.initial(arm)
    times = dt_s * np.arange(max(1, round(case.t_end / dt_s)) + 1, dtype=np.float64)
    table = case.pressures(times)
    seconds: list[float] = []
    for _ in range(repeats):
        start_s = time.process_time()
        simulate(
            arm,
            start,
            t_end=times[-1],
            dt=dt_s,
            integrator=candidate.integrator,
            pressure=table,
        )
        seconds.append(time.process_time() - start_s)
        if seconds[-1] > _LONG_RUN_S:
            break
    worst, typical = _ticks(case, candidate, start)
    return Cost(
        cpu_s_per_s=statistics.median(seconds) / times[-1],
        spread=max(seconds) / max(min(seconds), 1e-9),
        worst_tick_us=worst,
        typical_tick_us=typical,
        startup_s=startup,
        repeats=len(seconds),
    )


def warm(case: TradeCase, candidate: Candidate) -> None:
    """Compile the kernels of a candidate, or load them from the cache."""
    arm = discretised(case.robot, candidate.model)
    stepper = make_stepper(candidate.integrator, arm)
    stepper.step(stepper.initial_state(), np.zeros(arm.n_u), 1e-6)


def _ticks(case: TradeCase, candidate: Candidate, start: np.ndarray) -> tuple[float, float]:
    """Return the longest and the median CPU time of a tick [us] in the first second."""
    arm = discretised(case.robot, candidate.model)
    stepper = make_stepper(candidate.integrator, arm)
    steps = max(1, math.ceil(case.tick_s / candidate.dt_s - 1e-9))
    h = case.tick_s / steps if case.paced or steps > 1 else candidate.dt_s
    ticks = max(1, int(min(_TICK_SECONDS, case.t_end) / (steps * h)))
    times = np.arange(ticks * steps + 1, dtype=np.float64) * h
    middle = case.pressures(times)[:, 1]
    spent = np.full((_TICK_REPEATS, ticks), np.inf)
    for repeat in range(_TICK_REPEATS):
        state = stepper.initial_state(start)
        for tick in range(ticks):
            start_ns = time.thread_time_ns()
            for k in range(tick * steps, (tick + 1) * steps):
                state, _ = stepper.step(state, middle[k], h)
            spent[repeat, tick] = 1e-3 * (time.thread_time_ns() - start_ns)
    least = spent.min(axis=0)
    return float(least.max()), float(np.median(least))
