"""Slow measures, for models near the front only: the closed loop and a measured run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.config import with_changes
from soro_core.errors import ConfigError, ModelError
from soro_core.integrate import simulate
from soro_core.model import SoftArm
from soro_core.model.discretised import discretised
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Discretisation, strain_rows
from soro_core.robot.basis import shape_means
from soro_core.robot.discretisation import EXPLICIT
from soro_lab.identification import curvature_errors
from soro_lab.scene import Scene
from soro_lab.trade.candidate import Candidate
from soro_lab.trade.case import TradeCase
from soro_lab.trade.closed_loop import drive

# Time of the closed loop after the smooth start of the reference [s].
LOOP_LAST_S = 2.0
_PLANT_DT_S = 1e-3


@dataclass(frozen=True)
class LoopError:
    """Result of the closed loop with one model in estimator and controller.

    Attributes
    ----------
    tracking_mm : float or None
        RMS distance of the true tip from its reference over the last seconds [mm].
    worst_us, typical_us : float
        Longest and median CPU time of estimator and controller at a tick [us].
    failure : str
        Why there is no result.
    """

    tracking_mm: float | None
    worst_us: float = 0.0
    typical_us: float = 0.0
    failure: str = ""


def loop_seconds(scene: Scene) -> float:
    """Return the duration of a closed-loop run [s]: the smooth start of the reference, and `LOOP_LAST_S`."""
    return scene.controller.reference.start_s + LOOP_LAST_S


def closed_loop(scene: Scene, model: Discretisation, truth: Candidate) -> LoopError:
    """Run the loop with a model in estimator and controller, on a twin with the reference model.

    Payload, stiffness, sensors and regulators of the twin are those of the scene. Its arm has the
    discretisation and the stepper of the reference, with a step of at least 1 ms; air as states requires an
    implicit stepper, so the trapezoidal one replaces an explicit one.

    Parameters
    ----------
    scene : Scene
        Controller, estimator, sensors, rate and seed.
    model : Discretisation
        Model in estimator and controller.
    truth : Candidate
        Reference model.
    """
    twin = scene.twin_node()
    explicit = truth.integrator in EXPLICIT
    plant = with_changes(
        twin,
        model=truth.model,
        refine=1,
        integrator="trapezoidal" if twin.air == "states" and explicit else truth.integrator,
        step_s=max(truth.dt_s, _PLANT_DT_S),
    )
    try:
        record = drive(scene, model, loop_seconds(scene), plant)
        error = record.tracking_error_m(LOOP_LAST_S)
    except (ConfigError, ModelError) as fault:
        return LoopError(None, failure=str(fault))
    if not np.isfinite(error):
        return LoopError(None, failure="the controller gave no command")
    ticks = record.loop_us[1:]
    return LoopError(1e3 * error, float(ticks.max()), float(np.median(ticks)))


def measured_error(case: TradeCase, candidate: Candidate) -> float | None:
    """Return the RMS difference [1/m] of measured and simulated curvature of the first link.

    The measured pressures act on the chambers; the robot's `calibration` turns the mean curvature of the
    model along the link into the measured frame. None if the run fails, or there is none.
    """
    run = case.measured
    if run is None:
        return None
    try:
        arm = discretised(case.robot, candidate.model)
        begin = float(run.t[0])
        steps = int((run.t[-1] - begin) / candidate.dt_s)
        times = np.arange(steps + 1, dtype=np.float64) * candidate.dt_s
        clock = TradeCase(case.robot, "", run.t - begin, run.pressure, float(times[-1]))
        result = simulate(
            arm,
            equilibrium(arm, run.pressure[0]),
            t_end=float(times[-1]),
            dt=candidate.dt_s,
            integrator=candidate.integrator,
            pressure=clock.pressures(times),
        )
    except ModelError:
        return None
    if not result.status.ok:
        return None
    shown = result.q @ mean_curvature(arm, len(arm.robot.links) // len(case.robot.links)).T
    frame = case.robot.calibration
    measured = run.curvature_at(begin + result.t)
    return curvature_errors(measured, shown, frame.frame_rotation_rad, frame.curvature_offset).vector


def mean_curvature(arm: SoftArm, pieces: int) -> np.ndarray:
    """Return the rows (2, n_q) whose products with q are the means of kx and ky over the first link."""
    rows = np.zeros((2, arm.n_q))
    first = 0
    for link in arm.robot.links[:pieces]:
        names, means = np.array(strain_rows(link)), shape_means(link) / pieces
        for row, name in enumerate(("bending_x", "bending_y")):
            rows[row, first : first + link.n_q] = np.where(names == name, means, 0.0)
        first += link.n_q
    return rows
