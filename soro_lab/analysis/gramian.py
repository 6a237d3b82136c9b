"""Observability Gramians along a motion, from exact derivatives of the steps, docs/analysis.md (10)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.integrate.state import State
from soro_core.integrate.stepper import Stepper, make_stepper
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import stable_equilibrium
from soro_lab.analysis.sensors import SensorCandidate

# Longest step of the integration [s], and the largest number of windows.
LONGEST_S, MOST_WINDOWS = 2.5e-3, 40


@dataclass(frozen=True)
class Window:
    """A part of a motion.

    Attributes
    ----------
    states : tuple of State
        At each tick, both ends included.
    transitions : ndarray (n_ticks + 1, 2 n_q, 3 n_q)
        Derivatives of (q, qd) at each tick by those at the first one, and by an unmodelled
        acceleration, the same at each tick: what an unknown load does.
    """

    states: tuple[State, ...]
    transitions: Array


def windows(
    arm: SoftArm,
    runs: Sequence[Array],
    dt: float,
    ticks: int,
    show: Callable[[int, int], None] = lambda done, of: None,
) -> list[Window]:
    """Cut motions into windows, and linearise each.

    Parameters
    ----------
    arm : SoftArm
        Model; one without derivatives is refused.
    runs : sequence of ndarray (n_ticks, n_u)
        Gauge pressures [Pa] of each motion, one row a tick; it begins at rest.
    dt : float
        Time of a tick [s].
    ticks : int
    show : callable
        Takes the number of windows that are done, and that of all.

    Raises
    ------
    ModelError
        If the arm has no derivatives or no rest, a step fails, or no motion is as long as a window.
    """
    stepper, steps = make_stepper("trapezoidal", arm, guarded=False), int(np.ceil(dt / LONGEST_S - 1e-9))
    begins: list[tuple[State, Array]] = []
    for pressures in runs:
        states = _run(stepper, pressures, dt, steps)
        begins += [(states[k], pressures[k : k + ticks]) for k in range(0, len(pressures) - ticks + 1, ticks)]
    if not begins:
        raise ModelError(
            f"motions shorter than a window of {ticks * dt:g} s: allowed are longer ones", "window"
        )
    chosen = np.unique(np.linspace(0, len(begins) - 1, min(MOST_WINDOWS, len(begins))).round().astype(int))
    found = []
    for k, number in enumerate(chosen):
        show(k, len(chosen))
        begin, pressures = begins[number]
        found.append(_linearised(stepper, begin, pressures, dt, steps))
    return found


def _run(stepper: Stepper, pressures: Array, dt: float, steps: int) -> list[State]:
    """States before each tick of a motion."""
    arm = stepper.arm
    state, states = stepper.initial_state(stable_equilibrium(arm, pressures[0])), []
    for pressure in pressures:
        states.append(state)
        for _ in range(steps):
            state, status = stepper.step(state, pressure, dt / steps)
            if not status.ok:
                raise ModelError(f"the motion of {arm.robot.name}: {status}")
    return states


def _linearised(stepper: Stepper, state: State, pressures: Array, dt: float, steps: int) -> Window:
    n, h = stepper.arm.n_q, dt / steps
    by_start = np.eye(2 * n + stepper.arm.n_internal, 3 * n)
    by_start[2 * n :] = 0.0  # internal states are known
    unknown = np.eye(len(by_start), n, -n)  # an acceleration adds to the rates
    states, transitions = [state], [by_start[: 2 * n]]
    for pressure in pressures:
        for _ in range(steps):
            step = stepper.derivatives(state, pressure, h)
            state, by_start = step.state, np.hstack([step.by_q, step.by_qd, step.by_internal]) @ by_start
            by_start[:, 2 * n :] += 0.5 * h * (step.by_qd + unknown)
        states.append(state)
        transitions.append(by_start[: 2 * n])
    return Window(tuple(states), np.array(transitions))


def gramian(arm: SoftArm, window: Window, sensor: SensorCandidate, dt: float) -> Array:
    """Information (3 n_q, 3 n_q) of one sensor on a window, docs/analysis.md (10).

    The state is (q, qd) at its start and the unknown acceleration.

    Parameters
    ----------
    arm : SoftArm
    window : Window
    sensor : SensorCandidate
    dt : float
        Time of a tick [s].
    """
    total = np.zeros((3 * arm.n_q, 3 * arm.n_q))
    every = max(1, round(1.0 / (sensor.kind.rate_hz * dt)))
    for state, transition in zip(window.states[::every], window.transitions[::every], strict=True):
        rows = sensor.kind.rows(arm, state.q, sensor.s) @ transition / sensor.kind.std[:, None]
        total += rows.T @ rows
    return total
