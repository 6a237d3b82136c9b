"""The loop of a scene in lockstep, without ROS: one model in estimator and controller, another in twin."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.config import find_config
from soro_core.control import Controller
from soro_core.errors import ModelError
from soro_core.estimation import Estimator
from soro_core.hardware import load_platform
from soro_core.loop import Loop
from soro_core.robot import Discretisation, load_robot
from soro_core.scene import Scene
from soro_core.twin import Twin, TwinConfig

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class LoopRecord:
    """What a run of the loop left.

    Attributes
    ----------
    t : (n_t,)
        Time [s].
    pressure_pa : (n_t, n_u)
        True chamber pressures [Pa].
    distance_m : (n_t,)
        From the true tip to that of the reference [m]; not a number while the controller gave none.
    loop_us : (n_t,)
        CPU time of estimator and controller [us].
    """

    t: Array
    pressure_pa: Array
    distance_m: Array
    loop_us: Array

    def tracking_error_m(self, last_s: float) -> float:
        """RMS distance of the tip from its reference over the last part of the run [m]."""
        late = self.distance_m[self.t > self.t[-1] - last_s]
        return float(np.sqrt(np.mean(late**2)))


def drive(scene: Scene, model: Discretisation, seconds: float, plant: TwinConfig | None = None) -> LoopRecord:
    """Run the loop of `scene` in lockstep.

    Chambers are filled by regulators as the scene's platform has them, without its bus.

    Parameters
    ----------
    scene : Scene
        Controller, estimator, sensors, rate and seed.
    model : Discretisation
        Of estimator and controller.
    seconds : float
    plant : TwinConfig, optional
        Of the twin; default the scene's.

    Raises
    ------
    ConfigError, ModelError
        If a part refuses the model, or the twin fails.
    """
    robot = load_robot(find_config(scene.robot, "robots"))
    config = scene.twin_node() if plant is None else plant
    changes: dict[str, object] = {"pressures": "regulators", "plant_link": ""}
    if scene.platform:
        changes["regulator"] = load_platform(scene.platform).emulation.regulator
    twin = Twin(robot, config.model_copy(update=changes))
    dt = 1.0 / scene.rate_hz
    loop = Loop(Estimator(robot, scene.estimator, dt, model), Controller(robot, scene.controller, model))
    state, inner = twin.initial(), loop.initial_state()
    n = round(seconds * scene.rate_hz)
    t: Array = np.arange(n, dtype=np.float64) * dt
    pressure = np.empty((n, robot.n_u))
    distance, spent = np.full(n, np.nan), np.zeros(n)
    setpoint = np.zeros(robot.n_u)
    for k in range(n):
        state, seen = twin.observe(state)
        pressure[k] = state.air.pressure_pa
        begun = time.thread_time_ns()
        inner, _, command = loop.step(inner, seen.reading_pa, seen.poses, seen.imus, dt)
        spent[k] = 1e-3 * (time.thread_time_ns() - begun)
        # The command that answers this tick acts from the next one on.
        state = twin.step_setpoints(state, setpoint)
        if not state.status.ok:
            raise ModelError(f"the twin stopped at {t[k]:.3f} s: {state.status}")
        if command.status.ok:
            setpoint = command.setpoint_pa
            distance[k] = np.linalg.norm(seen.tip[:3, 3] - command.tip_reference[:3, 3])
    return LoopRecord(t, pressure, distance, spent)
