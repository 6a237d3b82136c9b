"""The external force at the tip: found on an arm of another structure, told in stages, learned around."""

import numpy as np
import pytest
from scipy.optimize import root

from soro_core import SoftArm, load_robot
from soro_core.adaptation.config import LearnerConfig
from soro_core.adaptation.force import LearnedForce
from soro_core.adaptation.learned import Learned
from soro_core.adaptation.learner import Learner
from soro_core.adaptation.learning.state import LearnerSample
from soro_core.config import with_changes
from soro_core.control import Controller, ControllerConfig
from soro_core.control.reference.trajectory import Hold
from soro_core.estimation import Estimator, EstimatorConfig
from soro_core.estimation.force.average import NoisyForce, averaged, axes_of, covariance_of
from soro_core.estimation.force.before import Before, read
from soro_core.estimation.force.config import ForceConfig
from soro_core.estimation.force.observer import ForceObserver, Noise
from soro_core.estimation.force.stage import ForceSeen, StageState, next_stage
from soro_core.estimation.force.state import ForceState, Seen
from soro_core.estimation.force.tip_balance import Measured, TipBalancer
from soro_core.estimation.learned_input import LearnedInput
from soro_core.frozen import replaced
from soro_core.loop import Loop
from soro_core.twin import Twin, TwinConfig
from tests.soro_core.loop.arms import BY_NAME
from tests.soro_core.loop.loop_harness import Harness, Setup

ROBOT = load_robot("tue_three_bellow")
ARM = SoftArm(ROBOT)
STILL = np.zeros(ARM.n_q)
PRESSURE = np.array([40e3, 10e3, 25e3])
GRAVITY = np.array([0.0, 0.0, -9.81])
SURE = np.diag([4e-3, 4e-3, 50e-3]) ** 2
DT = 0.02


def rest(arm, pressure, force):
    """Coordinates at rest under pressures and a force at the tip."""

    def unbalanced(q):
        pose, jacobian = arm.pose_and_jacobian(q, arm.length)
        own = arm.gravity_force(q) + arm.elastic_force(q) - arm.pressure_force(q, pressure)
        return (own - jacobian[3:].T @ pose[:3, :3].T @ force) / scale

    scale = np.diag(arm.stiffness_matrix(np.zeros(arm.n_q)))
    return root(unbalanced, np.zeros(arm.n_q), tol=1e-11).x


def balance(force, mass_kg=0.0, shift=0.0, pieces=8):
    """Force that the balance finds on an arm of twelve pieces with a mass at its tip, and the tip's pose."""
    true = SoftArm(ROBOT.replace(tip_mass=ROBOT.tip_mass + mass_kg).refine(12))
    x = rest(true, PRESSURE, np.asarray(force))
    still, theta = np.zeros(ARM.n_q), np.zeros(15)
    theta[0] = mass_kg
    tip = true.pose(x, true.length)
    position = tip[:3, 3] + shift
    seen = Measured(position, PRESSURE, still, still, still)
    found = TipBalancer(ARM, 1, pieces).step(None, seen, theta, ARM.length, x.reshape(12, 3).mean(axis=0))
    return found, tip[:3, :3]


@pytest.mark.parametrize("force", [(0.1, 0.0, 0.0), (-0.05, 0.15, 0.02), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("mass_kg", [0.0, 0.02])
def test_a_force_at_the_tip_is_that_of_a_finer_arm(force, mass_kg):
    found, tip = balance(force, mass_kg)
    error = tip.T @ (found.force_n - force)
    assert np.linalg.norm(error[:2]) < max(0.02 * np.linalg.norm(force), 1e-3)  # the third is along the arm


def test_one_constant_strain_would_take_the_uneven_bend_for_another_force():
    force = np.array([0.2, 0.0, 0.0])
    coarse, fine = (np.linalg.norm(balance(force, pieces=n)[0].force_n - force) for n in (1, 4))
    assert fine < 0.2 * coarse


def test_the_derivative_by_the_position_is_that_of_differences():
    force, step = (0.1, 0.0, 0.0), np.array([1e-5, 0.0, 0.0])
    middle, ahead, back = (balance(force, shift=s)[0] for s in (np.zeros(3), step, -step))
    slope = (ahead.force_n - back.force_n) / 2e-5
    # The balance leaves out how the force on the arm changes as the arm turns under it.
    assert np.abs(slope - middle.by_position[:, 0]).max() < 0.2 * np.abs(middle.by_position[:, 0]).max()


def after(seconds, force, load_kg=0.02, acceleration=0.0, state=None, gravity=GRAVITY):
    state = StageState(usual=1.0) if state is None else state
    pair = np.asarray(force), SURE
    for _ in range(round(seconds / DT)):
        state = next_stage(state, ForceSeen(pair, pair, pair, gravity, load_kg, 0.01, acceleration), DT)
    return state


def test_a_lateral_force_is_an_outside_force_within_a_tenth_and_a_contact_within_half_a_second():
    assert after(0.1, (0.03, 0.0, 0.0)).stage == "outside force"
    assert after(0.5, (0.03, 0.0, 0.0)).stage == "contact"


@pytest.mark.parametrize(
    ("force", "load_kg"), [((-0.196, 0.0, 0.0), 0.0), ((0.19, 0.0, 0.0), 0.02), ((-0.3, 1e-3, 2e-3), 0.0)]
)
def test_a_load_on_a_level_arm_is_soon_learned_with_all_else(force, load_kg):
    level = np.array([-9.81, 0.0, 0.0])
    state = after(0.1, force, load_kg, gravity=level)
    assert state.stage == "outside force"
    for _ in range(50):
        state = after(0.1, force, load_kg, state=state, gravity=level)
        if state.outside_s > 0.3:
            assert state.stage == "free"
    assert state.stage == "free"


@pytest.mark.parametrize("force", [(0.0, 0.0, 6.0), (0.0, 0.0, -0.5), (2e-3, -3e-3, 1.0)])
def test_what_pulls_along_the_backbone_stops_no_learning(force):
    """There an error of stiffness, gain or damping looks like a force of any size."""
    state = StageState(usual=1.0)
    for _ in range(100):
        state = after(0.1, force, state=state)
        assert state.stage == "free"


@pytest.mark.slow
def test_a_balance_that_jumps_is_found_again_or_given_up():
    still, theta = np.zeros(ARM.n_q), np.zeros(15)
    balancer, q = TipBalancer(ARM, 1, 8), np.array([0.05, 4.0, -3.0])

    def at(q, before):
        seen = Measured(ARM.pose(q, ARM.length)[:3, 3], PRESSURE, still, still, still)
        return balancer.step(before, seen, theta, ARM.length, q)

    far = np.array([0.1, -6.0, 5.0])
    fresh, followed = at(far, None), at(far, at(q, None))
    assert followed is None or np.allclose(followed.force_n, fresh.force_n, atol=1e-3)


def learned_at(q, force):
    """A force that is learned at coordinates, as one that is the same everywhere; and 10 g."""
    learned = LearnedForce(ARM)
    theta = np.zeros(learned.size)
    theta[0] = 0.01
    more = force - 0.01 * ARM.tip_mass_force(q, STILL, STILL)
    return learned, Learned(theta).with_force(q, more, np.zeros((q.size, q.size)), learned.scales).theta


def test_what_is_learned_is_read_as_a_modulus_and_a_load_that_hold_where_the_arm_has_not_been():
    def true(q):
        return 0.3 * ARM.elastic_force(q) + 0.015 * ARM.tip_mass_force(q, STILL, STILL)

    q, other = np.array([0.05, 4.0, -3.0]), np.array([0.05, 7.0, 1.0])
    learned, theta = learned_at(q, true(q))
    found = read(learned, Before(0.0, theta, q), 100.0)
    assert found.modulus == pytest.approx(1.3, abs=0.02)
    assert found.load_kg == pytest.approx(0.015, abs=1e-3)

    def off(theta, modulus, at):
        force = learned.force(Learned(theta), at, STILL, STILL) + (modulus - 1.0) * ARM.elastic_force(at)
        return np.linalg.norm(force - true(at))

    assert off(found.theta_of(theta), found.modulus, q) < 1e-6 * np.linalg.norm(true(q))
    assert off(found.theta_of(theta), found.modulus, other) < 0.1 * off(theta, 1.0, other)


def test_what_no_modulus_and_no_load_explain_stays_as_it_is_learned():
    q = np.array([0.05, 4.0, 0.0])
    learned, theta = learned_at(q, ARM.elastic_force(np.array([0.0, 0.0, 2.0])))
    found = read(learned, Before(0.0, theta, q), 100.0)
    assert (found.modulus, found.load_kg) == (1.0, 0.01)
    assert np.array_equal(found.theta_of(theta), theta)


@pytest.mark.parametrize(("load_kg", "stage"), [(0.2, "free"), (0.0, "contact")])
def test_no_more_load_can_go_than_there_is(load_kg, stage):
    """Beside doubt along the backbone, a load that goes would explain any push to the side of a bent arm."""
    along = np.array([0.5, 0.0, 0.85])
    covariance = 1e-6 * np.eye(3) + 0.2**2 * np.outer(along, along)
    state, pair = StageState(usual=1.0), (np.array([-0.05, 0.0, 0.0]), covariance)
    for _ in range(25):
        state = next_stage(state, ForceSeen(pair, pair, pair, GRAVITY, load_kg, 0.01, 0.0), DT)
    assert state.stage == stage


def test_a_load_that_swings_is_no_contact():
    assert after(0.5, (0.05, 0.0, -0.2), acceleration=5.0).stage == "outside force"
    assert after(0.5, (0.05, 0.0, -0.2), acceleration=0.0).stage == "contact"


# A bent arm: its chord, along which little is known, leans in the plane of gravity.
CHORD = np.array([0.3, 0.0, -0.954])
BENT = 2e-3**2 * np.eye(3) + 0.06**2 * np.outer(CHORD, CHORD)


def bent(seconds, force, covariance=BENT, state=None, moves=False, acceleration=0.0):
    state, pair = state or StageState(usual=1.0), (np.asarray(force), covariance)
    for _ in range(round(seconds / DT)):
        state = next_stage(state, ForceSeen(pair, pair, pair, GRAVITY, 0.02, 0.01, acceleration, moves), DT)
    return state


def test_a_push_in_the_plane_of_gravity_is_not_taken_for_a_load():
    """What a load leaves of it is within its deviations, but the load would pull down much more."""
    doubtful = 4.0 * BENT
    assert bent(0.1, (0.05, 0.0, 0.0), doubtful).stage == "outside force"
    assert bent(5.0, (0.05, 0.0, 0.0), doubtful).stage == "outside force"
    assert bent(0.6, (0.05, 0.0, 0.0), 0.25 * BENT).stage == "contact"
    assert bent(0.4, (0.0, 0.0, -0.15)).stage == "free"


def test_what_stays_undecided_while_the_arm_moves_is_learned():
    assert bent(3.0, (0.05, 0.0, 0.0), 4.0 * BENT, moves=True).stage == "free"


def test_no_load_is_told_from_a_swing_whose_inertia_would_make_the_same_force():
    load = (-0.012, 0.0, -0.07)
    assert bent(0.5, load).stage == "free"
    assert bent(0.5, load, acceleration=6.0).stage == "outside force"


def test_the_mass_of_a_new_force_waits_until_a_load_is_likelier_or_may_have_gone():
    assert bent(0.08, (0.0, 0.0, -0.15)).mass_free
    assert bent(0.08, (0.0, 0.0, 0.15)).mass_free
    assert not bent(0.3, (-0.05, 0.0, 0.0), 4.0 * BENT).mass_free
    assert bent(0.8, (-0.05, 0.0, 0.0), 4.0 * BENT).mass_free


def test_the_mass_of_before_a_push_is_told_when_it_has_gone():
    state = bent(0.3, (0.05, 0.0, 0.0), 4.0 * BENT)
    assert (state.stage, state.mass_free) == ("outside force", True)
    while state.stage != "free":
        state = bent(DT, (0.0, 0.0, 0.0), state=state)
        assert not (state.stage == "free" and state.mass_free)
    assert bent(0.2, (0.0, 0.0, 0.0), state=state).mass_free
    load = bent(0.4, (0.0, 0.0, -0.15))
    assert (load.stage, load.mass_free) == ("free", True)


def test_a_force_that_begins_does_not_become_usual():
    assert after(0.1, (0.2, 0.0, 0.0)).doubt == 1.0


def test_noise_along_the_chord_does_not_reach_what_is_across_it():
    density = 1e-2 * (2e-3**2 * np.eye(3) + 0.2**2 * np.outer(CHORD, CHORD))
    axes = axes_of(density)
    rng, root, found, average = np.random.default_rng(1), np.linalg.cholesky(density / DT), [], None
    for k in range(400):
        true = np.array([0.1 if k >= 200 else 0.0, 0.0, 0.0])
        average = averaged(average, NoisyForce(true + root @ rng.standard_normal(3), axes, 0.0), 8.0, DT)
        found.append(average.force_n - true)
    tip = np.array([0.95, 0.0, 0.3])  # across the tip, not across the chord
    assert np.abs(np.array(found[100:200]) @ tip).max() < 2e-3
    assert np.abs(np.array(found[205:]) @ tip).max() < 12e-3
    kept = covariance_of(average, axes.weak)
    assert np.sqrt(CHORD @ kept @ CHORD) > 5.0 * np.sqrt(kept[1, 1])


def test_what_the_model_misses_all_the_time_is_no_force_from_outside():
    state = StageState()
    for k in range(1000):
        t = DT * k
        pair = 0.05 * min(1.0, t / 4.0) * np.array([np.cos(1.6 * t), np.sin(1.6 * t), 0.0]), SURE
        state = next_stage(state, ForceSeen(pair, pair, pair, GRAVITY, 0.0, 0.01, 0.0), DT)
        assert state.stage != "contact"
    assert state.stage == "free"
    assert state.doubt > 10.0


def test_the_stage_ends_with_the_force():
    state = after(0.6, (0.06, 0.0, 0.0))
    assert state.stage == "contact"
    assert after(0.6, (0.0, 0.0, 0.0), state=state).stage == "free"


@pytest.mark.parametrize("stage", ["outside force", "contact"])
def test_the_learner_keeps_what_it_knew_before_the_push(stage):
    learner = Learner(ARM, LearnerConfig())
    state = learner.initial_state()
    q = np.array([0.05, 4.0, -3.0])
    pushed = np.array([0.0, 2e-3, 0.0])  # what a push adds to the bend, as a pressure cannot
    needed = ARM.gravity_force(q) + ARM.elastic_force(q) + 0.01 * ARM.tip_mass_force(q, 0 * q, 0 * q)

    def sample(extra, name):
        pressure = np.linalg.solve(ARM.actuation_matrix(q), needed + extra)
        return LearnerSample(q, 0 * q, pressure, np.zeros(ARM.n_internal), 1e-8 * np.eye(3), stage=name)

    for _ in range(400):
        state = learner.step(state, sample(0.0, "free"), 0.005)
    known = state
    for _ in range(10):  # before the stage is known
        state = learner.step(state, sample(pushed, "free"), 0.005)
    for _ in range(40):
        state = learner.step(state, sample(pushed, "outside force"), 0.005)
    assert np.abs(state.learned.theta[1:] - known.learned.theta[1:]).max() < 2e-3
    for _ in range(40):
        state = learner.step(state, sample(pushed, stage), 0.005)
    if stage == "contact":
        assert abs(state.learned.mass_kg - known.learned.mass_kg) < 1e-4
    for _ in range(200):  # the information still fits: the learner goes on from there
        state = learner.step(state, sample(0.0, "free"), 0.005)
    assert state.restored == 0


class Pushed:
    """A stepper with a force on the tip, held in the world within each step."""

    def __init__(self, stepper, arm):
        self.stepper, self.arm, self.force = stepper, arm, np.zeros(3)

    def step(self, state, pressure, dt):
        wrench = np.zeros(6)
        wrench[3:] = self.arm.pose(state.q, self.arm.length)[:3, :3].T @ self.force
        return self.stepper.step(state, pressure, dt, wrench=wrench)


def held(ticks, push=None, enabled=True, payload_kg=0.02, rest_s=np.inf):
    """The loop on an arm of four pieces, that circles until a time [s] and is pushed from another on."""
    setup = Setup(payload_kg=payload_kg)
    plant = Harness(ROBOT, setup)
    world = plant.initial()
    plant.stepper = Pushed(plant.stepper, plant.arm)
    config = EstimatorConfig(force={"enabled": enabled})
    control = with_changes(ControllerConfig(law="composite"), reference={"curvature_per_m": 6.0})
    loop = Loop(Estimator(ROBOT, config), Controller(ROBOT, control))
    state, setpoint, found, reference = loop.initial_state(), np.zeros(3), [], None
    for k in range(ticks):
        if k:
            world = plant.step_setpoints(world, setpoint)
        plant.stepper.force = np.zeros(3) if push is None or k * setup.dt < push[0] else np.asarray(push[1])
        world, seen = plant.observe(world)
        state, estimate, command = loop.step(
            state, seen.reading_pa, seen.poses, seen.imus, setup.dt, reference
        )
        if k * setup.dt > rest_s and reference is None:
            reference = Hold(estimate.q)
        if command.status.ok:
            setpoint = command.setpoint_pa
        tip = plant.arm.pose(world.body.q, plant.arm.length)[:3, 3]
        found.append((k * setup.dt, estimate, tip, command.setpoint_pa))
    return found


@pytest.mark.slow
def test_commands_are_the_same_to_the_bit_while_nothing_pushes():
    seen, blind = held(300), held(300, enabled=False)
    assert seen[-1][1].external is not None
    assert blind[-1][1].external is None
    assert {one.external.stage for _, one, _, _ in seen[2:] if one.external} == {"free"}
    assert all((a[3] == b[3]).all() for a, b in zip(seen, blind, strict=True))


def test_an_unknown_load_at_the_start_is_no_force_from_outside():
    """That would teach the law nothing but the load, and leave the tip half a millimetre off."""
    robot, setup = BY_NAME["asu_two_segment, 100 g, pose at the tip"].ready(duration_s=1.0)
    loop = Loop(Estimator(robot, setup.estimation), Controller(robot, setup.control))
    ticks = list(loop.run(Harness(robot, setup), 200, setup.dt, delay=setup.command_delay))
    assert {tick.estimate.external.stage for tick in ticks if tick.estimate.external} == {"free"}


def test_a_push_on_a_circling_arm_is_found_and_taken_into_the_filter():
    push = np.array([0.1, 0.0, 0.0])
    found = held(1800, (6.0, push))
    stages = [(t, one.external.stage) for t, one, _, _ in found if one.external]
    assert {stage for t, stage in stages if t < 6.0} == {"free"}
    assert next(t for t, stage in stages if stage == "outside force") - 6.0 < 0.15
    assert next(t for t, stage in stages if stage == "contact") - 6.0 < 1.2
    late = [(one, tip) for t, one, tip, _ in found if t > 7.5]
    errors = np.array([one.external.force_n - push for one, _ in late])
    # Along the backbone, the third axis of the tip, little is known.
    sideways = np.array(
        [one.tip_pose[:3, :2].T @ error for (one, _), error in zip(late, errors, strict=True)]
    )
    assert np.sqrt((sideways**2).sum(axis=1).mean()) < 12e-3
    misses = np.array([one.tip_pose[:3, 3] - tip for one, tip in late])
    assert np.abs(misses.mean(axis=0)).max() < 0.6e-3


def test_a_push_on_a_bent_arm_at_rest_is_told_at_once_and_stays():
    push = np.array([0.1, 0.0, 0.0])  # in the plane of gravity and of the bend: it may be a load
    found = held(1500, (5.0, push), payload_kg=0.0, rest_s=4.0)
    late = [(one, tip) for t, one, tip, _ in found if t > 6.0]
    across = [one.tip_pose[:3, :2].T @ (one.external.force_n - push) for one, _ in late]
    assert np.linalg.norm(np.mean(across, axis=0)) < 6e-3
    early = [one.external.force_n[0] for t, one, _, _ in found if 5.3 < t < 6.0]
    assert 0.05 < min(early) <= max(early) < 0.15
    assert "contact" in {one.external.stage for one, _ in late}


def test_the_doubt_about_the_scale_is_that_of_the_robot_file_where_a_weight_has_shown_it():
    def std(robot, **keys):
        return ForceObserver(SoftArm(robot), ForceConfig(**keys), 1, Noise(3e-4, 100.0))._gain_std

    weighed, doubtful = (
        ROBOT.replace(calibration=ROBOT.calibration.model_copy(update={"gain_std": found}))
        for found in (0.004, 0.3)
    )
    assert (std(ROBOT), std(weighed), std(doubtful), std(weighed, gain_std=0.0)) == (0.03, 0.004, 0.03, 0.0)


def test_positions_of_two_places_are_not_mixed():
    """A tip that is seen less often than the middle of the arm."""
    robot = load_robot("tue_three_bellow")
    twin = Twin(robot, TwinConfig(pose={"locations": (0.5, 1.0), "rate_hz": 200.0}))
    estimator, world, found = Estimator(robot), twin.initial(), []
    state = estimator.initial_state()
    for k in range(400):
        world = twin.step_setpoints(world, PRESSURE) if k else world
        world, seen = twin.observe(world)
        poses = [one for one in seen.poses if one.s < estimator.length or k % 12 == 0]
        state, estimate = estimator.step(state, seen.reading_pa, poses, (), twin.dt)
        if k > 300 and estimate.external is not None:
            found.append(estimate.external.force_n[:2])
    assert np.max(np.abs(found)) < 0.05


def test_a_balance_that_no_arm_can_have_is_no_estimate(monkeypatch):
    observer = ForceObserver(ARM, ForceConfig(), 1, Noise(1e-4, 100.0))
    seen = Seen(0.1, ARM.pose(STILL, ARM.length)[:3, 3], PRESSURE, STILL, STILL, np.zeros(ARM.n_internal))
    state = observer.step(ForceState(), [seen], ARM.length, LearnedInput(), 0.1)
    assert state.external is not None
    crushed = replaced(state.balance, x=np.tile([-1.5, 0.0, 0.0], 8))
    monkeypatch.setattr(observer.balancer, "step", lambda *_: crushed)
    later = seen._replace(stamp_s=0.12)
    assert observer.step(state, [later], ARM.length, LearnedInput(), 0.12).external is None


@pytest.mark.parametrize("force_n", [[50.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
def test_a_force_that_no_such_arm_could_bear_is_no_estimate(monkeypatch, force_n):
    """Where an arm leans on something all along, its balances are those of any force at the tip."""
    observer = ForceObserver(ARM, ForceConfig(), 1, Noise(1e-4, 100.0))
    seen = Seen(0.1, ARM.pose(STILL, ARM.length)[:3, 3], PRESSURE, STILL, STILL, np.zeros(ARM.n_internal))
    state = observer.step(ForceState(), [seen], ARM.length, LearnedInput(), 0.1)
    assert state.external is not None
    pushed = replaced(state.balance, force_n=np.array(force_n))
    monkeypatch.setattr(observer.balancer, "step", lambda *_: pushed)
    assert (
        observer.step(state, [seen._replace(stamp_s=0.12)], ARM.length, LearnedInput(), 0.12).external is None
    )


@pytest.mark.parametrize(("load_kg", "is_read"), [(-0.0095, True), (0.02, False)])
def test_a_load_below_zero_is_read_as_a_stiffness_in_free_air(monkeypatch, load_kg, is_read):
    """On a circle a stiffer arm looks like a lighter one; a load bends the finer arm where none is."""
    observer = ForceObserver(ARM, ForceConfig(), 1, Noise(1e-4, 100.0))
    q, theta, asked = np.array([0.08, 6.0, 0.0]), np.zeros(observer.force.size), []
    theta[0], theta[2] = load_kg, 2.5  # the load, and how the force along the arm grows with the elongation
    balance = observer.balancer.step
    monkeypatch.setattr(
        observer.balancer, "step", lambda *known: (asked.append((known[2], known[5])), balance(*known))[1]
    )
    seen = Seen(0.1, ARM.pose(q, ARM.length)[:3, 3], PRESSURE, q, STILL, np.zeros(ARM.n_internal))
    observer.step(ForceState(), [seen], ARM.length, LearnedInput(Learned(theta), share=1.0), 0.1)
    ((told, modulus),) = asked
    if is_read:
        assert modulus > 1.1
        assert told[0] > 0.5 * load_kg
    else:
        assert (modulus, told.tolist()) == (1.0, theta.tolist())
