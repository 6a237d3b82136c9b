"""Measures that take longer, for models near the front only: the closed loop and a measured run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.errors import ConfigError, ModelError
from soro_core.identification import curvature_errors
from soro_core.integrate import simulate
from soro_core.model import SoftArm
from soro_core.model.discretised import discretised
from soro_core.model.statics import equilibrium
from soro_core.robot import Discretisation, shape_integrals, strain_rows
from soro_core.robot.discretisation import EXPLICIT
from soro_core.scene import Scene
from soro_core.trade.candidate import Candidate
from soro_core.trade.case import Case
from soro_core.trade.closed_loop import drive

# Of the reference time after its smooth start.
LOOP_LAST_S = 2.0
_PLANT_DT_S = 1e-3


@dataclass(frozen=True)
class LoopError:
    """The closed loop with one model in estimator and controller.

    Attributes
    ----------
    tracking_mm : float or None
        RMS distance of the true tip from its reference over the last seconds [mm].
    worst_us, typical_us : float
        Longest and median CPU time of estimator and controller at a tick [us].
    trouble : str
        Why there is none.
    """

    tracking_mm: float | None
    worst_us: float = 0.0
    typical_us: float = 0.0
    trouble: str = ""


def loop_seconds(scene: Scene) -> float:
    """Length of a closed-loop run: the smooth start of the reference, and a little more."""
    return scene.controller.reference.start_s + LOOP_LAST_S


def closed_loop(scene: Scene, model: Discretisation, truth: Candidate) -> LoopError:
    """Run the loop with `model` in estimator and controller, on a twin that runs the reference.

    The twin has what the scene says of payload, stiffness, sensors and regulators; its arm is discretised as
    the reference and steps with the reference's stepper, at no more than 1 ms; with air as states, which no
    explicit stepper takes, with the trapezoidal one.
    """
    twin = scene.twin_node()
    explicit = truth.integrator in EXPLICIT
    plant = twin.model_copy(
        update={
            "model": truth.model,
            "refine": 1,
            "integrator": "trapezoidal" if twin.air == "states" and explicit else truth.integrator,
            "step_s": max(truth.dt_s, _PLANT_DT_S),
        }
    )
    try:
        record = drive(scene, model, loop_seconds(scene), plant)
        error = record.tracking_error_m(LOOP_LAST_S)
    except (ConfigError, ModelError) as fault:
        return LoopError(None, trouble=str(fault))
    if not np.isfinite(error):
        return LoopError(None, trouble="the controller gave no command")
    ticks = record.loop_us[1:]
    return LoopError(1e3 * error, float(ticks.max()), float(np.median(ticks)))


def measured_error(case: Case, candidate: Candidate) -> float | None:
    """RMS difference [1/m] between the measured and the simulated curvature vector of the first link.

    The measured pressures act on the chambers; the model's mean curvature along the link is turned into the
    measured frame with the robot's `calibration`. None where the run fails, or there is none.
    """
    run = case.measured
    if run is None:
        return None
    try:
        arm = discretised(case.robot, candidate.model)
        begin = float(run.t[0])
        steps = int((run.t[-1] - begin) / candidate.dt_s)
        times = np.arange(steps + 1, dtype=np.float64) * candidate.dt_s
        clock = Case(case.robot, "", run.t - begin, run.pressure, float(times[-1]))
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
    """Rows (2, n_q) that give the mean kx and ky over the first link, which has so many pieces."""
    rows = np.zeros((2, arm.n_q))
    first = 0
    for link in arm.robot.links[:pieces]:
        names = strain_rows(link)
        # The mean of a shape function is its product with the first one, which is 1.
        integrals = shape_integrals(link)
        for row, name in enumerate(("bending_x", "bending_y")):
            if name not in names:
                continue
            begin = names.index(name)
            for k in range(names.count(name)):
                rows[row, first + begin + k] = integrals[begin, begin + k] / link.length / pieces
        first += link.n_q
    return rows
