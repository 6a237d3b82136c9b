"""Cells that follow upon each other, parts of several inlets, and walls that keep a width."""

from importlib import import_module

import numpy as np
import pytest
from scipy.sparse.linalg import aslinearoperator

from soro_core.config import with_changes
from soro_core.errors import ConfigError, ModelError
from soro_design.topology import (
    load_state,
    load_task,
    make_domain,
    optimise,
    reanalyse,
    save,
    shape,
    task_from_dict,
)
from soro_design.topology.check import final_part, turn_of
from soro_design.topology.domain import analysis
from soro_design.topology.optimise import designs_at, goal_of
from soro_design.topology.physics.filter import density_filter
from soro_design.topology.repeats import cell_mean
from soro_design.topology.shape import contour
from soro_design.topology.task import write_task
from soro_design.topology.widths import least_widths
from tests.refused import refused
from tests.soro_design.topology.small import bellow

optimiser = import_module("soro_design.topology.optimise")

INSIDE = {"kind": "box", "x_m": [0.01, 0.012], "y_m": [0.01, 0.012]}
# Of 10 mm along y, between 12 elements.
CELLS = {"along": "y", "from_m": 0.0025, "pitch_m": 0.0025, "number": 2}


def folds(margin=0.2, iterations=44):
    """The shipped bellow of two cells and coarse."""
    task = load_task("bellow_folds")
    data = task.model_dump(mode="json", exclude_unset=True)
    ends = {"kind": "box", "y_m": [0.02, 0.02]}
    core = {"kind": "box", "x_m": [0.0, 0.004], "y_m": [0.0, 0.016]}
    data |= {"size_m": [0.016, 0.02], "cells": [32, 40], "void": [core], "inlet": core}
    data["goal"]["output"] = ends | {"x_m": [0.0, 0.003]}
    data["open"][1], data["solid"] = ends, [{"kind": "box", "x_m": [0.0, 0.008], "y_m": [0.018, 0.02]}]
    data["repeat"]["number"] = 2
    data["schedule"] |= {"iterations": iterations, "ramp": 24, "margin": margin, "sharpness": [2.0, 4.0, 8.0]}
    data["schedule"]["pressure_pa"] = [5e2, 4e3]
    return task_from_dict(data)


def rotary(cells):
    """The shipped ring about a hub, coarse."""
    data = load_task("rotary").model_dump(mode="json", exclude_unset=True)
    data |= {"cells": [cells, cells], "filter_radius_m": 0.0018}
    data["air"] |= {"depth_m": 0.0008}
    data["schedule"] = {"iterations": 44, "ramp": 24, "sharpness": [2.0, 4.0, 8.0], "pressure_pa": [3e2, 3e3]}
    return task_from_dict(data)


@pytest.mark.parametrize("mirrored", [False, True])
def test_cells_have_the_same_variables_and_what_is_beside_them_its_own(mirrored):
    task = bellow(repeat=CELLS | {"mirrored": mirrored})
    domain = make_domain(task)
    x = np.random.default_rng(3).uniform(0.0, 1.0, len(domain.is_given))
    found = (cell_mean(domain) @ x).reshape(domain.grid.counts)
    is_free = ~domain.is_given.reshape(domain.grid.counts)
    x = x.reshape(domain.grid.counts)
    first, second = found[:, 3:6], found[:, 6:9]
    both = is_free[:, 3:6] & is_free[:, 6:9]
    assert np.abs((first - second)[both]).max() < 1e-15
    assert (found[:, [0, 1, 2, 9, 10, 11]] == x[:, [0, 1, 2, 9, 10, 11]]).all()
    assert (found[~is_free] == x[~is_free]).all()
    members = [x[20, 3], x[20, 6]] + ([x[20, 5], x[20, 8]] if mirrored else [])
    assert first[20, 0] == pytest.approx(np.mean(members), abs=1e-15)
    assert np.abs(first - first[:, ::-1])[20].max() < 1e-15 or not mirrored


def test_a_task_without_cells_has_a_variable_for_each_element():
    domain = make_domain(bellow())
    assert (cell_mean(domain).toarray() == np.eye(len(domain.is_given))).all()


def test_quarters_have_the_same_variables_and_given_elements_their_own():
    data = rotary(20).model_dump(mode="json", exclude_unset=True)
    corner = {"kind": "box", "x_m": [0.02, 0.025], "y_m": [0.003, 0.006]}
    domain = make_domain(task_from_dict({**data, "solid": [*data["solid"], corner]}))
    x = np.random.default_rng(3).uniform(0.0, 1.0, len(domain.is_given))
    found = (cell_mean(domain) @ x).reshape(domain.grid.counts)
    is_given, x = domain.is_given.reshape(found.shape), x.reshape(found.shape)
    assert is_given.any()
    assert (found[is_given] == x[is_given]).all()
    assert (np.rot90(is_given) != is_given).any()
    total, count = (
        sum(np.rot90(of, k) for k in range(4)) for of in (np.where(is_given, 0.0, x), ~is_given * 1)
    )
    assert np.abs(found - total / np.maximum(count, 1))[~is_given].max() < 1e-15


@pytest.mark.parametrize("angle", [0.02, -0.9])
def test_an_output_that_turns_about_a_point_moves_by_its_mean_arm(angle):
    domain = make_domain(rotary(20))
    arm = domain.grid.mesh.points - 0.014
    c, s = np.cos(angle), np.sin(angle)
    u = arm @ np.array([[c, s], [-s, c]]) - arm
    rim = np.linspace(-0.014, 0.014, 21)
    rim = 0.5 * np.hypot(rim, 0.014)[1:] + 0.5 * np.hypot(rim, 0.014)[:-1]
    assert (domain.output * u).sum() == pytest.approx(rim.mean() * s)
    assert turn_of(domain.grid.mesh.points, u) == pytest.approx(-angle)
    shift = np.tile([0.3, -0.2], (len(u), 1))
    assert abs((domain.output * shift).sum()) < 1e-15


@pytest.mark.slow
def test_a_ring_turns_to_the_left_about_its_hub():
    task = rotary(28)
    state = optimise(task)
    domain = make_domain(task)
    found = shape(domain, state)
    assert not found.leak
    moved = reanalyse(domain, found)
    assert np.degrees(moved.turn) < -20.0
    grids = analysis(domain)
    one, four = (grids.evaluate(state.density, q, 3e3, state.u).motion_m for q in (1.0, 4.0))
    assert one < moved.motion_m < four
    turned = np.array([np.rot90(state.density.reshape(28, 28), k) for k in range(4)])
    assert np.abs(turned - turned[0]).max() < 1e-9


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("goal", {"goal": {"direction": [1.0, 0.0]}}),
        ("goal", {"goal": {"about_m": None}}),
        ("goal.output", {"goal": {"output": []}}),
        ("goal.output[1]", {"goal": {"output": [{"kind": "box"}, {"kind": "box", "x_m": [1.0, 2.0]}]}}),
        ("goal.output[1]", {"goal": {"output": [{"kind": "box"}, INSIDE]}}),
        ("schedule", {"schedule": {"pressure_pa": [1e3, 1e3], "penalty": [1.0, 4.0, 1.0], "ramp": 58}}),
        ("quarter_turns", {"cells": [20, 24]}),
        ("quarter_turns", {"repeat": {"along": "x", "pitch_m": 0.007, "number": 2}}),
        ("quarter_turns", {"mirrors": ["x"]}),
        ("about_m", {"space": "axisymmetric", "quarter_turns": False}),
    ],
)
def test_tasks_that_turn_are_refused_in_one_line(key, change):
    data = rotary(20).model_dump(mode="json", exclude_unset=True)
    data |= change | {"goal": data["goal"] | change.get("goal", {})}
    with pytest.raises(ConfigError) as caught:
        make_domain(task_from_dict(data))
    assert key in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "names"),
    [
        ({"pitch_m": 0.003}, ("repeat.pitch_m", "0.003", "a multiple of an element")),
        ({"from_m": "1 mm"}, ("repeat.from_m", "0.001", "a multiple of an element")),
        ({"number": 4}, ("repeat", "cells up to 0.0125 m", "0.01 m")),
        ({"number": 1}, ("repeat.number", "greater than or equal to 2")),
        ({"along": "z"}, ("z in space solid alone",)),
    ],
)
def test_cells_that_do_not_fit_are_refused_in_one_line(change, names):
    with pytest.raises(ConfigError) as raised:
        optimise(bellow(repeat=CELLS | change), until=1)
    assert all(name in str(raised.value) for name in names), raised.value
    assert "\n" not in str(raised.value)


def test_several_inlets_are_all_pressed_and_the_wrong_one_is_named():
    seeds = [{"kind": "disc", "centre_m": [x, 0.002], "radius_m": 0.0018} for x in (0.003, 0.009)]
    domain = make_domain(bellow(inlet=seeds[0], void=seeds))
    both = make_domain(bellow(inlet=seeds, void=seeds))
    other = make_domain(bellow(inlet=seeds[1:], void=seeds))
    assert (both.is_inlet == domain.is_inlet | other.is_inlet).all()
    assert both.is_inlet.sum() > domain.is_inlet.sum() > 0
    away = {"kind": "disc", "centre_m": [0.5, 0.5], "radius_m": 0.001}
    with refused("inlet[1]"):
        make_domain(bellow(inlet=[seeds[0], away], void=seeds))


@pytest.mark.parametrize("inlet", [5, []])
def test_an_inlet_is_a_region_or_a_list_of_them(inlet):
    with pytest.raises(ConfigError) as raised:
        bellow(inlet=inlet)
    assert "a region, or a list of them" in str(raised.value)


def test_an_inlet_that_is_full_of_solid_is_named():
    seeds = [{"kind": "disc", "centre_m": [x, 0.002], "radius_m": 0.0018} for x in (0.003, 0.012)]
    domain = make_domain(bellow(inlet=seeds, void=[]))
    level = np.where(np.linalg.norm(domain.grid.centres - seeds[0]["centre_m"], axis=1) < 0.003, 0.0, 1.0)
    assert final_part(domain, contour(domain, level)).leak.startswith("inlet[1] is full of solid")


def test_a_run_of_cells_and_a_margin_goes_on_as_if_it_had_not_stopped(tmp_path):
    task = bellow(repeat=CELLS, schedule={"margin": 0.1})
    write_task(task, tmp_path / "task.yaml")
    assert load_task(tmp_path / "task.yaml") == task
    through = optimise(task)
    save(optimise(task, until=10), tmp_path)
    again = optimise(task, load_state(tmp_path, make_domain(task)))
    assert (again.x == through.x).all()


def test_the_slope_of_the_mean_of_both_parts_is_that_of_differences():
    """Through projections at two thresholds, the filter and the cells."""
    task = with_changes(
        load_task("arch"),
        cells=(20, 10),
        filter_radius_m=12.0,
        repeat={"along": "x", "pitch_m": 20.0, "number": 4},
    )
    task = with_changes(task, schedule=with_changes(task.schedule, margin=0.2, sharpness=(4.0,)))
    domain, k = make_domain(task), task.schedule.iterations - 1
    found = analysis(domain)
    weights = density_filter(domain.grid, task.filter_radius_m) @ aslinearoperator(cell_mean(domain))
    x = np.random.default_rng(4).uniform(0.2, 0.9, 200)

    def at(x):
        designs = designs_at(domain, weights, x, k)
        every = [found.evaluate(density, 3.0, 1.0) for _, density, _ in designs]
        return every[0], *goal_of(weights, every, designs)

    part, goal, gradient = at(x)
    assert goal > part.objective  # the thinner part gives way more
    along = np.sign(gradient)
    higher, lower = (at(x + step * along)[1] for step in (1e-5, -1e-5))
    assert gradient @ along == pytest.approx((higher - lower) / 2e-5, rel=1e-6)


def test_a_thinner_part_that_is_torn_lowers_no_pressure_and_does_not_count(monkeypatch):
    evaluated, whole = optimiser._evaluated, []

    def torn(found, density, *rest):
        if whole and (density <= whole[-1]).all() and (density < whole[-1]).any():
            raise ModelError("no equilibrium: torn")
        whole.append(density)
        return evaluated(found, density, *rest)

    monkeypatch.setattr(optimiser, "_evaluated", torn)
    found = optimise(bellow(schedule={"margin": 0.2}))
    assert {row.eased for row in found.rows} == {1.0}
    assert np.isnan([row.thinner_pa for row in found.rows]).all()
    assert (found.x == optimise(bellow()).x).all()
    monkeypatch.undo()
    counted = optimise(bellow(schedule={"margin": 0.2})).rows
    assert [np.isfinite(row.thinner_pa) for row in counted] == 8 * [False] + 6 * [True]
    assert all(row.thinner_pa <= row.pressure_pa for row in counted[8:])


def test_the_penalty_falls_with_the_last_sharpness():
    schedule = folds().schedule
    assert schedule.sharpness == (2.0, 4.0, 8.0)
    assert [schedule.at(k)[1] for k in (0, 23, 36, 37, 43)] == [1.0, 4.0, 4.0, 4.0, 4.0]
    falling = with_changes(schedule, penalty=(1.0, 4.0, 1.5))
    assert [falling.at(k)[1:] for k in (36, 37, 43)] == [(4.0, 4.0), (4.0, 4.0), (1.5, 8.0)]
    with refused("schedule"):
        bellow(schedule={"penalty": [1.0, 4.0, 1.0], "sharpness": []})


def test_the_margin_grows_after_the_ramp_and_leaves_room_for_the_threshold():
    schedule = folds().schedule
    assert [schedule.margin_at(k) for k in (0, 23, 33, 43)] == pytest.approx([0.0, 0.0, 0.1, 0.2])
    with refused("schedule"):
        folds(margin=0.5)


@pytest.mark.parametrize("angle", [-1.9, 0.0, 0.3, 2.5])
def test_the_turn_of_an_output_is_that_of_its_points(angle):
    points = np.random.default_rng(5).normal(size=(7, 2))
    c, s = np.cos(angle), np.sin(angle)
    moved = points @ np.array([[c, -s], [s, c]]) + [0.3, -2.0]  # (0, 1) to (s, c)
    assert turn_of(points, moved - points) == pytest.approx(angle, abs=1e-12)


@pytest.mark.slow
def test_walls_keep_a_width_by_the_margin_and_cells_are_alike():
    widths = {}
    for margin in (0.0, 0.2):
        task = folds(margin)
        domain = make_domain(task)
        state = optimise(task)
        part = shape(domain, state)
        assert not part.leak
        widths[margin] = least_widths(domain, part.mesh).solid_m
        x = state.x.reshape(domain.grid.counts)[8:]  # beyond the given void
        assert x[:, :16] == pytest.approx(x[:, 16:32], abs=1e-9)
        assert x[:, :16] == pytest.approx(x[:, 15::-1], abs=1e-9)
    print(f"least wall: {1e3 * widths[0.0]:.2f} mm without, {1e3 * widths[0.2]:.2f} mm with a margin")
    assert widths[0.2] > 1.4 * widths[0.0]
