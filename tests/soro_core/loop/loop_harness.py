"""The closed loop in lockstep: a finer plant, regulators, a noisy late pose, and the loop at 200 Hz."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from soro_core import SoftArm
from soro_core.config import with_changes
from soro_core.control import Controller, ControllerConfig, Reference
from soro_core.estimation import Estimator, EstimatorConfig, ImuSample, PoseSample
from soro_core.integrate import OK, State, Status, make_stepper
from soro_core.loop import Loop
from soro_core.pneumatics import RegulatorModel, RegulatorState, initial_state, reading, step
from soro_core.robot import Discretisation
from soro_core.twin import Observation, SensorConfig
from soro_core.twin.sensors import SectionMotion, measure_imu


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
    load_steps: tuple[tuple[float, float], ...] = ()  # (time [s], payload [kg]) from then on
    outage_s: tuple[float, float] | None = None  # no poses between these times
    frozen_s: tuple[float, float] | None = None  # the last pose under new stamps
    imu: bool = False  # an IMU at the tip in place of the poses
    second_pose_m: float = 0.0  # place of a second pose along the arm
    reference: Reference | None = None  # in place of the configured one
    regulator: RegulatorModel = field(default_factory=RegulatorModel)
    control: ControllerConfig = field(default_factory=lambda: ControllerConfig(law="adaptive"))
    estimation: EstimatorConfig = field(default_factory=EstimatorConfig)
    model: Discretisation = field(default_factory=Discretisation)  # of estimator and controller


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
    cpu_us: np.ndarray
    statuses: tuple = ()
    counts: object = None
    notes: dict = field(default_factory=dict)

    def error(self):
        return np.linalg.norm(self.tip - self.reference, axis=1)

    def peak(self, after_s=3.0):
        return float(self.error()[self.t > after_s].max())

    def settled_s(self, after_s=0.0, bound_m=2e-3, window_s=0.25):
        """Time after `after_s` from which the RMS over a window stays below a bound."""
        count = round(window_s / (self.t[1] - self.t[0]))
        late = self.t > after_s
        mean = np.convolve(self.error()[late] ** 2, np.ones(count) / count, mode="valid")
        above = np.flatnonzero(mean >= bound_m**2)
        if above.size == mean.size or (above.size and above[-1] == mean.size - 1):
            return np.inf
        return float(self.t[late][above[-1] + 1 + count // 2] - after_s) if above.size else 0.0

    def command_rate(self, last_s=5.0):
        """RMS rate of the commands [Pa/s]."""
        late = self.t > self.t[-1] - last_s
        return float(np.sqrt(np.mean(np.diff(self.command[late], axis=0) ** 2)) / (self.t[1] - self.t[0]))

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


def within(t: float, span: tuple[float, float] | None) -> bool:
    return span is not None and span[0] < t < span[1]


def without_adaptation(config: ControllerConfig) -> ControllerConfig:
    return with_changes(config, adapt=False)


@dataclass(frozen=True)
class World:
    """State of the plant at one tick: arm, air, and pose samples on their way."""

    tick: int
    body: State
    air: RegulatorState
    on_the_way: tuple[tuple[int, PoseSample], ...] = ()
    last: PoseSample | None = None
    status: Status = OK


class Harness:
    """The plant that the loop does not know: the true arm, regulators of the loop's lag, one pose sensor."""

    def __init__(self, robot, setup: Setup) -> None:
        true = scaled(setup.plant or robot, setup.stiffness, setup.damping, setup.gain)
        self.setup, self.length, self.robot, self.true = setup, robot.length, robot, true
        self.load(robot.tip_mass + setup.payload_kg)
        self.rng = np.random.default_rng(setup.seed)

    def load(self, tip_mass: float) -> None:
        self.arm = SoftArm(self.true.replace(tip_mass=tip_mass).refine(self.setup.refine))
        self.stepper = make_stepper("trapezoidal", self.arm)

    def initial(self) -> World:
        """One tick after the arm hangs at rest, vented."""
        rest = World(0, settle(self.arm, self.stepper), initial_state(self.setup.regulator, self.arm.n_u))
        return self.step_setpoints(rest, np.zeros(self.arm.n_u))

    def observe(self, world: World) -> tuple[World, Observation]:
        setup, k = self.setup, world.tick
        pose = self.arm.pose(world.body.q, self.length)
        last, on_the_way = world.last, world.on_the_way
        t, imus = k * setup.dt, ()
        if setup.imu:
            imus = (self.imu(t, world, pose),)
        elif k % setup.pose_every == 0 and not within(t, setup.outage_s):
            sample = self.sample(t, pose, self.length)
            if last is not None and within(t, setup.frozen_s):
                sample = replace(sample, position=last.position, quaternion=last.quaternion)
            if last is not None and self.rng.random() < setup.drop:
                sample = last
            last, on_the_way = sample, (*on_the_way, (k + setup.pose_delay, sample))
            if setup.second_pose_m:
                place = setup.second_pose_m
                second = self.sample(t, self.arm.pose(world.body.q, place), place)
                on_the_way = (*on_the_way, (k + setup.pose_delay, second))
        poses = tuple(sample for due, sample in on_the_way if due <= k)
        on_the_way = tuple(item for item in on_the_way if item[0] > k)
        measured = reading(setup.regulator, world.air, self.rng)
        return replace(world, last=last, on_the_way=on_the_way), Observation(measured, poses, imus, pose)

    def imu(self, t: float, world: World, pose: np.ndarray) -> ImuSample:
        q, qd, h = world.body.q, world.body.qd, 1e-6
        qdd = self.arm.forward_dynamics(q, qd, world.air.pressure_pa, internal=world.body.internal)
        jacobian, ahead, behind = (self.arm.jacobian(q + x * qd, self.length) for x in (0.0, h, -h))
        motion = SectionMotion(pose, jacobian @ qd, jacobian @ qdd + (ahead - behind) @ qd / (2.0 * h))
        gravity = np.array(self.robot.gravity)
        return measure_imu(SensorConfig(), motion, gravity, t, self.length, self.rng)

    def sample(self, t: float, pose: np.ndarray, place: float) -> PoseSample:
        setup, rng = self.setup, self.rng
        far = 60.0 if rng.random() < setup.outlier else 1.0
        return PoseSample(
            stamp_s=t,
            position=pose[:3, 3] + far * setup.position_noise_m * rng.standard_normal(3),
            quaternion=(
                Rotation.from_matrix(pose[:3, :3])
                * Rotation.from_rotvec(far * setup.rotation_noise_rad * rng.standard_normal(3))
            ).as_quat(),
            s=place,
        )

    def step_setpoints(self, world: World, setpoint: np.ndarray) -> World:
        for at, payload in self.setup.load_steps:
            if round(at / self.setup.dt) == world.tick:
                self.load(self.robot.tip_mass + payload)
        body, air, h = world.body, world.air, self.setup.dt / self.setup.substeps
        for _ in range(self.setup.substeps):
            before = air.pressure_pa
            air = step(self.setup.regulator, air, setpoint, h)
            body, status = self.stepper.step(body, 0.5 * (before + air.pressure_pa), h)
            assert status.ok, status.message
        return replace(world, tick=world.tick + 1, body=body, air=air)


def run(robot, setup: Setup) -> Record:
    loop = Loop(
        Estimator(robot, setup.estimation, setup.dt, setup.model),
        Controller(robot, setup.control, setup.model),
    )
    n = round(setup.duration_s / setup.dt)
    given = None if setup.reference is None else lambda t, state: setup.reference
    ticks = list(loop.run(Harness(robot, setup), n, setup.dt, delay=setup.command_delay, reference=given))
    rows = [
        {
            "t": tick.plant.tick * setup.dt,
            "tip": tick.seen.tip[:3, 3],
            "reference": tick.command.tip_reference[:3, 3],
            "estimated": tick.estimate.tip_pose[:3, 3],
            "pressure": tick.plant.air.pressure_pa,
            "command": tick.command.setpoint_pa,
            "q": tick.estimate.q,
            "qd": tick.estimate.qd,
            "q_d": tick.command.reference.q,
            "estimates": list(tick.command.estimates.values()),
            "saturated": tick.command.saturated,
            "cpu_us": tick.cpu_us,
        }
        for tick in ticks
    ]
    return Record(
        **{key: np.array([row[key] for row in rows]) for key in rows[0]},
        names=tuple(ticks[-1].command.estimates),
        statuses=tuple(tick.command.status.message or tick.command.status.note for tick in ticks),
        counts=ticks[-1].estimate.status.counts,
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
