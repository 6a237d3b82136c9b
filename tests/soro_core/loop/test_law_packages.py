"""The example packages of laws: found by their entry points, and what each promises, in short runs."""

from __future__ import annotations

import importlib
import re
import sys

import numpy as np
import pytest

from benchmarks import control as benchmark
from benchmarks import law_packages
from benchmarks.options import Options
from soro_core import load_robot
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.laws import ArmBelief, Preview, find_law
from soro_core.control.reference.trajectory import Hold, Point
from soro_lab.scene import load_scene
from tests.law_packages import FOLDERS, paths_of
from tests.soro_core.loop.loop_harness import Setup, run
from tests.soro_ros.in_process import tip_error_rms_m

ROBOT = load_robot("tue_three_bellow")
REST = np.zeros(3)


@pytest.fixture
def law(monkeypatch, tmp_path):
    """Gives the class of a law by name, its package found as if it were installed."""

    def find(name):
        if name == "predictive":
            pytest.importorskip("daqp", reason="the QP solver of examples/predictive is not installed")
        for path in paths_of(name, tmp_path / name):
            monkeypatch.syspath_prepend(path)
        return find_law(name)

    before = set(sys.modules)
    yield find
    for name in set(sys.modules) - before:
        if name.startswith(("soro_energy_shaping", "soro_predictive")):
            del sys.modules[name]


def control(name, robot=ROBOT, **options):
    return Controller(robot, parse({"law": name, "law_options": options}, ControllerConfig, "test"))


def belief(q, qd=REST):
    return ArmBelief(q, qd, None, False, np.zeros(3), np.full(3, 20e3), np.zeros(3, dtype=bool))


def preview(q):
    return Preview(Point(q, REST, REST), Point(q, REST, REST), 0.02, later=lambda t: Point(q, REST, REST))


@pytest.mark.parametrize("name", FOLDERS)
def test_a_package_has_less_than_300_lines(name):
    lines = [line for file in FOLDERS[name].rglob("*.py") for line in file.read_text().splitlines()]
    assert 50 < len(lines) < 300


@pytest.mark.slow
@pytest.mark.parametrize(("name", "held_m"), [("energy_shaping", 3e-4), ("predictive", 3e-4)])
def test_a_law_holds_a_set_point_with_a_load_that_it_does_not_know(law, figure, name, held_m):
    law(name)
    keys = {"law": name, "reference": {"kind": "set_point", "set_point": (0.05, 6.0, -3.0), "start_s": 0.5}}
    record = run(ROBOT, Setup(control=parse(keys, ControllerConfig, "test"), duration_s=3.0))
    figure(f"{name}: tip RMS of the last second {1e3 * record.rms(1.0):.3f} mm")
    assert record.rms(1.0) < held_m
    assert set(record.statuses) == {""}


@pytest.mark.slow
@pytest.mark.parametrize("name", FOLDERS)
def test_a_law_follows_a_circle_with_a_load_that_it_does_not_know(law, figure, name):
    law(name)
    scene = load_scene("track_circle", {"mode": "lockstep", "controller.law": name})
    error_m = tip_error_rms_m(scene, 3.0, 8.0)
    figure(f"{name}: tip RMS on the circle, 3 to 8 s, {1e3 * error_m:.3f} mm")
    assert error_m < 0.6e-3


def test_shaping_and_damping_are_pressures_at_the_volumes_of_the_chambers(law):
    law("energy_shaping")
    loop = control("energy_shaping", stiffness=0.2, damping_s=0.02)
    arm, at = loop.arm, np.array([0.03, 4.0, -2.0])
    q, qd = at + np.array([0.01, 1.0, 0.5]), np.array([0.1, 3.0, -2.0])
    H = arm.actuation_matrix(at)
    own = np.linalg.inv(H.T @ np.linalg.solve(arm.stiffness_matrix(at), H))

    def terms(belief):
        return loop.law.step(loop.law.initial_state(), belief, preview(at), 0.005)[2]

    volume = arm.displaced_volume(q) - arm.displaced_volume(at)
    np.testing.assert_allclose(np.linalg.solve(H, terms(belief(q))["shaping"]), -0.2 * own @ volume)
    moving = terms(belief(at - 0.02 * qd, qd))  # at the set point when a set point acts
    np.testing.assert_allclose(moving["shaping"], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.solve(H, moving["damping"]), -0.02 * own @ H.T @ qd)
    assert qd @ moving["damping"] < 0.0


def test_a_set_point_that_is_no_minimum_of_the_energy_is_said(law):
    law("energy_shaping")
    heavy = ROBOT.replace(tip_mass=0.08)
    for stiffness, is_minimum in ((0.0, False), (3.0, True)):
        loop = control("energy_shaping", heavy, stiffness=stiffness)
        state = loop.law.step(loop.law.initial_state(), belief(REST), preview(REST), 0.005)[0]
        assert ("no minimum" in loop.law.note(state)) != is_minimum


def test_the_plan_keeps_range_and_rates_and_brings_the_tip_nearer(law):
    found = law("predictive")
    program = importlib.import_module("soro_predictive.program")
    loop = control("predictive")
    assert isinstance(loop.law, found)
    horizon, steps_s = loop.law.horizon(0), np.array([0.005, 0.005, *9 * [0.025]])
    start = loop.law.horizon(0).stepper.initial_state()
    wish, goal = np.full((11, 3), 20e3), np.array([0.05, 8.0, 0.0])
    course = horizon.course(start, wish[0], wish, steps_s, np.ones(3), np.zeros((11, 3)))
    wanted = np.array([*loop.arm.pose(goal, loop.arm.length)[:3, 3], *goal])
    weight = np.repeat([[1e3, 1e3, 1e3, 0.0, 0.0, 0.0]], 11, axis=0)
    supply = program.Supply(0.0, 60e3, 200e3, 400e3, 2.6)
    plan, flag = program.best_wish(course, course.place - wanted, weight, 0.1, wish, steps_s, supply)
    assert flag >= 1
    jump = supply.lead * np.diff(np.vstack([wish[:1], plan]), axis=0) / steps_s[1:, None]
    assert jump.max() == pytest.approx(200e3)  # as fast as it may
    assert jump.min() >= -400e3 * (1 + 1e-6)
    after = horizon.course(
        start, wish[0], np.vstack([wish[:1], plan]), steps_s, np.ones(3), np.zeros((11, 3))
    )
    command = supply.lead * np.vstack([wish[:1], plan]) + (1 - supply.lead) * after.pressure_pa
    # The range is soft: as near as a regulator resolves.
    assert command.min() > -50.0
    assert command.max() < 60e3 + 50.0
    missed = [np.linalg.norm(one.place[-1, :3] - wanted[:3]) for one in (course, after)]
    assert missed[1] < 0.5 * missed[0]


def test_derivatives_of_the_course_are_those_of_its_differences(law):
    law("predictive")
    horizon = control("predictive").law.horizon(5)
    start, steps_s = horizon.stepper.initial_state([0.02, 3.0, 1.0]), np.array([0.005, 0.025, 0.025])
    wish, gain, forces = np.full((3, 3), 20e3), np.array([1.1, 1.0, 0.9]), np.zeros((3, 3))

    def course(wish):
        return horizon.course(start, np.full(3, 15e3), wish, steps_s, gain, forces)

    by = course(wish).place_by_wish
    for k in range(9):
        h = 10.0 * np.eye(9)[k].reshape(3, 3)
        slope = (course(wish + h).place - course(wish - h).place) / 20.0
        np.testing.assert_allclose(by[..., k], slope, rtol=1e-4, atol=1e-12)


def test_without_a_plan_the_force_is_that_of_composite(law, monkeypatch):
    law("predictive")
    laws = [control(name).law for name in ("predictive", "composite")]
    monkeypatch.setattr(sys.modules["soro_predictive.law"], "best_wish", lambda *given: (None, -1))
    at = np.array([0.03, 4.0, -2.0])
    (state, force, _), (_, same, _) = (
        one.step(one.initial_state(), belief(at), preview(at), 0.005) for one in laws
    )
    np.testing.assert_array_equal(force, same)
    assert laws[0].note(state) == "no plan: the quadratic program ends with -1 of daqp"


def test_the_benchmark_says_which_law_it_cannot_measure_and_why(monkeypatch, tmp_path):
    def lost(robot, setup):
        raise AssertionError

    monkeypatch.setitem(sys.modules, "daqp", None)
    monkeypatch.setattr(law_packages, "run_loop", lost)
    options, before = Options(peer=False, quick=True, folder=tmp_path), list(sys.path)
    text = law_packages.run(ROBOT, options, benchmark.CASES, benchmark.setup_of)
    assert re.findall(r"^\| (\w+) \| default, 20 g \| lost", text, re.M) == ["composite", "energy_shaping"]
    assert re.search(r"^`predictive` is not measured: .*daqp.*program\.py, line \d+\)\)\.$", text, re.M)
    assert sys.path == before


def test_the_reference_ahead_is_that_of_later_ticks():
    """What a law sees of a time ahead is what it sees at that time as `now`."""
    loop, seen = control("composite"), []
    step = loop.law.step
    loop.law.step = lambda state, belief, reference, dt: (
        seen.append(reference),
        step(state, belief, reference, dt),
    )[1]
    state = loop.initial_state()
    for k in range(20):
        state, command = loop.step(state, REST, REST, 0.005 * k, 0.005, np.zeros(3))
        assert command.status.ok
    for k in (0, 5):
        np.testing.assert_allclose(seen[k].at(0.05).q, seen[k + 10].now.q, atol=1e-3)
        np.testing.assert_allclose(seen[k].at(seen[k].ahead_s).q, seen[k].ahead.q)
    assert Preview(seen[0].now, Hold(REST).sample(0.0), 0.02).at(1.0).q is REST
