"""Traces of runs to compare: places along the backbone and energy over time, and the first frequency."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.integrate import simulate
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_lab.trade.case import SAMPLE_S, TradeCase

# Candidates above this CPU time of a simulated second [s] are left out, judged by the first `PILOT_S` [s].
SLOWEST = 5.0
PILOT_S = 0.1

STATIONS = (0.2, 0.4, 0.6, 0.8, 1.0)  # relative to the arm's length


@dataclass(frozen=True)
class TradeTrace:
    """A run at evenly spaced times from 0.

    Attributes
    ----------
    places : (n_t, n_stations, 3)
        Positions along the backbone [m]; the last is the tip.
    energy : (n_t,)
        Sum of kinetic, gravitational and elastic energy, and that of contact and a held tip [J].
    frequency_hz : float
        First frequency of small undamped vibrations about rest under the first pressures; 0 if that is
        unstable.
    """

    places: Array
    energy: Array
    frequency_hz: float


@dataclass(frozen=True)
class Errors:
    """Differences of two runs.

    Attributes
    ----------
    tip, shape : float
        RMS distance over time of the tip, and of places along the backbone, % of the arm's length.
    energy : float
        RMS difference, % of the range of the energy over the run.
    frequency : float or None
        Difference of the first natural frequencies, %; None if a run has none.
    """

    tip: float
    shape: float
    energy: float
    frequency: float | None


def trace(case: TradeCase, arm: SoftArm, integrator: str, dt_s: float) -> TradeTrace:
    """Simulate a case and sample it.

    Parameters
    ----------
    case : TradeCase
        Start and pressures.
    arm : SoftArm
        Model.
    integrator : str
        Time stepper.
    dt_s : float
        Time step [s], a whole fraction of `SAMPLE_S`.

    Raises
    ------
    ModelError
        If there is no equilibrium to start from, or the run fails.
    """
    every = round(SAMPLE_S / dt_s)
    if every < 1 or abs(every * dt_s - SAMPLE_S) > 1e-9:
        raise ModelError(f"dt_s = {dt_s:g}: allowed is a whole part of {SAMPLE_S:g} s", "dt_s")
    start = case.initial(arm)
    times = time_grid(case, dt_s)
    result = simulate(
        arm, start, t_end=times[-1], dt=dt_s, integrator=integrator, pressure=case.pressures(times)
    )
    if not result.status.ok:
        raise ModelError(result.status.message)
    q, qd = result.q[::every], result.qd[::every]
    places = np.array([[arm.pose(row, part * arm.length)[:3, 3] for part in STATIONS] for row in q])
    energy = np.array([total_energy(arm, row, rate) for row, rate in zip(q, qd, strict=True)])
    if case.start is None:
        return TradeTrace(places, energy, first_frequency_hz(arm, start, case.pressure_pa[0]))
    return TradeTrace(places, energy, first_frequency_hz(arm, rest(arm)))


def too_slow(case: TradeCase, arm: SoftArm, integrator: str, dt_s: float) -> str:
    """Return why a candidate is too slow, judged by the first part of the run; "" if it is not.

    An error-controlled stepper on a stiff arm takes thousands of internal steps for each step.
    The function has parameters as in `trace`.
    """
    times = time_grid(case, dt_s)
    times = times[: max(2, min(times.size, 1 + round(PILOT_S / dt_s)))]
    start_s = time.process_time()
    with contextlib.suppress(ModelError):  # the whole run reports the error
        simulate(
            arm,
            case.initial(arm),
            t_end=times[-1],
            dt=dt_s,
            integrator=integrator,
            pressure=case.pressures(times),
        )
    spent = (time.process_time() - start_s) / times[-1]
    return f"too slow: takes more than {SLOWEST:g} s a simulated second" if spent > SLOWEST else ""


def time_grid(case: TradeCase, dt_s: float) -> Array:
    """Return the times of the steps (n_t,) [s]; all candidates end at the same whole sample."""
    n = round(case.t_end / SAMPLE_S) * round(SAMPLE_S / dt_s)
    times: Array = np.arange(n + 1, dtype=np.float64) * dt_s
    times[-1] = SAMPLE_S * round(case.t_end / SAMPLE_S)
    return times


def errors(found: TradeTrace, truth: TradeTrace, length: float) -> Errors:
    """Return the errors of a run.

    Parameters
    ----------
    found, truth : TradeTrace
        The run and the reference.
    length : float
        Length of the arm [m].
    """
    distance = np.linalg.norm(found.places - truth.places, axis=2)
    span = float(np.ptp(truth.energy)) or 1.0
    frequency = None
    if found.frequency_hz and truth.frequency_hz:
        frequency = 100.0 * abs(found.frequency_hz / truth.frequency_hz - 1.0)
    return Errors(
        tip=100.0 * _rms(distance[:, -1]) / length,
        shape=100.0 * _rms(distance) / length,
        energy=100.0 * _rms(found.energy - truth.energy) / span,
        frequency=frequency,
    )


def rest(arm: SoftArm) -> Array:
    """Return the coordinates (n_q,) at rest without pressure; 0 if the search for rest fails."""
    try:
        return equilibrium(arm, np.zeros(arm.n_u))
    except ModelError:
        return np.zeros(arm.n_q)


def total_energy(arm: SoftArm, q: Array, qd: Array) -> float:
    """Return the sum of kinetic, gravitational and elastic energy, and that of contact and the held tip.

    Parameters
    ----------
    arm : SoftArm
        Model.
    q, qd : ndarray (n_q,)
        Coordinates and rates.

    Returns
    -------
    float
        Energy [J].
    """
    energy = sum(arm.energy(q, qd))
    return energy + arm.external_forces(q, qd).energy if _has_outside_energy(arm) else energy


def first_frequency_hz(arm: SoftArm, q: Array, pressure_pa: Array | None = None) -> float:
    """Return the first natural frequency about a rest, undamped and with relaxed creep.

    Contacts that are open at rest have no effect.

    Parameters
    ----------
    arm : SoftArm
        Model.
    q : ndarray (n_q,)
        Coordinates at rest.
    pressure_pa : ndarray (n_u,), optional
        Pressures [Pa gauge]; 0 by default.

    Returns
    -------
    float
        Frequency [Hz], 0 if the rest is not stable.
    """
    p = np.zeros(arm.n_u) if pressure_pa is None else pressure_pa

    def load(at: Array) -> Array:
        force = arm.gravity_force(at) - arm.pressure_force(at, p)
        return force - arm.external_forces(at).generalised if _has_outside_energy(arm) else force

    # Central differences: a step of 1e-5 leaves a relative error of 1e-10.
    step = 1e-5
    rows = np.array([(load(q + e) - load(q - e)) / (2 * step) for e in step * np.eye(arm.n_q)])
    stiffness = arm.stiffness_matrix(q) + 0.5 * (rows + rows.T)
    slowest = float(eigh(stiffness, arm.inertia_matrix(q), eigvals_only=True, subset_by_index=(0, 0))[0])
    return float(np.sqrt(slowest) / (2 * np.pi)) if slowest > 0.0 else 0.0


def _has_outside_energy(arm: SoftArm) -> bool:
    """Whether contact or a held tip can store energy."""
    return arm.robot.contacts is not None or arm.robot.tip_constraint is not None


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
