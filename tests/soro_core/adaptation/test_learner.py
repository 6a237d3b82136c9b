"""The learner against arms whose missing force is known, and against bad samples."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.adaptation import Learned, LearnedForce, Learner, LearnerSample
from soro_core.adaptation.config import LearnerConfig
from soro_core.config import find_config
from soro_core.robot.parts import fields

ROBOT = load_robot(find_config("tue_three_bellow", "robots"))
ARM = SoftArm(ROBOT)
N = ARM.n_q
# Mass, W, damping of stretch and bend.
SIZE = 1 + N * (N + 1) + 2
DT = 0.005
SPREAD = np.array([0.03, 6.0, 6.0])


def config(**keys):
    return LearnerConfig(**keys)


def sample(seed_q, seed_v, theta, seed_a=0.0, **changes):
    """A sample on the arm with a learned force that is true."""
    q, qd = np.array([0.06, 0.0, 0.0]) + SPREAD * seed_q, SPREAD * seed_v
    qdd = SPREAD * seed_a
    force = LearnedForce(ARM).force(Learned(theta), q, qd, qdd)
    force += ARM.inverse_dynamics(q, qd, qd, qdd) + ARM.elastic_force(q) + ARM.damping_force(q, qd)
    pressure = np.linalg.solve(ARM.actuation_matrix(q), force)
    none = np.zeros(ARM.n_internal)
    made = LearnerSample(q, qd, pressure, none, np.diag([1e-4, 0.04, 0.04]) ** 2)
    return replace(made, **changes)


def circle(k, theta, **changes):
    """A sample of a motion that goes round, and up and down at another rate."""
    a, b = 2e-2 * k, 0.7e-2 * k
    return sample(np.array([np.sin(b), np.cos(a), np.sin(a)]), np.zeros(N), theta, **changes)


def learn(learner, theta, ticks, state=None, **changes):
    state = state or learner.initial_state()
    for k in range(ticks):
        state = learner.step(state, circle(k, theta, **changes), DT)
    return state


def all_learned(learner, state, one):
    """The force of all that is learned, at a sample."""
    of_load = learner.force.force(state.learned, one.q, one.qd, np.zeros(N))
    return of_load + learner.chambers.force(state.chambers, one.q, one.pressure_pa)[0]


def true_model():
    weights = 0.3 * np.random.default_rng(1).standard_normal((N, N + 1))
    return np.concatenate([[0.02], weights.ravel(), np.zeros(2)])


def test_the_force_of_the_mass_is_that_of_a_heavier_arm():
    heavier = SoftArm(ROBOT.replace(tip_mass=ROBOT.tip_mass + 0.02))
    rng = np.random.default_rng(3)
    q, qd, a = (SPREAD * x for x in rng.standard_normal((3, N)))
    expected = heavier.inverse_dynamics(q, qd, qd, a) - ARM.inverse_dynamics(q, qd, qd, a)
    learned = Learned(np.concatenate([[0.02], np.zeros(SIZE - 1)]))
    np.testing.assert_allclose(LearnedForce(ARM).force(learned, q, qd, a), expected, rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_it_learns_the_force_that_acts():
    learner = Learner(ARM, config(noise=0.01, forget_s=1e3))
    theta = true_model()
    state = learn(learner, theta, 1600)
    # Mass, weights and chambers overlap: what counts is their force where the arm has been.
    for k in (1000, 1300, 1590):
        one, none = circle(k, theta), np.zeros(N)
        wanted = learner.force.force(Learned(theta), one.q, one.qd, none)
        assert np.abs((all_learned(learner, state, one) - wanted) / learner.force.scales.force).max() < 0.05
    deviations = learner.deviations(state)
    assert (deviations < learner.deviations(learner.initial_state()) + 1e-12).all()


def test_what_samples_do_not_determine_stays_at_the_prior():
    learner = Learner(ARM, config(forget_s=1e3))
    state = learner.initial_state()
    still = sample(np.array([0.0, 1.0, 0.0]), np.zeros(N), true_model())
    for _ in range(1000):
        state = learner.step(state, still, DT)
    before, after = (learner.deviations(x) for x in (learner.initial_state(), state))
    # Bending about y is 0 all the time: its columns say nothing.
    columns = 1 + np.arange(N) * (N + 1) + 3
    np.testing.assert_allclose(after[columns], before[columns], rtol=1e-6)
    np.testing.assert_allclose(state.learned.theta[columns], 0.0, atol=1e-9)


def test_without_positions_the_mass_follows_the_tracking_error_and_weights_are_forgotten():
    learner = Learner(ARM, config(forget_s=0.5))
    taught = learn(learner, true_model(), 200)
    state = taught
    for _ in range(300):
        state = learner.follow(state, -1e-3, DT)
    assert np.abs(state.learned.theta[1:]).max() < 0.1 * np.abs(taught.learned.theta[1:]).max()
    assert state.learned.mass_kg > taught.learned.mass_kg
    gained = state.learned.mass_kg - taught.learned.mass_kg
    assert gained == pytest.approx(300 * DT * 1e-3 * learner.mass_rate)
    for _ in range(3000):
        state = learner.follow(state, -1.0, DT)
    assert state.learned.mass_kg == learner.config.mass_upper_kg


@pytest.mark.parametrize("field", ["q", "qd", "pressure_pa", "covariance"])
@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_sample_that_is_not_finite_is_counted_and_the_last_model_kept(field, number):
    learner = Learner(ARM, config())
    state = learn(learner, true_model(), 200)
    bad = np.array(getattr(circle(200, true_model()), field))
    bad.flat[0] = number
    after = learner.step(state, circle(200, true_model(), **{field: bad}), DT)
    assert after.refused == 1
    assert after.note
    assert after.learned is state.learned
    np.testing.assert_array_equal(after.information, state.information)
    assert learner.step(after, circle(201, true_model()), DT).note == ""


def test_what_is_learned_beside_a_mass_at_its_bound_is_solved_for_that_mass():
    """And no prior is restored, however long it stays there."""
    learner = Learner(ARM, config(mass_upper_kg=0.01, forget_s=1e3, weight_std=5.0))
    theta = np.zeros(SIZE)
    theta[0] = 0.016
    state, masses, notes = learner.initial_state(), [], []
    for k in range(500):
        state = learner.step(state, circle(k, theta), DT)
        masses.append(state.learned.mass_kg)
        notes.append(state.note)
    assert max(masses) == masses[-1] == 0.01
    assert state.restored == 0
    named = next(k for k, note in enumerate(notes) if "bound, 10 g" in note)
    assert named - masses.index(0.01) == pytest.approx(1.0 / DT, abs=2)
    # The rest of the load is in W: what is missing is the force of the whole mass.
    one, force = circle(499, theta), learner.force
    wanted, alone = (
        force.force(Learned(np.concatenate([[mass], np.zeros(SIZE - 1)])), one.q, one.qd, np.zeros(N))
        for mass in (0.016, 0.01)
    )
    missing = np.abs(wanted - all_learned(learner, state, one)) / force.scales.force
    without = np.abs(wanted - alone) / force.scales.force
    print(f"missing {missing.max():.2f} units of force, with the mass alone {without.max():.2f}")
    assert missing.max() < 0.2 * without.max()


def test_masses_that_are_not_stated_are_parts_of_the_arm():
    links = ROBOT.replace(links=[{**fields(ROBOT.links[0]), "mass": 0.17}])
    light, heavy = (Learner(SoftArm(robot), config()).config for robot in (ROBOT, links))
    assert light.mass_upper_kg == pytest.approx(0.102)  # 100 g is what the arm was tuned with
    assert heavy.mass_upper_kg == pytest.approx(10.0 * light.mass_upper_kg)
    assert heavy.mass_std_kg == pytest.approx(10.0 * light.mass_std_kg)
    assert heavy.mass_lower_kg == pytest.approx(10.0 * light.mass_lower_kg)
    stated = Learner(ARM, config(mass_upper_kg=0.05)).config
    assert (stated.mass_upper_kg, stated.mass_std_kg) == (0.05, light.mass_std_kg)


def test_the_noise_is_that_of_a_pressure():
    assert Learner(ARM, config()).config.noise == pytest.approx(0.32, rel=0.02)
    weak = SoftArm(ROBOT.scaled(stiffness=1.0, damping=1.0, gain=0.5))
    assert Learner(weak, config()).config.noise == pytest.approx(0.16, rel=0.02)
    assert Learner(weak, config(noise=0.2)).config.noise == 0.2


def test_a_residual_that_the_doubt_about_q_explains_is_no_reason_to_forget():
    learner, theta = Learner(ARM, config()), true_model()
    known = learn(learner, theta, 400)
    other = theta.copy()
    other[1 + 2 * (N + 1)] += 5.0  # of bending_y, at once
    sure = learn(learner, other, 40, known)
    doubt = np.diag([1e-4, 0.04, 20.0]) ** 2  # bending_y is not known at all
    unsure = learn(learner, other, 40, known, covariance=doubt)
    kept = slice(1, 1 + 2 * (N + 1))  # of the other rows
    assert np.trace(unsure.information[kept, kept]) > 1.2 * np.trace(sure.information[kept, kept])


def test_samples_that_fit_badly_count_less():
    learner, theta = Learner(ARM, config(forget_s=1e4, mass_walk_per_s=0.0)), true_model()
    known, other = learn(learner, theta, 400), theta.copy()
    other[1 : SIZE - 2 : N + 1] += 5.0  # each offset, at once
    found = (learn(learner, which, 40, known).information - known.information for which in (theta, other))
    fitting, misfitting = (np.trace(gained[1:, 1:]) for gained in found)
    assert misfitting < 0.5 * fitting


def test_singular_information_restores_the_prior():
    learner = Learner(ARM, config())
    state = learn(learner, true_model(), 100)
    nothing = np.zeros_like(state.information)
    singular = replace(state, information=nothing, prior=nothing)
    object.__setattr__(learner, "_prior", lambda *of: nothing)
    still = sample(np.zeros(N), np.zeros(N), true_model())
    after = learner.step(replace(singular, residual=None, regressor=None), still, DT)
    assert after.restored == 1
    assert after.note
    assert not after.learned.theta.any()


def test_the_same_samples_give_the_same_bits():
    one, two = (learn(Learner(ARM, config()), true_model(), 300) for _ in range(2))
    assert one.learned.theta.tobytes() == two.learned.theta.tobytes()


@pytest.mark.slow
def test_a_load_that_falls_off_is_found_at_once_and_w_stays():
    """And W, which explains a part of the load meanwhile, is left alone."""
    true = true_model()
    true[1:] *= 0.3
    fallen = true.copy()
    fallen[0] = 0.0
    masses, weights = [], []
    for walk in (LearnerConfig().mass_walk_per_s, 0.0):
        learner = Learner(ARM, config(mass_walk_per_s=walk))
        known = learn(learner, true, 1200)
        after = learn(learner, fallen, 160, known)
        masses.append(abs(after.learned.mass_kg))
        weights.append(np.abs(after.learned.theta - known.learned.theta)[1:].max())
    print(f"0.8 s after 20 g are gone: {1e3 * masses[0]:.2f} g, without a walk {1e3 * masses[1]:.2f} g")
    assert masses[0] < 0.2 * masses[1]
    assert weights[0] < 0.5 * weights[1]


@pytest.mark.slow
def test_an_acceleration_is_no_missing_force():
    """Of the arm, whatever its reference does: it swings at 4 Hz."""
    learner = Learner(ARM, config(forget_s=1e3))
    state, rate = learner.initial_state(), 25.0
    none = np.zeros(SIZE)
    ahead = np.array([0.3, 0.0, 1.0])
    for k in range(1200):
        at = rate * DT * k + ahead
        moves = (0.3 * np.sin(at), 0.3 * rate * np.cos(at), none, -0.3 * rate**2 * np.sin(at))
        state = learner.step(state, sample(*moves), DT)
    made = all_learned(learner, state, sample(*moves)) / learner.force.scales.force
    print(f"learned where nothing is missing: {np.abs(made).max():.3f} units of force")
    assert np.abs(made).max() < 0.05


def test_gains_that_are_not_finite_start_nothing():
    learner = Learner(ARM, config())
    known = np.full(3, 0.01)
    far, unknown = np.array([-0.4, 0.2, 0.2]), np.array([-0.4, np.nan, 0.2])
    np.testing.assert_allclose(learner.state_with_gains(far, known).chambers[:3], far)
    assert not learner.state_with_gains(unknown, known).chambers.any()
