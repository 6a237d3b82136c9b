"""The filter with a learned force: what it gains, how the force comes and goes, and repeated poses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soro_core import SoftArm, load_robot
from soro_core.adaptation import Learned
from soro_core.config import find_config
from soro_core.estimation import Estimator, ImuSample, PoseSample
from soro_core.integrate import State, make_stepper

ROBOT = load_robot(find_config("tue_three_bellow", "robots")).replace(base_quaternion=(1.0, 0.0, 0.0, 0.0))
LENGTH = ROBOT.length
DT = 0.005
LOAD_KG = 0.02
SIZE = 1 + 3 * 4 + 2


def learned(mass_kg=LOAD_KG):
    return Learned(np.concatenate([[mass_kg], np.zeros(SIZE - 1)]))


def pressures(t):
    phase = 2 * np.pi * np.arange(3) / 3
    return 25e3 * (1 - np.exp(-t / 0.4)) * (1.2 + np.cos(2 * np.pi * t / 1.5 - phase))


class Run:
    """The hanging arm with a load that the filter's model does not have."""

    def __init__(self, noise_m=3e-4, moving=True):
        self.arm = SoftArm(ROBOT.replace(tip_mass=ROBOT.tip_mass + LOAD_KG))
        self.stepper = make_stepper("trapezoidal", self.arm)
        self.estimator = Estimator(ROBOT, dt=DT)
        self.rng, self.noise_m, self.moving = np.random.default_rng(2), noise_m, moving
        body = State(np.zeros(3), np.zeros(3), np.zeros(self.arm.n_internal))
        for _ in range(400):  # at rest under its weight
            body, _ = self.stepper.step(body, self.pressure(0.0), 0.01)
            body = replace(body, qd=0.9 * body.qd)
        self.body = replace(body, qd=np.zeros(3))
        self.k, self.last = 0, None
        self.state = self.estimator.initial_state(0.0, pressure_pa=self.pressure(0.0))

    def pressure(self, t):
        return pressures(t) if self.moving else np.array([2e4, 1e4, 0.0])

    def tick(self, model=None, pose=True, frozen=False, rounding_m=0.0, imus=()):
        self.k += 1
        t = self.k * DT
        mean = 0.5 * (self.pressure(t - DT) + self.pressure(t))
        self.body, _ = self.stepper.step(self.body, mean, DT)
        poses = []
        if pose and self.k % 2 == 0:
            true = self.arm.pose(self.body.q, LENGTH)
            position = true[:3, 3] + self.noise_m * self.rng.standard_normal(3)
            if rounding_m:
                position = rounding_m * np.round(position / rounding_m)
            sample = PoseSample(t, position, Rotation.from_matrix(true[:3, :3]).as_quat(), LENGTH)
            if frozen:
                sample = replace(self.last, stamp_s=t)
            self.last = sample
            poses = [sample]
        self.state, estimate = self.estimator.step(self.state, self.pressure(t), poses, imus, DT, model)
        error = np.linalg.norm(estimate.tip_pose[:3, 3] - self.arm.pose(self.body.q, LENGTH)[:3, 3])
        return estimate, float(error)

    def ticks(self, n, **keys):
        found = [self.tick(**keys) for _ in range(n)]
        return found[-1][0], np.array([error for _, error in found])


def test_a_filter_that_knows_the_load_needs_no_poses_for_half_a_second():
    """It predicts with the force at each predicted state; without it the arm is elsewhere."""
    errors = {}
    for known in (True, False):
        run = Run()
        model = learned() if known else None
        run.ticks(300, model=model)
        errors[known] = run.ticks(100, model=model, pose=False)[1].max()
    assert errors[True] < 0.5 * errors[False]


@pytest.mark.parametrize("last", [None, learned(np.nan), Learned(np.zeros(4))], ids=["none", "nan", "size"])
def test_a_force_that_is_not_renewed_fades_out_and_the_status_says_so(last):
    run = Run()
    shares = []
    for _ in range(110):
        estimate, _ = run.tick(model=learned())
        shares.append(run.state.known.share)
    assert shares[0] == pytest.approx(DT / 0.5)
    assert shares[-1] == 1.0
    assert estimate.status.note == ""
    for k in range(130):
        estimate, error = run.tick(model=last)
        shares.append(run.state.known.share)
        assert estimate.status.ok
        assert bool(estimate.status.note) == (k >= 20 and run.state.known.learned is not None)
    assert np.all(np.array(shares[110:130]) == 1.0)
    assert np.all(np.diff(shares[131:]) <= 0.0)
    assert max(abs(np.diff(shares))) <= DT / 0.5 + 1e-12
    assert shares[-1] == 0.0
    assert run.state.counts.learned == (0 if last is None else 130)
    assert error < 2e-3


def test_without_a_learned_force_nothing_changes_to_the_bit():
    one, two = Run(), Run()
    a, b = one.ticks(50)[0], two.ticks(50, model=None)[0]
    assert a.q.tobytes() == b.q.tobytes()
    assert one.state.known.note == ""


def test_poses_that_a_sensor_repeats_while_the_arm_moves_are_refused():
    run = Run()
    run.ticks(400, model=learned())
    estimate, errors = run.ticks(200, model=learned(), frozen=True)
    assert run.state.counts.frozen > 90
    other = Run()
    other.ticks(400, model=learned())
    # As without any pose; 30 mm if they are followed.
    assert errors.max() < other.ticks(200, model=learned(), pose=False)[1].max() + 0.5e-3
    assert not estimate.status.ok
    assert run.ticks(60, model=learned())[1][-1] < 1e-3
    assert run.tick(model=learned())[0].status.ok


@pytest.mark.parametrize("rounding_m", [0.0, 1e-3])
def test_an_arm_at_rest_under_a_sensor_without_noise_stays_ok(rounding_m):
    run = Run(noise_m=0.0, moving=False)
    for _ in range(400):
        estimate, _ = run.tick(rounding_m=rounding_m)
    assert estimate.status.ok
    assert run.state.counts.frozen == 0


def test_a_slow_arm_under_a_rounded_sensor_stays_ok():
    run = Run(noise_m=0.0)
    run.ticks(10)
    assert all(run.tick(rounding_m=1e-3)[0].status.ok for _ in range(500))


def test_an_imu_counts_where_the_poses_are_frozen():
    run = Run()
    run.ticks(300, model=learned())
    for _ in range(200):
        t = (run.k + 1) * DT
        jacobian = run.arm.jacobian(run.body.q, LENGTH)
        rotation = run.arm.pose(run.body.q, LENGTH)[:3, :3]
        up = rotation.T @ np.array([0.0, 0.0, 9.81])
        imu = ImuSample(t, jacobian[:3] @ run.body.qd, up, Rotation.from_matrix(rotation).as_quat(), LENGTH)
        estimate, error = run.tick(model=learned(), frozen=True, imus=[imu])
    assert estimate.status.ok
    assert not estimate.positions
    assert error < 3e-3
