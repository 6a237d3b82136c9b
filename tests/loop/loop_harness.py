"""The closed loop in lockstep: a finer plant, regulators, a noisy late pose, and the loop at 200 Hz."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from soro_core import SoftArm
from soro_core.control import Controller, ControllerConfig
from soro_core.estimation import Estimator, EstimatorConfig, PoseSample
from soro_core.integrate import State, make_stepper
from soro_core.loop import Loop
from soro_core.pneumatics import RegulatorModel, initial_state, reading, step


@dataclass(frozen=True)
class Setup:
    plant: object = None  # the robot that is true, where it is not the one of the loop
    payload_kg: float = 0.02
    refine: int = 4
    seed: int = 1
    duration_s: float = 20.0
    dt: float = 0.005
    substeps: int = 2
    pose_every: int = 2
    pose_delay: int = 1  # ticks
    command_delay: int = 0  # ticks beyond the pipeline's own
    position_noise_m: float = 3e-4
    rotation_noise_rad: float = np.deg2rad(0.3)
    drop: float = 0.0
    outlier: float = 0.0
    stiffness: float = 1.0
    gain: float = 1.0
    damping: float = 1.0
    regulator: RegulatorModel = field(default_factory=RegulatorModel)
    control: ControllerConfig = field(default_factory=ControllerConfig)
    estimation: EstimatorConfig = field(default_factory=EstimatorConfig)


@dataclass
class Record:
    t: np.ndarray
    tip: np.ndarray
    reference: np.ndarray
    estimated: np.ndarray
    pressure: np.ndarray
    command: np.ndarray
    q: np.ndarray
    q_d: np.ndarray
    qd: np.ndarray
    estimates: np.ndarray
    names: tuple
    saturated: np.ndarray
    counts: object = None
    notes: dict = field(default_factory=dict)

    def error(self):
        return np.linalg.norm(self.tip - self.reference, axis=1)

    def estimation_error(self):
        return np.linalg.norm(self.tip - self.estimated, axis=1)

    def rms(self, last_s=5.0):
        late = self.t > self.t[-1] - last_s
        return float(np.sqrt(np.mean(self.error()[late] ** 2)))

    def estimation_rms(self, after_s=1.0):
        late = self.t > after_s
        return float(np.sqrt(np.mean(self.estimation_error()[late] ** 2)))


def scaled(robot, stiffness=1.0, damping=1.0, gain=1.0):
    """A true robot that differs from the file."""
    if hasattr(robot, "scaled"):
        return robot.scaled(stiffness=stiffness, damping=damping, gain=gain)
    assert stiffness == damping == gain == 1.0
    return robot


def without_adaptation(config: ControllerConfig) -> ControllerConfig:
    return config.model_copy(update={"adapt": False})


def run(robot, setup: Setup) -> Record:
    rng = np.random.default_rng(setup.seed)
    true = scaled(setup.plant or robot, setup.stiffness, setup.damping, setup.gain).replace(
        tip_mass=robot.tip_mass + setup.payload_kg
    )
    plant = SoftArm(true.refine(setup.refine))
    stepper = make_stepper("trapezoidal", plant)
    length = robot.length
    dt = setup.dt
    loop = Loop(Estimator(robot, setup.estimation, dt), Controller(robot, setup.control))

    body = settle(plant, stepper)
    air = initial_state(setup.regulator, plant.n_u)
    loop_state = loop.initial_state(0.0)
    commands = [np.zeros(plant.n_u)] * (1 + setup.command_delay)
    on_the_way: list[tuple[int, PoseSample]] = []
    last = None
    rows = {
        key: []
        for key in (
            "t",
            "tip",
            "reference",
            "estimated",
            "pressure",
            "command",
            "q",
            "q_d",
            "qd",
            "estimates",
            "saturated",
        )
    }
    names: tuple = ()
    for k in range(1, round(setup.duration_s / dt) + 1):
        setpoint = commands[-1 - setup.command_delay]
        for _ in range(setup.substeps):
            h = dt / setup.substeps
            before = air.pressure_pa
            air = step(setup.regulator, air, setpoint, h)
            body, status = stepper.step(body, 0.5 * (before + air.pressure_pa), h)
            assert status.ok, status.message
        t = k * dt
        pose = plant.pose(body.q, length)
        if k % setup.pose_every == 0:
            far = 60.0 if rng.random() < setup.outlier else 1.0
            sample = PoseSample(
                stamp_s=t,
                position=pose[:3, 3] + far * setup.position_noise_m * rng.standard_normal(3),
                quaternion=(
                    Rotation.from_matrix(pose[:3, :3])
                    * Rotation.from_rotvec(far * setup.rotation_noise_rad * rng.standard_normal(3))
                ).as_quat(),
                s=length,
            )
            if last is not None and rng.random() < setup.drop:
                sample = last
            last = sample
            on_the_way.append((k + setup.pose_delay, sample))
        poses = [sample for due, sample in on_the_way if due <= k]
        on_the_way = [item for item in on_the_way if item[0] > k]
        measured = reading(setup.regulator, air, rng)
        loop_state, estimate, command = loop.step(loop_state, measured, poses, [], dt)
        commands = [*commands[-(setup.command_delay + 1) :], command.setpoint_pa]
        names = tuple(command.estimates)
        for key, value in {
            "t": t,
            "tip": pose[:3, 3],
            "reference": command.tip_reference[:3, 3],
            "estimated": estimate.tip_pose[:3, 3],
            "pressure": air.pressure_pa,
            "command": command.setpoint_pa,
            "q": estimate.q,
            "qd": estimate.qd,
            "q_d": command.reference.q,
            "estimates": list(command.estimates.values()),
            "saturated": command.saturated,
        }.items():
            rows[key].append(value)
    return Record(
        **{key: np.array(value) for key, value in rows.items()}, names=names, counts=estimate.status.counts
    )


def settle(plant, stepper, duration_s=4.0, h=0.01):
    """Let the plant hang at rest, vented."""
    state = State(np.zeros(plant.n_q), np.zeros(plant.n_q), np.zeros(plant.n_internal))
    for _ in range(round(duration_s / h)):
        state, status = stepper.step(state, np.zeros(plant.n_u), h)
        assert status.ok, status.message
        # Faster than the arm's own damping; only the rest is wanted.
        state = replace(state, qd=0.9 * state.qd)
    return replace(state, qd=np.zeros(plant.n_q))
