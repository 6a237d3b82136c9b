"""The filter's kernels: one model for mean and covariance, of second order, with and without derivatives."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.adaptation import Learned, LearnedForce
from soro_core.config import find_config, parse
from soro_core.estimation import EstimatorConfig, PoseSample
from soro_core.estimation.filter import Filter
from soro_core.estimation.kernel.advance import ESTIMATE
from soro_core.estimation.kernel.update import FAILED, FUSED
from soro_core.estimation.learned_input import LearnedInput
from soro_core.integrate import State, make_stepper
from soro_core.rotation import quaternion_from_matrix

pytestmark = pytest.mark.numerics

ROBOT = load_robot(find_config("tue_three_bellow", "robots"))
NOISE = EstimatorConfig().process.model_dump()
CONFIG = parse({"learned_process": NOISE}, EstimatorConfig, "test")
P = np.array([1e4, 2e4, 0.0])
N, DT = 3, 0.005
Q, QD = np.array([0.05, 4.0, -3.0]), np.array([0.1, 20.0, -30.0])
# Steps of q and qd for differences.
STEPS = np.array([1e-5, 1e-3, 1e-3, 1e-3, 1e-1, 1e-1])


def model(mass_kg, weights=0.0, damping_s=0.0):
    shape = weights * np.random.default_rng(0).normal(size=N * (N + 1))
    return LearnedInput(Learned(np.concatenate([[mass_kg], shape, np.full(2, damping_s)])), 0.0, 1.0)


def belief_of(filter_, mean=None):
    start = filter_.start(Q)
    start.mean[N : 2 * N] = QD
    start.mean[2 * N :] = np.linspace(-200.0, 400.0, 2 * N)
    return start if mean is None else start._replace(mean=mean)


def transition(filter_, known, dt):
    """Transition of the covariance: that of a large covariance of one component, noise apart."""
    started = belief_of(filter_)
    columns = []
    for i in range(len(started.mean)):
        large = np.zeros_like(started.covariance)
        large[i, i] = 1e30
        out = filter_.predict(started._replace(covariance=large), P, dt, known)[0].covariance
        columns.append(out[i] / out[i, i] * np.sqrt(out[i, i] / 1e30))
    return np.array(columns).T


def mean_slopes(filter_, known, dt):
    """Derivatives of the predicted mean by (q, qd) at the start, by central differences."""
    mean = belief_of(filter_).mean
    columns = []
    for i, h in enumerate(STEPS):
        move = np.zeros_like(mean)
        move[i] = h
        ends = [filter_.predict(belief_of(filter_, mean + s * move), P, dt, known)[0].mean for s in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * h))
    return np.array(columns).T[: 2 * N]


@pytest.mark.parametrize("robot", [ROBOT, ROBOT.replace(tip_mass=0.01)], ids=["bare", "with a plate"])
def test_a_learned_mass_is_a_heavier_arm_in_mean_and_covariance(robot):
    loaded, heavier = (Filter(SoftArm(one), CONFIG) for one in (robot, robot.replace(tip_mass=0.02)))
    known = model(0.02 - robot.tip_mass)
    one, two = (
        loaded.predict(belief_of(loaded), P, DT, known)[0],
        heavier.predict(belief_of(heavier), P, DT)[0],
    )
    np.testing.assert_allclose(one.mean, two.mean, rtol=1e-12)
    np.testing.assert_allclose(one.covariance, two.covariance, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "known", [LearnedInput(), model(0.02, 1.0, 0.02), model(-0.005, 1.0)], ids=["none", "load", "less"]
)
def test_the_covariance_moves_by_the_derivatives_of_the_mean(known):
    """Over a short step, so that the terms of higher order of both are small."""
    filter_ = Filter(SoftArm(ROBOT), CONFIG)
    dt = 1e-5
    one, two = transition(filter_, known, dt)[: 2 * N, : 2 * N], mean_slopes(filter_, known, dt)
    free = np.eye(2 * N) + dt * np.eye(2 * N, k=N)
    scale = np.abs(two - free).max(axis=1, keepdims=True)
    assert (np.abs(one - two) / scale).max() < 2e-3


@pytest.mark.parametrize("mass", [0.02, -0.01])
def test_the_prediction_is_of_second_order(mass):
    """Half the step, a quarter of the error; the reference is the law of motion integrated finely."""
    filter_, known = Filter(SoftArm(ROBOT), CONFIG), model(mass, 1.0)

    def end(parts):
        belief = belief_of(filter_)
        for _ in range(parts):
            belief, ok = filter_.predict(belief, P, DT / parts, known)
            assert ok
        return belief.mean[: 2 * N]

    errors = [np.abs(end(parts) - end(256))[1:3].max() for parts in (2, 4, 8)]
    assert 3.5 < errors[0] / errors[1] < 4.5
    assert 3.5 < errors[1] / errors[2] < 4.5


def test_the_learned_force_is_that_of_the_law():
    """It subtracts Y_m m + U W phi from M qdd; of a mass that the arm does not have, the weight."""
    filter_, law, arm = Filter(SoftArm(ROBOT), CONFIG), LearnedForce(SoftArm(ROBOT)), SoftArm(ROBOT)
    dt = 1e-6

    def acceleration(known):
        started = belief_of(filter_)
        started.mean[2 * N :] = 0.0
        return (filter_.predict(started, P, dt, known)[0].qd - QD) / dt

    bare = acceleration(LearnedInput())
    for mass, carried in ((0.02, True), (-0.005, False)):
        known = model(mass, 1.0)
        qdd = acceleration(known)
        force = law.force(known.learned, Q, QD if carried else 0.0 * QD, qdd if carried else 0.0 * qdd)
        left = arm.inertia_matrix(Q) @ (qdd - bare)
        np.testing.assert_allclose(left, -force, rtol=2e-3, atol=2e-3 * np.abs(force).max())


@pytest.mark.slow
def test_without_derivatives_differences_give_the_same():
    """An arm of the same physics under another key: an obstacle far away."""
    held = ROBOT.replace(
        contacts={"planes": [{"point": [0.0, 0.0, -9.0], "normal": [0.0, 0.0, 1.0], "stiffness": 1e3}]}
    )
    filters = [Filter(SoftArm(one), CONFIG) for one in (ROBOT, held)]
    ends = [one.predict(belief_of(one), P, DT, model(0.01, 1.0, 0.02))[0] for one in filters]
    np.testing.assert_allclose(ends[0].mean, ends[1].mean, rtol=1e-4, atol=1e-6)
    scale = np.sqrt(np.outer(*2 * [np.diag(ends[0].covariance)]))
    assert (np.abs(ends[0].covariance - ends[1].covariance) / scale).max() < 1e-4


@pytest.mark.slow
def test_the_method_mde_predicts_too():
    arm = SoftArm(ROBOT, method="mde")
    one, two = Filter(arm, CONFIG), Filter(SoftArm(ROBOT), CONFIG)
    ends = [filter_.predict(belief_of(filter_), P, DT, model(-0.005, 1.0))[0] for filter_ in (one, two)]
    np.testing.assert_allclose(ends[0].q, ends[1].q, rtol=0.05, atol=2e-3)


def test_it_predicts_as_the_stepper_does():
    """Of an arm that moves as its pressures let it, over half a second; creep included."""
    arm = SoftArm(ROBOT)
    filter_, stepper = Filter(arm, CONFIG), make_stepper("trapezoidal", arm)
    belief, state = filter_.start(), State(np.zeros(N), np.zeros(N), np.zeros(arm.n_internal))
    for k in range(100):
        pressure = 2e4 * (1.0 + np.sin(0.05 * k + np.arange(3)))
        belief, _ = filter_.predict(belief, pressure, DT)
        for _ in range(5):
            state, status = stepper.step(state, pressure, DT / 5)
            assert status.ok
    lengths = ROBOT.length
    tips = [arm.pose(q, lengths)[:3, 3] for q in (belief.q, state.q)]
    assert np.linalg.norm(tips[0] - tips[1]) < 5e-5


def test_a_mass_that_the_arm_does_not_have_takes_no_inertia_from_other_masses():
    """A point mass at the tip stays as heavy as it is."""
    robot = ROBOT.replace(point_masses=({"place": ROBOT.length, "mass": 0.01},))
    arm, bare = SoftArm(robot), SoftArm(ROBOT)
    filter_, dt, known = Filter(arm, CONFIG), 1e-6, model(-0.004)
    started = belief_of(filter_)
    started.mean[N:] = 0.0
    with_it, without = (filter_.predict(started, P, dt, one)[0].qd / dt for one in (known, LearnedInput()))
    weight = LearnedForce(bare).force(known.learned, Q, 0.0 * QD, 0.0 * QD)
    left = arm.inertia_matrix(Q) @ (with_it - without)
    np.testing.assert_allclose(left, -weight, rtol=2e-3, atol=2e-3 * np.abs(weight).max())


def test_a_step_that_fails_holds_the_arm_and_widens():
    filter_ = Filter(SoftArm(ROBOT), CONFIG)
    started = belief_of(filter_)
    started.mean[0] = -2.0  # a link compressed to less than nothing
    belief, ok = filter_.predict(started, P, DT)
    assert not ok
    np.testing.assert_array_equal(belief.q[1:], Q[1:])
    np.testing.assert_array_equal(belief.qd, 0.0)
    assert (np.diag(belief.covariance) > np.diag(started.covariance))[: 2 * N].all()


def test_one_update_is_that_of_the_textbook():
    filter_ = Filter(SoftArm(ROBOT), CONFIG)
    rng = np.random.default_rng(1)
    started = belief_of(filter_)
    root = np.diag(np.sqrt(np.diag(started.covariance)) * 1e-3) @ rng.normal(size=started.covariance.shape)
    started = started._replace(covariance=root @ root.T)
    pose, jacobian = filter_.arm.pose_and_jacobian(Q, ROBOT.length)
    sample = PoseSample(0.0, pose[:3, 3] + 1e-4, np.array([0.0, 0.0, 0.0, 1.0]), ROBOT.length)
    far = parse({"pose": {"orientation_model_std_rad": 3.0}}, EstimatorConfig, "test")
    filter_ = Filter(SoftArm(ROBOT), far)
    fused = filter_.advance(started, P, 0.0, LearnedInput(), sample)
    assert fused.outcome == FUSED
    H = np.zeros((3, len(started.mean)))
    H[:, :N] = pose[:3, :3] @ jacobian[3:]
    variance = far.pose.position_std_m**2 + far.pose.position_model_std_m**2
    S = H @ started.covariance @ H.T + variance * np.eye(3)
    gain = started.covariance @ H.T @ np.linalg.inv(S)
    covariance = (np.eye(len(H[0])) - gain @ H) @ started.covariance
    residual = sample.position - pose[:3, 3]
    assert fused.position_nis == pytest.approx(residual @ np.linalg.solve(S, residual), rel=1e-9)
    deviation = np.sqrt(np.diag(started.covariance))
    assert np.abs((fused.belief.mean - started.mean - gain @ residual) / deviation).max() < 2e-3
    assert np.abs((fused.belief.covariance - covariance) / np.outer(deviation, deviation)).max() < 2e-3
    np.testing.assert_allclose(
        fused.record[ESTIMATE : ESTIMATE + 3],
        filter_.arm.pose(fused.belief.q, ROBOT.length)[:3, 3],
        rtol=1e-9,
        atol=1e-12,
    )


def test_a_covariance_that_is_not_positive_begins_anew():
    """Rounding under large process noise can make one; its gain would move the mean away from the sample."""
    filter_ = Filter(SoftArm(ROBOT), CONFIG)
    started = belief_of(filter_)
    bad = started._replace(covariance=-started.covariance)
    pose = filter_.arm.pose(Q + 1e-3, ROBOT.length)
    sample = PoseSample(0.0, pose[:3, 3], quaternion_from_matrix(pose[:3, :3]), ROBOT.length)
    after = filter_.advance(bad, P, 0.0, LearnedInput(), sample)
    assert (after.nis < 0.0, after.outcome) == (True, FAILED)
    np.testing.assert_array_equal(after.belief.covariance, filter_.settings.initial)
    np.testing.assert_array_equal(after.belief.mean, 0.0)


@pytest.mark.parametrize("mass", [0.0, 0.02])
def test_noise_of_the_pressures_accelerates_what_the_arm_carries(mass):
    """M^-1 H of the loaded arm times the noise of a reading."""
    filter_, reading_s = Filter(SoftArm(ROBOT), EstimatorConfig(), dt=0.004), 0.004
    started = belief_of(filter_)
    started = started._replace(covariance=np.zeros_like(started.covariance))
    dt = 1e-6
    covariance = filter_.predict(started, P, dt, model(mass))[0].covariance[N : 2 * N, N : 2 * N]
    arm = SoftArm(ROBOT.replace(tip_mass=ROBOT.tip_mass + mass))
    by_p = np.linalg.solve(arm.inertia_matrix(Q), arm.actuation_matrix(Q))
    density = EstimatorConfig().pressure_std_pa ** 2 * reading_s
    np.testing.assert_allclose(covariance / dt, density * by_p @ by_p.T, rtol=1e-2)


def test_a_disturbance_beside_a_learned_force_fades_sooner():
    filter_ = Filter(SoftArm(ROBOT), EstimatorConfig())
    started = belief_of(filter_)
    started.mean[3 * N :] = 0.0
    for known, time_s in (
        (LearnedInput(), 5.0),
        (model(0.0)._replace(share=0.5), 1.0 / 0.725),
        (model(0.0), 0.8),
    ):
        end = filter_.predict(started, P, DT, known)[0].mean
        np.testing.assert_allclose(end[2 * N : 3 * N], np.exp(-DT / time_s) * started.mean[2 * N : 3 * N])


def test_nothing_of_a_call_stays_behind():
    """The same input gives the same bits, whatever was computed in between."""
    filter_ = Filter(SoftArm(ROBOT), CONFIG)
    started, known = belief_of(filter_), model(0.01, 1.0)
    first = filter_.predict(started, P, DT, known)[0]
    for other in (model(-0.01, 2.0), LearnedInput()):
        filter_.predict(belief_of(filter_, 2.0 * started.mean), 2.0 * P, DT, other)
    again = filter_.predict(started, P, DT, known)[0]
    assert first.mean.tobytes() == again.mean.tobytes()
    assert first.covariance.tobytes() == again.covariance.tobytes()
    assert filter_.arm.tables.tip_mass[0] == ROBOT.tip_mass
