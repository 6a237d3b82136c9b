"""Runs of the table of extremes on the loop as a whole: twin, regulators, estimator and controller."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.extremes.cell import Outcome, Verdict
from soro_core import load_robot
from soro_core.config import find_config
from soro_core.control import Controller, ControllerConfig
from soro_core.estimation import Estimator, EstimatorConfig
from soro_core.loop import Loop
from soro_core.pneumatics import RegulatorModel
from soro_core.twin import Observation, SensorConfig, Twin, TwinConfig

Array: TypeAlias = NDArray[np.float64]

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
        twin, control = Twin(robot, config), ControllerConfig()
        loop = Loop(Estimator(robot, EstimatorConfig(), twin.dt), Controller(robot, control))
        state, memory = twin.initial(), loop.initial_state()
        rng = np.random.default_rng(1)
        setpoint = np.zeros(robot.n_u)
        errors = []
        for _ in range(round(self.duration_s * self.rate_hz)):
            state = twin.step_setpoints(state, setpoint)
            if not state.status.ok:
                return Verdict(Outcome.NONSENSE, f"the arm: {state.status}")
            state, seen = twin.observe(state)
            if rng.random() < self.no_number:
                seen = _spoilt(seen)
            memory, estimate, command = loop.step(memory, seen.reading_pa, seen.poses, seen.imus, twin.dt)
            setpoint = command.setpoint_pa
            if not (np.isfinite(setpoint).all() and np.isfinite(estimate.q).all()):
                return Verdict(Outcome.NONSENSE, f"estimate {estimate.q}, command {setpoint}")
            low, high = control.pressures.minimum_pa, control.pressures.maximum_pa
            if setpoint.min() < low or setpoint.max() > high:
                return Verdict(Outcome.NONSENSE, f"command {setpoint} Pa")
            errors.append(np.linalg.norm(seen.tip[:3, 3] - command.tip_reference[:3, 3]))
        late = np.array(errors[-round(LATE_S * self.rate_hz) :])
        rms = float(np.sqrt(np.mean(late**2))) / robot.length
        good = rms <= TRACKS if self.tracks else float(late.max()) <= robot.length
        return Verdict(Outcome.FINISHED if good else Outcome.NONSENSE, f"tip RMS {100 * rms:.1f} % of length")


def _spoilt(seen: Observation) -> Observation:
    poses = tuple(replace(one, position=np.full(3, np.nan)) for one in seen.poses)
    return replace(seen, reading_pa=np.full_like(seen.reading_pa, np.nan), poses=poses)
