"""The study finds the errors that are there, keeps what it found, and stops when told."""

import json
from dataclasses import replace

import numpy as np
import pytest
from small import GRID, Counting, robot

from soro_core import SoftArm, simulate
from soro_core.integrate import make_stepper
from soro_core.jobs import Here
from soro_core.robot import Discretisation
from soro_lab.identification import ForcedRun
from soro_lab.scene import Requirement, Scene
from soro_lab.trade import Candidate, TradeCase, bare_case, cost, run_study
from soro_lab.trade.cache import Cache
from soro_lab.trade.grid import PRESETS, around, within
from soro_lab.trade.outcome import Outcome, compute
from soro_lab.trade.reference import converge
from soro_lab.trade.slow_metrics import mean_curvature, measured_error
from soro_lab.trade.study import Stopped
from soro_lab.trade.trace import errors, first_frequency_hz, trace


@pytest.fixture(scope="module")
def case():
    return bare_case(robot(), 0.3)


@pytest.fixture(scope="module")
def reference(case):
    return converge(case, 0.02)


def test_the_reference_states_its_error(case, reference):
    """Polynomials of twice the degree at a quarter of the step differ by no more than it says."""
    assert reference.converged
    arm = SoftArm(Discretisation(basis="legendre", order=4, links=2).discretise(case.robot))
    finer = trace(case, arm, "trapezoidal", reference.candidate.dt_s / 4)
    found = errors(reference.trace, finer, case.robot.length)
    assert found.tip <= reference.own.tip
    assert found.shape <= reference.own.shape
    assert found.frequency <= max(reference.own.frequency, 1e-6)


def test_errors_fall_with_refinement(case, reference):
    def error(model, dt):
        return compute(case, reference.trace, Candidate(model, "trapezoidal", dt)).errors

    coarse, fine = error(Discretisation(), 0.005), error(Discretisation(links=4), 0.005)
    assert fine.tip < 0.3 * coarse.tip
    assert fine.shape < 0.3 * coarse.shape
    assert fine.frequency < 0.3 * coarse.frequency
    smooth = Discretisation(basis="legendre", order=3)
    slow, fast = error(smooth, 0.02), error(smooth, 0.0025)
    assert fast.tip < 0.25 * slow.tip
    assert fast.energy < 0.25 * slow.energy


def test_errors_are_in_per_cent_of_length_and_span(case, reference):
    truth = reference.trace
    moved = type(truth)(
        truth.places + np.array([0.0, 0.003, 0.004]), truth.energy + 0.01, 1.02 * truth.frequency_hz
    )
    found = errors(moved, truth, length=0.5)
    assert found.tip == pytest.approx(1.0)
    assert found.shape == pytest.approx(1.0)
    assert found.energy == pytest.approx(1.0 / np.ptp(truth.energy))
    assert found.frequency == pytest.approx(2.0)


def test_pressures_are_what_simulate_makes_of_a_function(case):
    arm = SoftArm(case.robot)
    times = np.arange(61) * 0.005
    table = simulate(arm, t_end=0.3, dt=0.005, integrator="rk4", pressure=case.pressures(times))

    def pressure(t):
        return [np.interp(t, case.knots_s, case.pressure_pa[:, 0])]

    function = simulate(arm, t_end=0.3, dt=0.005, integrator="rk4", pressure=pressure)
    np.testing.assert_allclose(table.q, function.q, atol=1e-12)
    assert np.abs(function.q).max() > 1.0


def test_the_first_frequency_is_that_of_a_beam():
    """Euler-Bernoulli cantilever without gravity: 1.875^2 sqrt(EI / (rho A)) / (2 pi L^2)."""
    free = robot().replace(gravity=[0.0, 0.0, 0.0])
    arm = SoftArm(Discretisation(basis="legendre", order=4).discretise(free))
    slender = 3e5 * np.pi * 0.01**4 / 4, 1100.0 * np.pi * 0.01**2
    beam = 1.8751**2 * np.sqrt(slender[0] / slender[1]) / (2 * np.pi * 0.2**2)
    assert first_frequency_hz(arm, np.zeros(arm.n_q)) == pytest.approx(beam, rel=5e-3)
    heavy = SoftArm(robot().replace(tip_mass=10.0, base_quaternion=[0.0, 0.0, 0.0, 1.0]))
    assert first_frequency_hz(heavy, np.zeros(1)) == 0.0  # it buckles


def test_mean_curvature_of_pieces_and_polynomials():
    for model in (Discretisation(links=3), Discretisation(basis="chebyshev", order=2)):
        arm = SoftArm(model.discretise(robot()))
        q = np.random.default_rng(2).normal(size=arm.n_q)
        pose = np.linalg.inv(arm.pose(q, 0.0)) @ arm.pose(q, arm.length)
        # In the plane the mean curvature is the angle of the tip over the length.
        angle = np.arctan2(pose[0, 2], pose[2, 2])
        assert (mean_curvature(arm, model.links) @ q)[0] == pytest.approx(angle / 0.2)


@pytest.fixture(scope="module")
def studied(case, tmp_path_factory):
    cache, counting = Cache(tmp_path_factory.mktemp("cache")), Counting()
    requirement = Requirement(error="5%")
    return cache, counting, run_study(case, GRID, requirement, counting, cache, repeats=1)


@pytest.mark.slow
def test_front_and_choice(studied):
    _, _, study = studied
    assert study.combinations == 3 * 3 * len({row.candidate.integrator for row in study.rows}) * 3
    assert 0 < len(study.rows) <= study.combinations
    front = study.front
    assert [row.tip for row in front] == sorted((row.tip for row in front), reverse=True)
    assert study.choice.tip <= 5.0
    assert not any(row.tip <= 5.0 and row.cpu < study.choice.cpu for row in study.rows)
    assert (
        json.loads(json.dumps(study.as_dict(), allow_nan=False))["choice"] == study.choice.candidate.section
    )
    fast = type(study)(**{**vars(study), "requirement": Requirement(budget_us=1e9)})
    assert fast.choice.tip == min(row.tip for row in study.rows)
    never = type(study)(**{**vars(study), "requirement": Requirement(error="0.000001%")})
    assert never.choice is None
    assert never.nearest.tip == min(row.tip for row in study.rows)


def test_what_is_known_is_not_computed_again(case, studied):
    cache, counting, study = studied
    assert counting.done
    again = Counting()
    second = run_study(case, GRID, study.requirement, again, cache, repeats=1)
    assert again.done == []
    np.testing.assert_array_equal(second.reference.trace.places, study.reference.trace.places)
    assert second.reference.candidate == study.reference.candidate
    assert second.rows == study.rows
    # Another robot is another study.
    other = Counting()
    heavier = bare_case(robot().replace(tip_mass=0.01), 0.3)
    run_study(heavier, GRID, study.requirement, other, cache, repeats=1, stop=lambda: len(other.done) > 1)
    assert other.done


def test_stopping_keeps_what_is_done(case, studied):
    counting = Counting()
    study = run_study(
        case, GRID, Requirement(error="5%"), counting, None, 1, stop=lambda: len(counting.done) >= 3
    )
    assert study.stopped
    assert {row.candidate for row in study.rows} == set(counting.done[:3])
    with pytest.raises(Stopped):
        run_study(case, GRID, Requirement(error="5%"), Here(), stop=lambda: True)


def test_a_failure_is_a_row_with_its_cause(case, reference):
    stiff = robot().replace(links=[{**case.robot.links[0].model_dump(exclude_unset=True), "material": STIFF}])
    outcome = compute(bare_case(stiff, 0.3), reference.trace, Candidate(Discretisation(links=2), "rk4", 0.02))
    assert outcome == Outcome(outcome.candidate, None, outcome.failure)
    assert "t = " in outcome.failure


STIFF = {"youngs_modulus": 1e8, "shear_modulus": 3e7, "viscosity": 1e3}


def test_a_measured_run_is_compared_in_its_own_frame():
    """A run made by a candidate itself, seen in a turned frame with an offset, has no error for it."""
    candidate = Candidate(Discretisation(links=2), "trapezoidal", 0.01)
    seen = robot().replace(calibration={"frame_rotation_rad": 0.7, "curvature_offset": [0.3, -0.2]})
    t = np.arange(31) * 0.01
    pressure = 2e4 * np.sin(10 * t)[:, None] ** 2
    arm = SoftArm(seen.refine(2))
    start = TradeCase(seen, "", t, pressure, 0.3)
    result = simulate(arm, start.initial(arm), t_end=0.3, dt=0.01, pressure=start.pressures(t))
    shown = np.cos(0.7), np.sin(0.7)
    curvature = np.outer(result.q.mean(axis=1), shown) + np.array([0.3, -0.2])
    case = replace(start, measured=ForcedRun(t, pressure, curvature))
    assert measured_error(case, candidate) == pytest.approx(0.0, abs=1e-6)
    coarse = Candidate(Discretisation(), "trapezoidal", 0.01)
    assert measured_error(case, coarse) > 0.02
    assert measured_error(start, candidate) is None


@pytest.mark.parametrize(
    ("tick_s", "steps", "first_pass"),
    [
        (np.inf, PRESETS["standard"].dt_s, PRESETS["standard"].coarse_dt_s),
        (0.02, PRESETS["standard"].dt_s, PRESETS["standard"].coarse_dt_s),
        (0.005, (0.005, 0.002, 0.001), (0.005, 0.002)),
        (0.002, (0.002, 0.001), (0.002,)),
        (0.0025, (0.0025, 0.002, 0.001), (0.0025, 0.002)),
        (1e-4, (1e-4,), (1e-4,)),
        (0.015, (0.01, 0.005, 0.002, 0.001), (0.01, 0.002)),  # 20 ms are no whole number of these
        (7e-4, (0.001,), (0.001,)),
    ],
)
def test_no_step_of_a_scene_is_longer_than_its_tick(tick_s, steps, first_pass):
    grid = within(PRESETS["standard"], tick_s)
    assert grid.dt_s == steps
    assert grid.coarse_dt_s == first_pass


def test_steps_of_a_paced_case_fill_its_ticks():
    """As a twin makes them: 2 ms in a tick of 5 ms are three steps; without pace a step is what it is."""
    paced = replace(bare_case(robot(), 0.1), tick_s=0.005, paced=True)
    assert [paced.step_s(dt) for dt in (0.02, 0.005, 0.002)] == pytest.approx([0.005, 0.005, 0.005 / 3])
    assert paced.longest_step_s == 0.005
    slow = replace(paced, tick_s=0.01, scene=Scene(rate_hz=200.0))
    assert slow.longest_step_s == 0.005
    free = replace(paced, paced=False)
    assert [free.step_s(dt) for dt in (0.02, 0.002)] == [0.02, 0.002]
    assert free.longest_step_s == np.inf


def test_second_pass_varies_quadrature_and_step():
    grid = PRESETS["standard"]
    good = [Candidate(Discretisation(links=k), "trapezoidal", 0.01) for k in range(1, 20)]
    found = around(grid, good, good)
    assert len(found) == grid.most
    assert len({one.model.nodes for one in found}) > 1
    assert len({one.dt_s for one in found}) > 1


@pytest.mark.parametrize(("paced", "run_s"), [(True, 0.005 / 3), (False, 0.002)], ids=["paced", "free"])
def test_times_are_those_of_the_steps_that_are_made(monkeypatch, paced, run_s):
    """Of whole runs and of ticks: those with pace are the twin's; a tick is filled in either case."""
    runs, steps = set(), []

    def simulated(arm, start, t_end, dt, **more):
        runs.add(dt)
        assert t_end == pytest.approx(0.1, abs=dt)
        return simulate(arm, start, t_end=t_end, dt=dt, **more)

    monkeypatch.setattr(cost, "simulate", simulated)
    monkeypatch.setattr(cost, "make_stepper", lambda *a: Noted(make_stepper(*a), steps))
    case = replace(bare_case(robot(), 0.1), tick_s=0.005, paced=paced)
    cost.measure(case, Candidate(Discretisation(), "trapezoidal", 0.002), repeats=1)
    assert list(runs) == pytest.approx([run_s])
    assert steps[-60:] == pytest.approx([0.005 / 3] * 60)


class Noted:
    """A stepper that notes its steps."""

    def __init__(self, stepper, steps):
        self.stepper, self.steps = stepper, steps
        self.initial_state = stepper.initial_state

    def step(self, state, pressure, dt):
        self.steps.append(dt)
        return self.stepper.step(state, pressure, dt)


def test_a_candidate_that_takes_for_ever_is_left_out_and_says_so(case, reference, monkeypatch):
    candidate = Candidate(Discretisation(), "trapezoidal", 0.01)
    assert compute(case, reference.trace, candidate).errors is not None
    monkeypatch.setattr("soro_lab.trade.trace.SLOWEST", 0.0)
    outcome = compute(case, reference.trace, candidate)
    assert outcome.errors is None
    assert outcome.failure == "too slow: takes more than 0 s a simulated second"
