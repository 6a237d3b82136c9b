"""Runs of the table of extremes on the loop as a whole: twin, regulators, estimator and controller."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from soro_core import load_robot
from soro_core.arrays import Array
from soro_core.config import find_config
from soro_core.control import Controller
from soro_core.errors import ModelError
from soro_core.estimation import Estimator, EstimatorConfig
from soro_core.loop import Loop
from soro_core.pneumatics import RegulatorModel
from soro_core.robot import Robot
from soro_core.twin import Observation, SensorConfig, Twin, TwinConfig, TwinState
from tests.apparatus.extremes.cell import Outcome, Verdict

# Tip RMS that counts as tracking, of the length; the law itself is judged elsewhere.
TRACKS = 0.05
PAYLOAD_KG = 0.02
# The end of a run that is judged: before, the vented arm gets up and learns its load.
LATE_S = 2.0


@dataclass(frozen=True)
class ClosedLoop:
    """The circle of the three-bellow robot with 20 g that the controller does not know of."""

    rate_hz: float = 200.0
    lag_s: float = 0.052
    drop: float = 0.0
    outlier: float = 0.0
    no_number: float = 0.0
    """Part of the ticks at which pressures and poses are not numbers."""
    duration_s: float = 10.0
    tracks: bool = True
    """Whether it has to track; else it only has to stay finite and bounded."""

    def __call__(self) -> Verdict:
        """Run and judge."""
        robot = load_robot(find_config("tue_three_bellow", "robots"))
        pose = SensorConfig(rate_hz=min(self.rate_hz, 100.0), drop=self.drop, outlier=self.outlier)
        config = TwinConfig(
            rate_hz=self.rate_hz,
            refine=2,
            payload_kg=PAYLOAD_KG,
            pose=pose,
            regulator=RegulatorModel(tau_s=self.lag_s),
        )
        twin = _Spoiling(robot, config, self.no_number)
        loop = Loop(Estimator(robot, EstimatorConfig(), twin.dt), Controller(robot))
        low, high = loop.controller.pressures.minimum_pa, loop.controller.pressures.maximum_pa
        errors = []
        try:
            for tick in loop.run(
                twin, round(self.duration_s * self.rate_hz), twin.dt, delay=0, before_s=-twin.dt
            ):
                setpoint = tick.command.setpoint_pa
                if not (np.isfinite(setpoint).all() and np.isfinite(tick.estimate.q).all()):
                    return Verdict(Outcome.NONSENSE, f"estimate {tick.estimate.q}, command {setpoint}")
                if setpoint.min() < low or setpoint.max() > high:
                    return Verdict(Outcome.NONSENSE, f"command {setpoint} Pa")
                errors.append(np.linalg.norm(tick.seen.tip[:3, 3] - tick.command.tip_reference[:3, 3]))
        except ModelError as error:
            return Verdict(Outcome.NONSENSE, str(error))
        late = np.array(errors[-round(LATE_S * self.rate_hz) :])
        rms = float(np.sqrt(np.mean(late**2))) / robot.length
        good = rms <= TRACKS if self.tracks else float(late.max()) <= robot.length
        return Verdict(Outcome.FINISHED if good else Outcome.NONSENSE, f"tip RMS {100 * rms:.1f} % of length")


class _Spoiling(Twin):
    """A twin that begins one tick after its rest, and whose sensors at times give no numbers."""

    def __init__(self, robot: Robot, config: TwinConfig, no_number: float) -> None:
        super().__init__(robot, config)
        self._no_number, self._spoiling_rng = no_number, np.random.default_rng(1)

    def initial(self, pressure_pa: Array | None = None) -> TwinState:
        return self.step_setpoints(super().initial(pressure_pa), np.zeros(self.plant.arm.n_u))

    def observe(self, state: TwinState) -> tuple[TwinState, Observation]:
        state, seen = super().observe(state)
        if self._spoiling_rng.random() < self._no_number:
            poses = tuple(replace(one, position=np.full(3, np.nan)) for one in seen.poses)
            seen = replace(seen, reading_pa=np.full_like(seen.reading_pa, np.nan), poses=poses)
        return state, seen
