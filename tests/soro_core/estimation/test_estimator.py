"""The filter on simulated samples: consistency, gates, late, lost and nonsensical input."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from soro_core import Loop, SoftArm, robot_from_dict
from soro_core.config import parse
from soro_core.control import Controller
from soro_core.errors import ModelError
from soro_core.estimation import Estimator, EstimatorConfig, EstimatorState, ImuSample, PoseSample
from soro_core.integrate import STEPPERS, State, make_stepper
from tests.refused import fails, refused

DT = 0.005
LENGTH = 0.064
CHAMBERS = [{"angle_rad": k * 2 * np.pi / 3, "alpha_eps": 1.25e-6, "alpha_kappa": 1.0e-8} for k in range(3)]
ROBOT = {
    "name": "test arm",
    "base_quaternion": [1.0, 0.0, 0.0, 0.0],
    "links": [
        {
            "length": LENGTH,
            "radius": 0.013,
            "mass": 0.017,
            "k_e": [1210.0, 942.0, 45.55],
            "k_b": [0.0085, 0.0025, 3.0],
            "damping": [0.01, 2e-7, 2e-7],
            "chambers": CHAMBERS,
        }
    ],
}
# The kinematics of these tests are exact: no allowance for their error.
EXACT = {
    "pose": {
        "position_std_m": 3e-4,
        "orientation_std_rad": 5e-3,
        "position_model_std_m": 0.0,
        "orientation_model_std_rad": 0.0,
    }
}


@pytest.fixture(scope="module")
def robot():
    return robot_from_dict(ROBOT)


def config(**changes):
    return parse({**EXACT, **changes}, EstimatorConfig, "test")


def pressures(t):
    phase = 2 * np.pi * np.arange(3) / 3
    return 25e3 * (1 - np.exp(-t / 0.4)) * (1.2 + np.cos(2 * np.pi * t / 1.5 - phase))


@dataclass
class World:
    """A true arm whose accelerations are disturbed by white noise of the given density."""

    robot: object
    seed: int = 0
    noise: tuple = (0.0, 0.0, 0.0)
    push: tuple = (0.0, 0.0, 0.0)

    def __post_init__(self):
        self.arm = SoftArm(self.robot)
        self.stepper = make_stepper("trapezoidal", self.arm)
        self.rng = np.random.default_rng(self.seed)
        self.state = State(np.zeros(3), np.zeros(3), np.zeros(0))
        self.t = 0.0

    def advance(self, dt=DT, parts=5):
        h = dt / parts
        for _ in range(parts):
            kick = np.array(self.noise) * np.sqrt(h) * self.rng.standard_normal(3) + h * np.array(self.push)
            mean = 0.5 * (pressures(self.t) + pressures(self.t + h))
            state, status = self.stepper.step(self.state, mean, h)
            assert status.ok
            self.state = State(state.q, state.qd + kick, state.internal)
            self.t += h

    def pose(self, position=3e-4, rotation=5e-3):
        g = self.arm.pose(self.state.q, LENGTH)
        turn = Rotation.from_rotvec(rotation * self.rng.standard_normal(3))
        return PoseSample(
            self.t,
            g[:3, 3] + position * self.rng.standard_normal(3),
            (Rotation.from_matrix(g[:3, :3]) * turn).as_quat(),
            LENGTH,
        )

    def imu(self, s=LENGTH, orientation=True):
        g, omega = self.arm.pose(self.state.q, s), self.arm.jacobian(self.state.q, s)[:3] @ self.state.qd
        turn = Rotation.from_rotvec(5e-3 * self.rng.standard_normal(3))
        return ImuSample(
            self.t,
            omega + 0.01 * self.rng.standard_normal(3),
            g[:3, :3].T @ np.array([0.0, 0.0, 9.81]) + 0.05 * self.rng.standard_normal(3),
            (Rotation.from_matrix(g[:3, :3]) * turn).as_quat() if orientation else None,
            s,
        )

    def x(self):
        return np.concatenate([self.state.q, self.state.qd])


def tip_error(world, estimate):
    return np.linalg.norm(world.arm.pose(world.state.q, LENGTH)[:3, 3] - estimate.tip_pose[:3, 3])


def track(robot, settings, seconds=3.0, world=None, sense=None, dt=DT):
    """Run filter and world; `sense(k, world)` gives the samples of a tick."""
    world = world if world is not None else World(robot)
    sense = sense if sense is not None else (lambda k, w: [w.pose()] if k % 2 == 0 else [])
    estimator = Estimator(robot, settings, dt)
    state = estimator.initial_state(0.0)
    for k in range(1, round(seconds / dt) + 1):
        world.advance(dt)
        samples = sense(k, world)
        poses = [sample for sample in samples if isinstance(sample, PoseSample)]
        imus = [sample for sample in samples if isinstance(sample, ImuSample)]
        state, estimate = estimator.step(state, pressures(world.t), poses, imus, dt)
        yield world, estimate, state


def final(*args, **kwargs):
    *_, last = track(*args, **kwargs)
    return last


MATCHED = {
    "disturbance": False,
    "process": {"stretch_acceleration": 5.0, "curvature_acceleration_per_m": 300.0},
}


@pytest.mark.slow
def test_it_is_consistent(robot):
    """Normalised estimation error squared over seeds, within the 99.9 % interval of its mean."""
    values = []
    for seed in range(12):
        world = World(robot, seed, noise=(5.0, 300.0, 300.0))
        run = track(robot, config(**MATCHED), 1.5, world)
        for k, (_, estimate, _) in enumerate(run):
            if k > 150 and k % 30 == 0:  # far enough apart to be nearly independent
                error = world.x() - np.concatenate([estimate.q, estimate.qd])
                values.append(error @ np.linalg.solve(estimate.covariance, error))
    n = len(values)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 6 * n) / n
    print(f"mean NEES {np.mean(values):.2f} of 6, bounds {low:.2f} to {high:.2f}, n {n}")
    assert low < np.mean(values) < high


@pytest.mark.slow
def test_an_unknown_steady_force_is_found(robot):
    push = (200.0, 4000.0, -2000.0)  # accelerations: an unknown load
    found = []
    world = World(robot, 1, push=push)
    for _, estimate, _ in track(robot, config(), 4.0, world):
        found.append(estimate.disturbance)
    # Of the last second: one value has the noise of the poses, 350 in the curvatures.
    assert np.mean(found[-200:], axis=0) == pytest.approx(push, rel=0.05, abs=100.0)
    assert tip_error(world, estimate) < 5e-4
    without = final(robot, config(disturbance=False), 4.0, World(robot, 1, push=push))
    assert tip_error(without[0], without[1]) > tip_error(world, estimate)


def test_covariance_stays_symmetric_and_positive(robot):
    for _, estimate, state in track(robot, config(), 1.0):
        covariance = state.belief.covariance
        assert covariance == pytest.approx(covariance.T, abs=0.0)
        assert (
            np.linalg.eigvalsh(covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))).min()
            > -1e-9
        )
        # Three coordinates move six: semi-definite, up to round-off.
        spread = np.linalg.eigvalsh(estimate.tip_covariance)
        assert spread.min() > -1e-12 * spread.max()


def test_a_wrong_start_is_found_from_poses(robot):
    world = World(robot, 2)
    world.state = State(np.array([0.15, 12.0, -14.0]), np.zeros(3), np.zeros(0))
    *_, (world, estimate, state) = track(robot, config(), 0.5, world)
    assert tip_error(world, estimate) < 1e-3
    assert state.counts.outliers < 20


def test_outliers_are_gated_and_counted(robot):
    def sense(k, world):
        if k % 2:
            return []
        return [world.pose(position=0.03, rotation=0.5) if k % 20 == 0 and k > 100 else world.pose()]

    worst = 0.0
    for world, estimate, state in track(robot, config(), 3.0, World(robot, 3), sense):  # noqa: B007
        if world.t > 1.0:
            worst = max(worst, tip_error(world, estimate))
    far = sum(1 for k in range(101, 601) if k % 20 == 0)
    assert worst < 1.5e-3
    assert far - 1 <= state.counts.outliers <= far + 3
    assert state.counts.reacquired == 0


def test_repeated_old_and_future_stamps_are_refused_and_counted(robot):
    kept = []

    def sense(k, world):
        if k % 2:
            return []
        kept.append(world.pose())
        if k % 10 == 0:
            return [kept[-2]]  # a driver that repeats its last sample
        if k == 402:
            return [kept[3]]
        if k == 404:
            return [PoseSample(world.t + 5.0, kept[-1].position, kept[-1].quaternion, LENGTH)]
        return [kept[-1]]

    world, estimate, state = final(robot, config(), 3.0, World(robot, 4), sense)
    assert state.counts.stale == 60 + 1
    assert state.counts.early == 1
    assert state.counts.accepted + state.counts.outliers == 300 - 62
    assert tip_error(world, estimate) < 1e-3


def test_a_sample_stamped_a_little_ahead_waits_for_its_time(robot):
    held = {}

    def sense(k, world):
        # The pose of this tick was handed out one tick early.
        sample = held.pop(k, None)
        return [] if sample is None else [sample]

    world = World(robot, 5)
    estimator = Estimator(robot, config(), DT)
    state = estimator.initial_state(0.0)
    for k in range(1, 201):
        before = world.t
        world.advance()
        early = world.pose()
        # The filter is one tick behind the sample's stamp.
        state, _ = estimator.step(state, pressures(before), [early], [], DT) if k > 1 else (state, None)
    assert state.counts.early == 0
    assert state.counts.stale == 0
    assert state.counts.accepted > 150


@pytest.mark.parametrize("seed", range(3))
def test_a_fifth_of_the_samples_lost(robot, seed):
    lost = np.random.default_rng(100 + seed)
    last = []

    def sense(k, world):
        if k % 2:
            return []
        sample = world.pose()
        if last and lost.random() < 0.2:
            return [last[-1]]
        last.append(sample)
        return [sample]

    errors = []
    for world, estimate, _ in track(robot, config(), 3.0, World(robot, seed), sense):
        if world.t > 1.0:
            errors.append(tip_error(world, estimate))
    assert np.sqrt(np.mean(np.square(errors))) < 4e-4


@pytest.mark.slow
def test_late_samples_are_used_at_the_time_they_were_taken(robot):
    def late(ticks):
        queue = []

        def sense(k, world):
            if k % 2 == 0:
                queue.append((k + ticks, world.pose()))
            due = [sample for when, sample in queue if when <= k]
            queue[:] = [item for item in queue if item[0] > k]
            return due

        return sense

    def error(ticks, restamp):
        sense = late(ticks)

        def lying(k, world):
            return [PoseSample(world.t, s.position, s.quaternion, s.s) for s in sense(k, world)]

        chosen = lying if restamp else sense
        squares = [
            tip_error(world, estimate) ** 2
            for world, estimate, _ in track(robot, config(), 3.0, World(robot, 6), chosen)
            if world.t > 1.0
        ]
        return np.sqrt(np.mean(squares))

    now, delayed, believed_fresh = error(0, False), error(8, False), error(8, True)
    print(f"tip RMS: no delay {now:.2e}, 40 ms known {delayed:.2e}, 40 ms unknown {believed_fresh:.2e}")
    # What is left is 40 ms of extrapolation from a noisy rate.
    assert delayed < 2 * now
    assert believed_fresh > 3 * delayed


def test_samples_out_of_order_give_what_they_give_in_order(robot):
    def sense(k, world):
        return [world.pose(), world.imu()] if k % 2 == 0 else []

    ordered = World(robot, 7)
    estimator = Estimator(robot, config(), DT)
    one, two = estimator.initial_state(0.0), estimator.initial_state(0.0)
    poses = []
    for k in range(1, 81):
        ordered.advance()
        samples = sense(k, ordered)
        imus = [s for s in samples if isinstance(s, ImuSample)]
        poses += [(k + 4, s) for s in samples if isinstance(s, PoseSample)]
        due = [s for when, s in poses if when == k]
        # The pose comes 20 ms late, behind IMU samples that are younger; the other filter gets all in time.
        one, first = estimator.step(one, pressures(ordered.t), due, imus, DT)
        two, second = estimator.step(
            two, pressures(ordered.t), [s for s in samples if isinstance(s, PoseSample)], imus, DT
        )
    for k in range(81, 85):
        ordered.advance()
        due = [s for when, s in poses if when == k]
        one, first = estimator.step(one, pressures(ordered.t), due, [], DT)
        two, second = estimator.step(two, pressures(ordered.t), [], [], DT)
    assert first.q == pytest.approx(second.q, abs=2e-2, rel=1e-3)
    assert first.q[0] == pytest.approx(second.q[0], abs=1e-4)


@pytest.mark.slow
def test_it_re_acquires_after_the_arm_was_moved(robot):
    """A jump that the model cannot explain: refused at first, believed after the configured number."""
    settings = config(reacquire_after=10)
    world = World(robot, 8)
    for now, estimate, state in track(robot, settings, 4.0, world):  # noqa: B007
        if abs(now.t - 2.0) < 1e-9:
            now.state = State(now.state.q + np.array([0.0, 18.0, -12.0]), np.zeros(3), np.zeros(0))
            now.push = (0.0, 0.0, 0.0)
    assert state.counts.outliers >= 1
    assert state.counts.reacquired <= 2
    assert tip_error(world, estimate) < 1e-3


def test_a_sensor_that_lies_for_long_and_then_returns(robot):
    def sense(k, world):
        if k % 2:
            return []
        sample = world.pose()
        if 200 < k < 400:
            return [
                PoseSample(world.t, sample.position + np.array([0.0, 0.03, 0.0]), sample.quaternion, LENGTH)
            ]
        return [sample]

    world, estimate, state = final(robot, config(reacquire_after=10), 4.0, World(robot, 9), sense)
    assert state.counts.reacquired >= 1
    assert estimate.status.ok
    assert tip_error(world, estimate) < 1e-3


NONSENSE = [
    PoseSample(0.5, np.array([np.nan, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]), LENGTH),
    PoseSample(np.nan, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), LENGTH),
    PoseSample(0.5, np.zeros(3), np.zeros(4), LENGTH),
    PoseSample(0.5, np.zeros(2), np.array([0.0, 0.0, 0.0, 1.0]), LENGTH),
    PoseSample(0.5, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), 1.0),
    PoseSample(0.5, np.zeros(3), np.array([0.0, 0.0, np.inf, 1.0]), np.nan),
    ImuSample(0.5, np.full(3, np.inf), np.zeros(3), None, LENGTH),
    ImuSample(0.5, np.zeros(3), np.zeros(3), np.full(4, np.nan), LENGTH),
]


@pytest.mark.parametrize("index", range(len(NONSENSE)))
def test_nonsense_is_refused_and_counted(robot, index):
    def sense(k, world):
        good = [world.pose()] if k % 2 == 0 else []
        return [*good, NONSENSE[index]]

    for _, estimate, state in track(robot, config(), 0.5, World(robot, 10), sense):  # noqa: B007
        assert np.all(np.isfinite(estimate.q))
        assert np.all(np.isfinite(estimate.covariance))
    assert state.counts.invalid == 100
    assert state.counts.accepted > 40


def test_pressures_that_are_no_numbers_are_replaced_by_the_last(robot):
    estimator = Estimator(robot, config(), DT)
    state = estimator.initial_state(0.0, pressure_pa=np.full(3, 1e4))
    state, estimate = estimator.step(state, np.array([np.nan, 2e4, np.inf]), [], [], DT)
    assert state.pressure_pa.tolist() == [1e4, 2e4, 1e4]
    assert state.counts.pressures == 1
    assert np.all(np.isfinite(estimate.q))


@pytest.mark.parametrize("pressures", [np.zeros(2), np.zeros((3, 1)), [1e4], 0.0, "all", None])
def test_pressures_of_another_shape_are_refused_in_one_line(robot, pressures):
    estimator = Estimator(robot, config(), DT)
    state = estimator.initial_state()
    for dt in (DT, 10.0):
        with fails(ModelError, "3", key="chamber_pressure_pa"):
            estimator.step(state, pressures, [], [], dt)
    if pressures is not None:
        with fails(ModelError, "3", key="pressure_pa"):
            estimator.initial_state(pressure_pa=pressures)
        with fails(ModelError, "3", key="q"):
            estimator.initial_state(q=pressures)


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        *(({"dt": dt}, "dt") for dt in (-1.0, 0.0, np.nan, np.inf, "fast", None, True)),
        ({"config": {}}, "config"),
        ({"model": 2}, "model"),
        ({"robot": "tue_three_bellow"}, "robot"),
    ],
)
def test_an_argument_that_cannot_be_is_refused_in_one_line(robot, arguments, key):
    with fails(ModelError, key=key):
        Estimator(**{"robot": robot, **arguments})


def test_estimator_and_controller_of_a_loop_are_not_swapped(robot):
    estimator, controller = Estimator(robot, config(), DT), object.__new__(Controller)
    with fails(ModelError, "Estimator", key="estimator"):
        Loop(controller, estimator)
    with fails(ModelError, "Controller", key="controller"):
        Loop(estimator, estimator)


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan, np.inf])
def test_a_time_step_that_is_none_changes_nothing(robot, dt):
    estimator = Estimator(robot, config(), DT)
    before = estimator.initial_state(1.0)
    after, estimate = estimator.step(before, np.zeros(3), [], [], dt)
    assert after.t_s == 1.0
    assert not estimate.status.ok
    assert after.counts.failed == 1


def test_a_gap_restarts_it_and_it_finds_back(robot):
    world, _, state = final(robot, config(), 1.0, World(robot, 11))
    estimator = Estimator(robot, config(), DT)
    for _ in range(200):
        world.advance()
    state, _ = estimator.step(state, pressures(world.t), [], [], 200 * DT)
    assert state.counts.restarted == 1
    for _ in range(20):
        world.advance()
        state, estimate = estimator.step(state, pressures(world.t), [world.pose()], [], DT)
    assert tip_error(world, estimate) < 1e-3


def test_a_long_step_is_divided(robot):
    world, estimate, state = final(
        robot, config(), 3.0, World(robot, 12), sense=lambda k, w: [w.pose()], dt=0.04
    )
    assert tip_error(world, estimate) < 1.5e-3
    assert state.counts.failed == 0


def test_the_status_says_when_nothing_good_comes(robot):
    _, estimate, _ = final(robot, config(), 0.5, World(robot, 13), sense=lambda k, w: [])
    assert not estimate.status.ok
    assert "no good sample" in estimate.status.message
    _, estimate, _ = final(robot, config(), 0.5, World(robot, 13))
    assert estimate.status.ok
    assert estimate.status.message == ""


@pytest.mark.parametrize("orientation", [True, False])
@pytest.mark.parametrize("s", [LENGTH, 0.6 * LENGTH])
def test_an_imu_alone_observes_the_bending(robot, s, orientation):
    """Orientation, or gravity alone, gives the curvatures; elongation comes from the pressures."""
    errors = []
    world = World(robot, 14)
    settings = config(imu={"orientation_model_std_rad": 0.0, "orientation_std_rad": 5e-3})
    for now, estimate, _ in track(robot, settings, 4.0, world, lambda k, w: [w.imu(s, orientation)]):
        if now.t > 1.5:
            errors.append(now.state.q[1:] - estimate.q[1:])
    assert np.sqrt(np.mean(np.square(errors))) < 0.5


def test_it_repeats_bit_by_bit(robot):
    one, two = (final(robot, config(), 0.5, World(robot, 15))[1] for _ in range(2))
    assert one.q.tobytes() == two.q.tobytes()
    assert one.covariance.tobytes() == two.covariance.tobytes()


def test_the_integrator_of_old_files_is_still_one_of_the_names():
    """The filter has a step of its own; an old file may name any stepper, and a typing error stays one."""
    for name in STEPPERS:
        assert config(integrator=name).integrator == name
    with refused("integrator", "eulr", names=STEPPERS):
        config(integrator="eulr")


def test_wrong_parameters_are_refused_by_name():
    with refused("gate_probability", 1.0):
        config(gate_probability=1.0)
    with refused("pose.position_std_m", -1.0):
        config(pose={"position_std_m": -1.0})


@pytest.mark.parametrize("seed", range(4))
def test_whatever_comes_the_estimate_is_finite_and_nothing_is_raised(robot, seed):
    rng = np.random.default_rng(seed)
    estimator = Estimator(robot, config(reacquire_after=3), DT)
    state = estimator.initial_state(0.0)
    for _ in range(150):
        size = 10.0 ** rng.uniform(-3, 12)
        quaternion = rng.standard_normal(4)
        quaternion /= np.linalg.norm(quaternion)
        stamp = state.t_s + rng.uniform(-0.1, 0.1)
        pose = PoseSample(stamp, size * rng.standard_normal(3), quaternion, rng.uniform(0.0, LENGTH))
        imu = ImuSample(
            stamp, size * rng.standard_normal(3), size * rng.standard_normal(3), quaternion, LENGTH
        )
        dt = rng.choice([DT, 0.0, np.nan, 0.3, 0.02, 5.0], p=[0.8, 0.04, 0.04, 0.04, 0.04, 0.04])
        pressure = 10.0 ** rng.uniform(0, 12) * rng.standard_normal(3)
        state, estimate = estimator.step(state, pressure, [pose], [imu], dt)
        for value in (
            estimate.q,
            estimate.qd,
            estimate.covariance,
            estimate.tip_pose,
            estimate.tip_covariance,
        ):
            assert np.all(np.isfinite(value))
    # And it comes back: from garbage to the truth within a second.
    world = World(robot, seed)
    state = EstimatorState(world.t, state.belief, np.zeros(3), counts=state.counts)
    for k in range(300):
        world.advance()
        samples = [world.pose()] if k % 2 == 0 else []
        state, estimate = estimator.step(state, pressures(world.t), samples, [], DT)
    assert tip_error(world, estimate) < 1e-3
