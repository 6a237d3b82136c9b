"""How far the model of a scene is from the recorded arm, and the stiffness with which it would be nearest."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import SoroError
from soro_core.integrate import simulate
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Robot
from soro_lab.scene import Scene
from soro_ros.recordings.recording import RunRecording, TopicSeries
from soro_ros.recordings.report import tip_error

FILE = "model_error.json"
CHANGE = 0.02
"""Change of stiffness of the second simulation, whose tip tells how the tip depends on it."""
# Time in which the start at rest fades [s], at most this part of the run.
_FADES_S, _FADES_PART = 1.0, 0.25
# Parts of a run, by which its deviation is known: neighbouring samples are no independent ones.
PARTS = 5
_LEAST = 10 * PARTS


@dataclass(frozen=True)
class ModelMismatch:
    """The model of a scene against one run.

    Attributes
    ----------
    rms_m : float
        Root mean square distance [m] of the tips of model and arm under the measured pressures.
    stiffness : float
        Stiffness of the arm over that of the robot file: where the distance is least. Pressures tell
        stiffness from area only by the weight of the arm; it is here taken as stiffness.
    deviation : float
        Standard deviation of it, by `PARTS` parts of the run.
    """

    rms_m: float
    stiffness: float
    deviation: float


def model_error(recording: RunRecording, scene: Scene) -> ModelMismatch | None:
    """Return how far the model is from a run; None where the run is too short, or the model cannot follow.

    The model is that of estimator and controller, without what was learned. It is simulated from rest under
    the measured pressures; while the arm was under control, its tip is compared.
    """
    t, _ = tip_error(recording, scene.duration_s)
    reading = recording.reading
    if t.size < _LEAST or reading.t.size < 2 or not np.isfinite(reading.value).all():
        return None
    begin, end = float(max(t[0], reading.t[0])), float(min(t[-1], reading.t[-1]))
    fades = min(_FADES_S, _FADES_PART * (end - begin))
    t = t[(t >= begin + fades) & (t <= end)]
    if t.size < _LEAST:
        return None
    robot = scene.discretisation.discretise(scene.loaded_robot)
    try:
        model, softer = (
            _tips(robot.scaled(stiffness=scale), reading, (begin, end, 1.0 / scene.rate_hz), t)
            for scale in (1.0, 1.0 - CHANGE)
        )
    except SoroError:
        return None
    away, by_stiffness = recording.true_tip.at(t) - model, (model - softer) / CHANGE
    return mismatch_of(away, by_stiffness)


def mismatch_of(away: Array, by_stiffness: Array) -> ModelMismatch:
    """Return the mismatch of a model.

    Parameters
    ----------
    away : ndarray (n, 3)
        Tip of the arm from that of the model [m].
    by_stiffness : ndarray (n, 3)
        Derivative of the tip of the model by a factor on its stiffness [m].
    """
    parts = [
        _least(*pair) for pair in zip(*(np.array_split(x, PARTS) for x in (away, by_stiffness)), strict=True)
    ]
    return ModelMismatch(
        rms_m=float(np.sqrt(np.mean(np.sum(away**2, axis=1)))),
        stiffness=1.0 + _least(away, by_stiffness),
        deviation=float(np.std(parts, ddof=1) / np.sqrt(PARTS)),
    )


def keep_model_error(folder: Path, recording: RunRecording, scene: Scene) -> ModelMismatch | None:
    """Write it into the folder of a run, as {} where there is none, and return it.

    Parameters
    ----------
    folder : Path
    recording : RunRecording
    scene : Scene
    """
    found = model_error(recording, scene)
    (folder / FILE).write_text(json.dumps({} if found is None else asdict(found), indent=1), encoding="utf-8")
    return found


def _tips(robot: Robot, reading: TopicSeries, span: tuple[float, float, float], t: Array) -> Array:
    """Return tips (n, 3) [m] of a robot at times (n,) [s], from rest under measured pressures.

    Parameters
    ----------
    robot : Robot
    reading : TopicSeries
        Pressures [Pa].
    span : tuple of float
        Begin and end, and the time step [s].
    t : ndarray (n,)
    """
    begin, end, dt = span
    arm, steps = SoftArm(robot), max(1, round((end - begin) / dt))
    times = begin + dt * (np.arange(steps + 1)[:, None] + np.array([0.0, 0.5, 1.0]))
    pressure = reading.at(times.ravel()).reshape(steps + 1, 3, -1)
    done = simulate(arm, equilibrium(arm, pressure[0, 0]), t_end=steps * dt, dt=dt, pressure=pressure)
    if not done.status.ok:
        raise SoroError(str(done.status))
    return TopicSeries(begin + done.t, done.tip).at(t)


def _least(away: Array, by_stiffness: Array) -> float:
    """Return the relative change of stiffness that leaves the least of a distance."""
    return float(np.sum(away * by_stiffness) / max(float(np.sum(by_stiffness**2)), 1e-30))
