"""A run starts from what an earlier one has learned of the arm."""

import math
from functools import cache

import numpy as np
import pytest
import yaml
from loop_harness import Setup, run

from soro_core import load_robot
from soro_core.adaptation.kept import FILE, KeptNumbers, digest_of, keep, load_kept
from soro_core.config import find_config, parse
from soro_core.control import ControllerConfig
from soro_core.control.controller import Controller
from soro_core.control.laws.composite import CompositeOptions
from soro_core.robot.parts import fields
from tests.refused import refused

HANGING = load_robot(find_config("three_bellow_hanging", "robots"))
CIRCLE = {"curvature_per_m": 7.0, "mean_pressure_pa": 30e3}
NAMES = Controller(HANGING, ControllerConfig(law="composite")).law.learner.names


def numbers(**changes):
    """Numbers of the robot, all 0 but the changed ones; __ for /."""
    given = {name.replace("__", "/"): value for name, value in changes.items()}
    return {name: (given.get(name, 0.0), 0.01) for name in NAMES} | {
        name: (value, 0.01) for name, value in given.items()
    }


def kept(**changes):
    values = numbers(**changes)
    return keep(HANGING, {k: v[0] for k, v in values.items()}, {k: v[1] for k, v in values.items()})


def tracked(plant, duration_s, start=None):
    """Run on a plant, from numbers that were kept."""
    options = {} if start is None else {"learned": start}
    control = parse(
        {"law": "composite", "reference": CIRCLE, "law_options": options}, ControllerConfig, "test"
    )
    return run(HANGING, Setup(plant=plant, payload_kg=0.0, control=control, duration_s=duration_s))


def with_chambers(change):
    link = fields(HANGING.links[0])
    chambers = [fields(chamber) | change(i, chamber) for i, chamber in enumerate(HANGING.links[0].chambers)]
    return HANGING.replace(links=[link | {"chambers": chambers}])


def weak(i, chamber):
    part = 0.6 if i == 1 else 1.0
    return {"alpha_eps": part * chamber.alpha_eps, "alpha_kappa": part * chamber.alpha_kappa}


PLANTS = {"weak": with_chambers(weak), "slope": with_chambers(lambda i, chamber: {"area_slope": -2.0})}


@cache
def first_run(plant):
    """The record of a first run, and what it kept."""
    record = tracked(PLANTS[plant], 8.0)
    values = dict(zip(record.names, record.estimates[-1].tolist(), strict=True))
    return record, keep(HANGING, values, dict.fromkeys(values, 0.1))


def of_length(record, begin_s, end_s):
    """RMS of the tip error in a span of time, part of the length."""
    inside = (record.t >= begin_s) & (record.t < end_s)
    return math.sqrt(float(np.mean(record.error()[inside] ** 2))) / HANGING.length


@pytest.mark.slow
@pytest.mark.parametrize("plant", PLANTS)
def test_the_first_seconds_of_the_second_run_are_better(plant):
    first, start = first_run(plant)
    second = tracked(PLANTS[plant], 4.0, start)
    for span in ((0.0, 2.0), (2.0, 4.0)):
        was, now = (of_length(record, *span) for record in (first, second))
        print(f"{plant}, {span} s: {100 * was:.2f} % in the first run, {100 * now:.2f} % in the second")
        assert now < 0.6 * was


@pytest.mark.slow
def test_numbers_of_another_day_are_overcome():
    _, wrong = first_run("weak")
    record = tracked(None, 8.0, wrong)
    gain = record.estimates[-1, record.names.index("link0/chamber1/gain")]
    print(f"{100 * of_length(record, 6.0, 8.0):.2f} % of the length; gain {gain:.3f}")
    assert wrong.numbers["link0/chamber1/gain"][0] < -0.25
    assert abs(gain) < 0.05
    assert of_length(record, 6.0, 8.0) < 0.003


@pytest.mark.slow
def test_a_matched_arm_gets_no_worse():
    first = tracked(None, 4.0)
    values = dict(zip(first.names, first.estimates[-1].tolist(), strict=True))
    second = tracked(None, 4.0, keep(HANGING, values, dict.fromkeys(values, 0.1)))
    assert of_length(second, 0.0, 4.0) < 1.1 * of_length(first, 0.0, 4.0)


def test_the_learner_starts_from_gains_slopes_and_stiffness_and_returns_there():
    cross = {"link0/bending_x/by link0/bending_y": 0.3, "link0/elongation/offset": -1.0}
    own = {"link0/bending_x/by link0/bending_x": -2.5}
    start = kept(link0__chamber1__gain=-0.3, link0__area_slope=2.0, tip_mass=0.02, **cross, **own)
    options = CompositeOptions(learned=start)
    learner = Controller(HANGING, ControllerConfig(law="composite", law_options=dict(options))).law.learner
    for state in (
        learner.initial_state(),
        learner.follow(learner.initial_state(), 0.0, 1e3),
    ):
        found = dict(zip(learner.names, [*state.learned.theta, *state.chambers], strict=True))
        assert {name: value for name, value in found.items() if value} == pytest.approx(
            {"link0/chamber1/gain": -0.3, "link0/area_slope": 2.0, **own}
        )


@pytest.mark.parametrize(
    ("measured", "begins"),
    [
        ([0.17, -0.34, 0.17], [0.15, -0.3, 0.15]),  # the same within the error of the probe
        ([0.01, 0.02, -0.03], [0.01, 0.02, -0.03]),  # mended since then
        ([0.5, -0.9, 0.4], [0.5, -0.7, 0.4]),  # within the bounds
    ],
)
def test_measured_gains_take_the_place_of_kept_ones_that_they_contradict(measured, begins):
    gains = {f"link0__chamber{k}__gain": value for k, value in enumerate((0.15, -0.3, 0.15))}
    options = {"learned": kept(link0__area_slope=2.0, **gains)}
    law = Controller(HANGING, ControllerConfig(law="composite", law_options=options)).law
    state = law.with_gains(law.initial_state(), np.array(measured), np.full(3, 0.03)).learner
    for after in (state, law.learner.follow(state, 0.0, 1e3)):
        assert after.chambers == pytest.approx([*begins, 2.0])


def test_a_file_says_what_was_kept(tmp_path):
    start = kept(link0__chamber1__gain=-0.3)
    (tmp_path / FILE).write_text(start.to_yaml())
    assert load_kept(tmp_path) == load_kept(tmp_path / FILE) == start
    assert start.digest == digest_of(HANGING.replace(name="other"))


@pytest.mark.parametrize("name", ["1e3", "null", "007", "a: b", "#x", 'a "b"', "ärm"])
def test_a_name_stays_a_text(tmp_path, name):
    robot = HANGING.replace(name=name, description="other words")
    start = keep(robot, {"tip_mass": 0.1}, {"tip_mass": 0.01})
    (tmp_path / FILE).write_text(start.to_yaml(), encoding="utf-8")
    load_kept(tmp_path).require_robot(robot.replace(description=""))


def test_a_value_without_its_deviation_is_named():
    with refused("numbers.tip_mass", "no deviation"):
        keep(HANGING, {"tip_mass": 0.1}, {})


def test_a_path_that_is_not_there_is_named(tmp_path):
    with refused("", "no such file", names=("run folder", FILE)):
        load_kept(tmp_path / "none")


@pytest.mark.parametrize(
    ("changes", "key", "names"),
    [
        ({"version": 2}, "version", ("3", "learn again")),
        ({"version": None}, "version", ()),
        ({"numbers": numbers(link0__chamber1__gain=1.2)}, "numbers", ("link0/chamber1/gain", "-0.7", "1.2")),
        ({"numbers": numbers(link0__chamber1__gain=-5.0)}, "numbers", ("link0/chamber1/gain", "-0.7", "-5")),
        ({"numbers": numbers(link0__chamber1__gain=1e30)}, "numbers.link0/chamber1/gain[0]", ()),
        ({"numbers": numbers(link0__chamber1__gain="2-0.05")}, "numbers.link0/chamber1/gain[0]", ()),
        ({"numbers": numbers(link0__chamber1__gain=[0.1])}, "numbers.link0/chamber1/gain[0]", ()),
        ({"numbers": numbers(link0__area_slope=-11.0)}, "numbers", ("link0/area_slope", "-10 to 10")),
        ({"numbers": {"tip_mass": [0.0]}}, "numbers", ("tip_mass",)),
        ({"numbers": {"tip_mass": [0.0, -1.0]}}, "numbers", ("tip_mass",)),
        ({"numbers": {"tip_mass": [float("nan"), 1.0]}}, "numbers.tip_mass[0]", ()),
        ({"gain": 1.0}, "gain", ()),
    ],
)
def test_a_file_that_cannot_be_is_refused(tmp_path, changes, key, names):
    data = {k: v for k, v in {**kept().model_dump(mode="json"), **changes}.items() if v is not None}
    (tmp_path / FILE).write_text(yaml.safe_dump(data))
    with refused(key, names=names) as caught:
        load_kept(tmp_path)
    assert FILE in str(caught.value)


def test_a_run_that_kept_nothing_is_named(tmp_path):
    with refused("", f"no {FILE}"):
        load_kept(tmp_path)


OTHER = HANGING.replace(links=[fields(HANGING.links[0]) | {"mass": 0.02}])


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"robot": "other"}, "robot"),
        ({"digest": digest_of(OTHER)}, "digest"),
        ({"numbers": numbers(link1__chamber0__gain=0.1)}, "numbers.link1/chamber0/gain"),
        ({"numbers": {"tip_mass": (0.0, 0.01)}}, "numbers.link0/area_slope"),
        ({"numbers": numbers(**{"link0/bending_x/by link0/bending_x": 21.0})}, None),
    ],
)
def test_numbers_of_another_arm_are_refused(changes, key):
    start = KeptNumbers(**{**dict(kept()), **changes})
    with refused(key or "numbers.link0/bending_x/by link0/bending_x"):
        Controller(HANGING, ControllerConfig(law="composite", law_options={"learned": start}))
