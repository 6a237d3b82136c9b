"""The loop of a scene in lockstep, without ROS: one model in estimator and controller, another in twin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.robot import Discretisation
from soro_core.twin import Twin, TwinConfig
from soro_lab.scene import Scene
from soro_lab.scene.loop import loop_of


@dataclass(frozen=True)
class LoopRecord:
    """Record of a run of the loop.

    Attributes
    ----------
    t : (n_t,)
        Time [s].
    pressure_pa : (n_t, n_u)
        True chamber pressures [Pa gauge].
    distance_m : (n_t,)
        Distance of the true tip from that of the reference [m]; nan without a command.
    loop_us : (n_t,)
        CPU time of estimator and controller [us].
    """

    t: Array
    pressure_pa: Array
    distance_m: Array
    loop_us: Array

    def tracking_error_m(self, last_s: float) -> float:
        """Return the RMS distance of the tip from its reference [m] over the last `last_s` [s] of the run."""
        late = self.distance_m[self.t > self.t[-1] - last_s]
        return float(np.sqrt(np.mean(late**2)))


def drive(scene: Scene, model: Discretisation, seconds: float, plant: TwinConfig | None = None) -> LoopRecord:
    """Run the loop of `scene` in lockstep.

    Regulators of the scene's platform fill the chambers, without its bus.

    Parameters
    ----------
    scene : Scene
        Controller, estimator, sensors, rate and seed.
    model : Discretisation
        Discretisation in estimator and controller.
    seconds : float
        Duration [s].
    plant : TwinConfig, optional
        Configuration of the twin; that of the scene by default.

    Raises
    ------
    ConfigError, ModelError
        If the configuration is not allowed, or the twin fails.
    """
    changes: dict[str, object] = {"pressures": "regulators", "plant_link": ""}
    if scene.loaded_platform:
        changes["regulator"] = scene.loaded_platform.regulator
    twin = Twin(scene.loaded_robot, with_changes(plant or scene.twin_node(), **changes))
    n = round(seconds * scene.rate_hz)
    t, spent, distance = np.zeros(n), np.zeros(n), np.full(n, np.nan)
    pressure = np.empty((n, twin.plant.arm.n_u))
    for k, tick in enumerate(loop_of(scene, model).run(twin, n, twin.dt, before_s=-twin.dt)):
        t[k], pressure[k], spent[k] = tick.t_s, tick.plant.air.pressure_pa, tick.cpu_us
        if tick.command.status.ok:
            distance[k] = np.linalg.norm(tick.seen.tip[:3, 3] - tick.command.tip_reference[:3, 3])
    return LoopRecord(t, pressure, distance, spent)
