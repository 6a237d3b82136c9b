"""The plan of an excitation: range, rates, every chamber alone, every pair, steps, sweeps, duration."""

from itertools import combinations

import numpy as np
import pytest

from soro_core.config import with_changes
from soro_core.pneumatics import RegulatorModel
from soro_core.robot import load_robot
from soro_core.safety import Limits
from soro_lab.excitation import ExciteConfig, MotionLimits
from soro_lab.excitation.config import STAGES
from soro_lab.excitation.plan import make_plan
from soro_lab.excitation.supply import supply_of
from tests.refused import refused

RATE_HZ = 200.0
LIMITS = Limits()


def made(robot="tue_three_bellow", limits=LIMITS, response=None, **keys):
    """The supply and the plan of a robot with some keys."""
    config = ExciteConfig(**keys)
    response = response or RegulatorModel(minimum_pa=limits.minimum_pa)
    loaded = load_robot(robot) if isinstance(robot, str) else robot
    supply = supply_of(loaded, limits, response, config, RATE_HZ, "scene")
    return supply, make_plan(supply, config, "scene")


def samples(plan):
    """Set points at the ticks of the whole plan, each section at its longest; (n, n_u)."""
    begin, rows = np.zeros(len(plan.names)), []
    for section in plan.sections:
        times = np.arange(0.0, section.longest_s, 1.0 / RATE_HZ)
        found = [section.setpoint(begin, t) for t in times]
        rows += found
        begin = found[-1]
    return np.array(rows)


def vacuum_limits():
    return Limits(minimum_pa=-30e3)


@pytest.mark.parametrize(
    ("limits", "robot", "low_pa", "high_pa"),
    [
        (LIMITS, "tue_three_bellow", 0.0, 90e3),
        (Limits(maximum_pa=40e3), "tue_three_bellow", 0.0, 40e3),
        (
            vacuum_limits(),
            load_robot("tue_three_bellow").replace(pressure_range_pa=(-20e3, 60e3)),
            -20e3,
            60e3,
        ),
    ],
    ids=["platform", "limits", "vacuum"],
)
def test_set_points_use_the_whole_range_and_stay_within_it(limits, robot, low_pa, high_pa):
    _, plan = made(robot, limits)
    found = samples(plan)
    assert found.min() == pytest.approx(low_pa)
    assert found.max() == pytest.approx(high_pa)
    assert (found >= low_pa).all()
    assert (found <= high_pa).all()


@pytest.mark.parametrize("rates", [(200e3, 400e3), (30e3, 50e3)])
def test_set_points_keep_the_rate_limits(rates):
    _, plan = made(limits=Limits(rise_pa_s=rates[0], fall_pa_s=rates[1]), ramp_s=0.0)
    change = np.diff(samples(plan), axis=0) * RATE_HZ
    assert 0.9 * rates[0] < change.max() <= rates[0]
    assert -0.9 * rates[1] > change.min() >= -rates[1]


def levels(plan, stage):
    return [section.level_pa for section in plan.sections if section.stage == stage]


def moved(level):
    return tuple(np.flatnonzero(level))


def test_each_chamber_is_alone_at_each_level_from_below_and_from_above():
    _, plan = made(levels=3)
    for chamber in range(3):
        alone = [level[chamber] for level in levels(plan, "singles") if moved(level) == (chamber,)]
        highest = alone.index(max(alone))
        assert np.all(np.diff(alone[: highest + 1]) > 0.0)
        assert np.all(np.diff(alone[highest:]) < 0.0)
        assert sorted(set(alone)) == sorted(alone[: highest + 1])
        assert len(set(alone)) == 3
        assert set(alone[highest:]) == set(alone)


def test_each_pair_is_together_and_apart():
    _, plan = made()
    found = levels(plan, "pairs")
    for pair in combinations(range(3), 2):
        both = np.array([level[list(pair)] for level in found if moved(level) == pair])
        assert np.linalg.matrix_rank(both) == 2
        assert (both == 90e3).all(axis=1).any()


@pytest.mark.parametrize(("robot", "groups"), [("tue_three_bellow", 1), ("asu_two_segment", 3)])
def test_the_chambers_of_each_link_and_all_of_them_are_together(robot, groups):
    supply, plan = made(robot)
    found = {moved(level) for level in levels(plan, "together") if moved(level)}
    wanted = {tuple(link) for link in supply.links if len(link) > 2} | {tuple(range(len(supply.names)))}
    assert found == wanted
    assert len(found) == groups


def test_steps_are_as_fast_as_the_limits_allow_and_move_each_chamber():
    _, plan = made()
    before, seen = np.zeros(3), set()
    for section in (one for one in plan.sections if one.stage == "steps"):
        change = section.level_pa - before
        rate = 0.95 * (LIMITS.rise_pa_s if change.max() > 0.0 else LIMITS.fall_pa_s)
        assert section.ramp_s == pytest.approx(np.abs(change).max() / rate)
        seen.add(moved(change))
        before = section.level_pa
    assert {(0,), (1,), (2,)} <= seen


def test_a_sweep_rises_to_what_the_lag_leaves():
    for tau_s, high_hz in ((0.052, 11.85), (0.2, 3.08), (0.0, 12.0)):
        supply, plan = made(response=RegulatorModel(tau_s=tau_s))
        sweeps = [section for section in plan.sections if section.sweep]
        assert supply.sweep_high_hz == pytest.approx(high_hz, rel=1e-3)
        assert {moved(one.sweep.amplitude_pa) for one in sweeps} == {(0,), (1,), (2,), (0, 1, 2)}
        for one in sweeps:
            t = np.arange(0.0, one.hold_s, 1e-3)
            p = np.array([one.setpoint(one.level_pa, x) for x in t])
            p = (p - one.level_pa)[:, np.flatnonzero(one.sweep.amplitude_pa)[0]]
            crossings = np.flatnonzero(np.diff(np.sign(p)))
            # Half a period lies between two crossings; the taper at the end does not move them.
            assert 0.5 / np.diff(t[crossings])[-1] == pytest.approx(high_hz, rel=0.1)
            assert 0.5 / np.diff(t[crossings])[0] < 2.0 * supply.sweep_low_hz


def test_the_default_of_one_link_takes_at_most_two_minutes():
    _, plan = made()
    assert plan.longest_s <= 118.5  # and the vent of 1.5 s
    assert {section.stage for section in plan.sections} == {"rest", *STAGES}
    names = [(section.stage, section.name) for section in plan.sections]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("duration_s", [80.0, 150.0, 600.0])
def test_the_times_fill_a_duration(duration_s):
    _, plan = made(duration_s=duration_s)
    assert plan.longest_s == pytest.approx(duration_s)
    assert len(samples(plan)) / RATE_HZ == pytest.approx(duration_s, abs=len(plan.sections) / RATE_HZ)
    holds = [section for section in plan.sections if section.stage == "singles"]
    assert all(section.shortest_s <= section.hold_s for section in holds)


def test_more_levels_and_repetitions_take_longer():
    shortest = made()[1].longest_s
    assert made(levels=8)[1].longest_s > shortest + 30.0
    assert made(repeat=2)[1].longest_s == pytest.approx(2.0 * shortest - 1.5)


def test_stages_come_in_the_given_order():
    _, plan = made(stages=("steps", "singles"))
    assert list(dict.fromkeys(section.stage for section in plan.sections)) == ["rest", "steps", "singles"]


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        ({"maximum_pa": 95e3}, "excite.maximum_pa"),
        ({"minimum_pa": -5e3}, "excite.minimum_pa"),
        ({"duration_s": 30.0}, "excite.duration_s"),
        ({"hold_s": 0.5, "shortest_hold_s": 0.6}, ""),
        ({"sweep_low_hz": 5.0, "sweep_high_hz": 2.0}, ""),
        ({"stages": ("steps", "steps")}, "stages"),
        ({"stages": ("jumps",)}, "stages[0]"),
    ],
)
def test_what_the_limits_do_not_leave_is_refused(keys, key):
    with refused(key):
        made(**keys)


def test_a_robot_that_cannot_be_empty_is_refused():
    robot = load_robot("tue_three_bellow").replace(pressure_range_pa=(10e3, 60e3))
    with refused("limits"):
        made(robot)


@pytest.mark.parametrize("box", [(0.0,), (1.0, 2.0), (0.0, 0.0, 0.0, 1.0, -1.0, 1.0)])
def test_a_box_that_is_none_is_refused(box):
    with refused("box_m"):
        MotionLimits(box_m=box)


def test_a_release_comes_last():
    _, plan = made(release=True)
    assert plan.sections[-1].asks
    assert not plan.sections[-1].level_pa.any()
    assert with_changes(ExciteConfig(), release=True).release_s == plan.sections[-1].longest_s
