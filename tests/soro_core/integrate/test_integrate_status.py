"""What a stepper says when it cannot: input that is not finite, explicit ones on stiff arms, collapse."""

import numpy as np
import pytest
from rods import EXPLICIT, bellows, bent, rod

from soro_core import SoftArm, load_robot, simulate, simulate_many
from soro_core.config import find_config
from soro_core.integrate import STEPPERS, State, make_stepper
from tests.collapsing_arm import collapsing_arm

BAD = (np.nan, np.inf, -np.inf)


@pytest.mark.parametrize("name", STEPPERS)
@pytest.mark.parametrize("bad", BAD)
def test_input_that_is_not_finite_is_a_status_and_the_state_stays(name, bad):
    arm = bellows(
        creep=[{"tau": 0.03, "stiffness": [30.0, 2e-3, 2e-3]}],
        hysteresis=[{"stiffness": [20.0, 1e-3, 1e-3], "range": [0.02, 3.0, 3.0]}],
    )
    stepper = make_stepper(name, arm)
    good = stepper.initial_state([0.02, 3.0, 1.0])
    p, w = np.zeros(3), np.zeros(6)
    poisoned = np.array([0.0, bad, 0.0])
    cases = [
        (good, poisoned, w, "a pressure or wrench is not finite; check the source"),
        (good, p, np.array([0, 0, 0, bad, 0, 0]), "a pressure or wrench is not finite; check the source"),
        (State(poisoned, good.qd, good.internal), p, w, "the state is not finite"),
        (State(good.q, poisoned, good.internal), p, w, "the state is not finite"),
        (State(good.q, good.qd, np.array([0, 0, bad, 0, 0, 0])), p, w, "the state is not finite"),
    ]
    for state, pressure, wrench, words in cases:
        after, status = stepper.step(state, pressure, 2e-3, wrench)
        assert not status.ok
        assert words in status
        assert after is state
    after, status = stepper.step(good, p, 2e-3, w)
    assert status.ok
    assert np.isfinite(after.q).all()
    assert np.isfinite(after.internal).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", STEPPERS)
def test_huge_but_finite_input_gives_no_nan(name):
    arm = bellows()
    for pressure in (1e9, -1e9, 1e300):
        with np.errstate(all="ignore"):  # warnings of plain Python, where the JIT is off
            result = simulate(arm, t_end=0.05, dt=5e-3, integrator=name, pressure=[pressure, 0.0, 0.0])
        assert np.isfinite(result.q).all()
        assert np.isfinite(result.qd).all()
        assert result.status.ok == (len(result.t) == 11)


@pytest.mark.parametrize("name", EXPLICIT)
def test_explicit_steppers_refuse_a_stiff_arm_and_name_the_remedy(name):
    """Damping that asks for steps of 5 us, some thousands in one of the grid."""
    arm = rod(16, 1e8, 3000.0)
    result = simulate(arm, bent(arm), t_end=0.5, dt=2e-2, integrator=name)
    assert not result.status.ok
    assert "integrator='trapezoidal'" in result.status or "integrator='tr_bdf2'" in result.status
    assert np.isfinite(result.q).all()


def test_an_unstable_explicit_run_ends_before_it_makes_nonsense():
    """Damping a little too stiff for the step: the error grows, stays finite, and the arm would fold over."""
    arm = bellows(k_e=[100.0, 0.0, 1.0], k_b=[0.05, 0.0, 1.0], damping=[0.03, 1e-4, 1e-4])
    run = {"t_end": 0.1, "pressure": [1e3, 1e3, 1e3]}
    fine = simulate(arm, [0.2, 60.0, 0.0], dt=1e-5, integrator="rk4", **run)
    assert fine.status == "ok"
    coarse = simulate(arm, [0.2, 60.0, 0.0], dt=1e-4, integrator="rk4", **run)
    assert "the step is too long for what happens in it; use a smaller dt" in coarse.status
    assert np.abs(coarse.q - fine.q[::10][: len(coarse.q)]).max() < 0.2 * np.abs(fine.q).max()


@pytest.mark.parametrize("name", ["trapezoidal", "midpoint_linear", "tr_bdf2"])
def test_steps_that_cannot_be_solved_whole_are_done_in_parts(name):
    """Released from half its length and spinning, at a step of a fifth of its period."""
    arm = rod(1, 1e4, 5.0)
    q0, qd0 = [-0.5, 0.0, 0.0], [5.0, 100.0, 100.0]
    result = simulate(arm, q0, qd0, t_end=0.4, dt=2e-2, integrator=name)
    assert result.status == "ok"
    fine = simulate(arm, q0, qd0, t_end=0.4, dt=1e-3, integrator=name)
    assert np.abs(result.q[-1] - fine.q[-1]).max() < 0.5 * np.abs(fine.q).max()


def test_a_collapse_is_found_at_the_step_where_it_happens():
    """A linear rod let go from a tenth of its length folds up; a long step neither hides nor hastens it."""
    arm = rod(4, 1e4, 0.0)
    q0 = np.tile([-0.9, 0.0, 0.0], 4)
    exact = simulate(arm, q0, t_end=0.1, dt=1e-5, integrator="rk4")
    assert "compressed to nothing" in exact.status
    for name in ("trapezoidal", "midpoint", "tr_bdf2"):
        result = simulate(arm, q0, t_end=0.1, dt=1e-3, integrator=name)
        assert "compressed to nothing" in result.status
        assert "lower the load" in result.status
        assert result.t[-1] == pytest.approx(exact.t[-1], abs=2e-3)


def short(least=None):
    """Chamber 0 at 204 kPa, beyond the range of the arm, bends link0 short."""
    return SoftArm(collapsing_arm(least_elongation=least)), np.array([204e3, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("name", STEPPERS)
def test_a_link_that_bending_pulls_short_ends_the_run(name):
    """Damping asks for ever shorter explicit steps the shorter the link: rk4 does not resolve it at 5 ms."""
    arm, p = short()
    result = simulate(arm, t_end=5.0, dt=5e-3, integrator=name, pressure=p)
    assert not result.status.ok
    assert result.t[-1] < 2.0
    assert -0.991 < result.q[:, 0].min() < -0.5
    assert np.isfinite(result.qd).all()
    if name == "rk4":
        assert "the step is too long" in result.status
        return
    assert "compressed to nothing" in result.status
    assert "link0 (elongation -0.9" in result.status
    assert "least_elongation" in result.status
    (again,) = simulate_many(arm, [np.zeros(6)], t_end=5.0, dt=5e-3, integrator=name, pressure=p)
    assert again.status == result.status
    end = State(result.q[-1], result.qd[-1])
    after, status = make_stepper(name, arm).step(end, p, 5e-3)
    assert after is end
    assert "link0 (elongation -0.9" in status


@pytest.mark.parametrize("name", STEPPERS)
def test_walls_that_touch_hold_it(name):
    """At the balance behind the turn of the branch, where one collapses without walls."""
    arm, p = short(least=-0.6)
    result = simulate(arm, t_end=8.0, dt=1e-3 if name == "rk4" else 5e-3, integrator=name, pressure=p)
    assert result.status == "ok"
    assert -0.6 < result.q[:, 0].min() < result.q[-1, 0] + 1e-3 < -0.3
    force = (
        arm.gravity_force(result.q[-1])
        + arm.elastic_force(result.q[-1])
        - arm.actuation_matrix(result.q[-1]) @ p
    )
    assert np.abs(force[:3]).max() < 1e-3 * np.abs(arm.elastic_force(result.q[-1])).max()


@pytest.mark.parametrize("name", ["trapezoidal", "midpoint_linear", "tr_bdf2_linear"])
def test_an_indefinite_stiffness_does_not_stop_a_step(name):
    """Strongly bent, the law on the deformed angle pulls the arm short: d2U_e/dq2 is indefinite."""
    arm = bellows(k_e=[100.0, 0.0, 1.0], k_b=[0.05, 0.0, 1.0], damping=[0.03, 1e-4, 1e-4])
    q0 = np.array([0.2, 60.0, 0.0])
    assert np.linalg.eigvalsh(arm.stiffness_matrix(q0)).min() < 0.0
    for dt in (5e-3, 2e-2):
        result = simulate(arm, q0, t_end=0.1, dt=dt, integrator=name, pressure=[1e3, 1e3, 1e3])
        assert result.status == "ok"
        fine = simulate(arm, q0, t_end=0.1, dt=1e-3, integrator="dopri5", pressure=[1e3, 1e3, 1e3])
        assert np.abs(result.q[-1] - fine.q[-1]).max() < 0.01 * np.abs(fine.q).max()


# Pressures and wrenches beyond what the arm carries, and the share that it does carry.
TOO_LARGE = {
    "chambers that pull": ({"pressure": [-1e6, -1e6, -1e6]}, 0.03),
    "a force along the arm": ({"wrench": [0.0, 0.0, 0.0, 0.0, 0.0, -500.0]}, 0.5),
}


@pytest.mark.parametrize("name", ["trapezoidal", "tr_bdf2", "rk4"])
@pytest.mark.parametrize("kind", TOO_LARGE)
def test_a_load_without_equilibrium_is_the_cause_and_no_step_the_cure(kind, name):
    load, most = TOO_LARGE[kind]
    arm = SoftArm(load_robot(find_config("tue_three_bellow", "robots")))
    status = simulate(arm, t_end=0.1, dt=2e-3, integrator=name, **load).status
    assert "there is no equilibrium beyond" in status
    assert "lower the load or the pressure" in status
    assert "smaller dt" not in status
    share = float(status.message.split("beyond ")[1].split("%")[0]) / 100.0
    assert 0.0 < share < most
    # Released at once, the arm overshoots its balance.
    less = {key: (0.3 * share * np.array(values)).tolist() for key, values in load.items()}
    assert simulate(arm, t_end=1.0, dt=2e-3, **less).status.ok


def test_a_load_that_turns_an_arm_many_times_in_a_step_is_the_cause():
    """A moment whose balance is some turns; the first step leads beyond what a link can be."""
    arm = SoftArm(load_robot(find_config("tue_three_bellow", "robots")))
    moment = {"wrench": [50.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
    status = simulate(arm, t_end=0.1, dt=2e-3, integrator="rk4", **moment).status
    assert "the load is so large that, within one step from link0 (elongation 0.000)" in status
    assert status.message.index("lower the load") < status.message.index("smaller dt")
    assert " in link0 (elongation 0.000): a link was compressed" not in status
