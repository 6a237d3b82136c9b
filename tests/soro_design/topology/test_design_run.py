"""Iterations, going on with them, and tasks that cannot end well."""

import pytest

from soro_core.config import with_changes
from soro_core.errors import ConfigError, ModelError
from soro_design.topology import load_state, make_domain, optimise, reanalyse, save, shape
from soro_design.topology.optimise import first_state
from soro_design.topology.task import load_task
from tests.refused import fails, refused
from tests.soro_design.topology.small import bellow


def test_a_run_that_goes_on_is_the_one_that_was_not_interrupted(tmp_path):
    task = bellow()
    domain = make_domain(task)
    through = optimise(task)
    stopped = optimise(task, until=3)
    save(stopped, tmp_path)
    again = optimise(task, load_state(tmp_path, domain))
    assert str(again.rows) == str(through.rows)  # where nan is nan
    for name in ("x", "u", "density", "pressure", "frames"):
        assert (getattr(again, name) == getattr(through, name)).all()


def test_the_objective_falls_and_the_volume_keeps_its_limit():
    """Under a schedule that does not change, so that the iterations compare."""
    schedule = {
        "ramp": 0,
        "pressure_pa": [2e3, 2e3],
        "penalty": [2.0, 2.0],
        "sharpness": [],
        "iterations": 12,
    }
    rows = optimise(bellow(schedule=schedule)).rows
    assert rows[-1].objective < 1.5 * rows[0].objective < 0.0
    assert max(row.volume for row in rows[4:]) < 0.251
    assert max(row.residual for row in rows) <= 1e-7


def test_the_coarse_arch_gets_stiffer_by_as_much_as_its_air_allows():
    """50 x 25 elements: the work of the pressure over 1000 at the first iteration (benchmarks: 100 x 50)."""
    task = load_task("arch")
    coarse = with_changes(task, cells=(50, 25), schedule=with_changes(task.schedule, iterations=40))
    state = optimise(coarse)
    work = 1000.0 * state.rows[-1].objective / state.rows[0].objective
    print(f"work {work:.2f}")
    assert work < 40.0
    assert not shape(make_domain(coarse), state).leak


@pytest.mark.slow
def test_a_pressure_without_equilibrium_is_lowered_and_named():
    """Far beyond what the silicone bears: the row says by how much the pressure was lowered."""
    task = bellow(schedule={"pressure_pa": [3e6, 3e6], "iterations": 1, "ramp": 0})
    with fails(ModelError, "iteration 1", "no equilibrium"):
        optimise(task)
    task = bellow(schedule={"pressure_pa": [5e4, 5e4], "iterations": 1, "ramp": 0, "penalty": [1.0, 1.0]})
    row = optimise(task).rows[0]
    assert row.eased < 1.0
    assert row.pressure_pa == pytest.approx(5e4 * row.eased)


@pytest.mark.slow
def test_a_run_whose_pressure_stays_low_stops_with_the_cause_and_can_go_on(tmp_path):
    """Its goal asks for a softer and softer part, and rewards no stiffness: none bears the pressure."""
    schedule = {"pressure_pa": [6e4, 6e4], "iterations": 22, "ramp": 0, "penalty": [1.0, 1.0]}
    task = bellow(goal={"energy_exponent": 0.0}, schedule=schedule | {"sharpness": []})
    kept = []
    with fails(ModelError, "iteration 20", "for 20 iterations", "spring_pa", "--resume"):
        optimise(task, progress=kept.append)
    lowered = [row.eased for row in kept[-1].rows]
    assert max(lowered) < 1.0
    assert len(optimise(task, kept[-1]).rows) == 22


@pytest.mark.slow
def test_a_disc_about_an_axis_keeps_its_pressure_and_is_sealed():
    """The shipped task on a coarse grid: every pressure of the schedule has an equilibrium."""
    task = load_task("disc")
    schedule = with_changes(
        task.schedule, iterations=16, ramp=10, pressure_pa=(2e3, 6e3), sharpness=(4.0, 8.0)
    )
    coarse = with_changes(task, cells=(32, 16), filter_radius_m=1.6e-3, schedule=schedule)
    domain = make_domain(coarse)
    state = optimise(coarse)
    assert min(row.eased for row in state.rows) == 1.0
    found = shape(domain, state)
    assert not found.leak
    assert reanalyse(domain, found).motion_m > 1e-3


def test_a_later_start_replaces_an_earlier_one():
    left, all_ = {"kind": "box", "x_m": [0.0, 0.01]}, {"kind": "box"}
    start = [{"where": all_, "density": 0.1}, {"where": left, "density": 0.7}]
    domain = make_domain(bellow(start=start))
    free = ~domain.is_given
    is_left = domain.grid.centres[:, 0] < 0.01
    assert (domain.start()[free & is_left] == 0.7).all()
    assert (domain.start()[free & ~is_left] == 0.1).all()
    assert (domain.start()[domain.is_solid] == 1.0).all()


HELD_TOP = {"where": {"kind": "box", "y_m": [0.01, 0.01]}, "along": ["y"]}


@pytest.mark.parametrize(
    ("key", "changes"),
    [
        ("goal.output", {"held": [HELD_TOP]}),
        ("goal.output", {"goal": {"output": {"kind": "box", "x_m": [0.0, 0.0], "y_m": [0.01, 0.01]}}}),
        ("goal.output", {"goal": {"output": {"kind": "box", "x_m": [0.03, 0.04]}}}),
        ("goal.direction", {"goal": {"direction": [0.0, 0.0]}}),
        ("inlet", {"inlet": {"kind": "disc", "centre_m": [0.5, 0.0], "radius_m": 1e-3}}),
        ("open", {"inlet": {"kind": "box"}}),
        ("void", {"void": [{"kind": "box"}]}),
        ("void", {"void": [{"kind": "box", "y_m": [0.0075, 0.0085]}]}),
        ("start[0].where", {"start": [{"where": {"kind": "box", "x_m": [0.03, 0.04]}, "density": 0.5}]}),
        ("start[0].density", {"start": [{"where": {"kind": "box"}, "density": 1.5}]}),
        ("void[0]", {"void": [{"kind": "disc", "centre_m": [0.5, 0.0], "radius_m": 1e-3}]}),
        ("volume_fraction", {"solid": [{"kind": "box", "x_m": [0.0, 0.01]}], "void": []}),
        ("solid[0].kind", {"solid": [{"kind": "ball"}]}),
        ("schedule", {"schedule": {"ramp": 99}}),
        ("cells[0]", {"cells": [1, 9]}),
        ("goal.material", {"goal": {"material": 3}}),
        ("air.depth_m", {"air": {"depth_m": -1.0}}),
        ("space", {"space": "cube"}),
    ],
)
def test_bad_tasks_are_refused_in_one_line(key, changes):
    with refused(key):
        make_domain(bellow(**changes))


def test_a_part_that_no_wall_can_seal_is_refused_with_the_place():
    way = {"kind": "box", "x_m": [0.0, 0.02], "y_m": [0.0, 0.002]}
    with refused("void", names=("wall",)) as caught:
        optimise(bellow(void=[way]))
    assert "(20, 0) mm" in str(caught.value)


@pytest.mark.slow
def test_a_design_that_leaks_says_where():
    """The start is grey everywhere; with a threshold above it all is void."""
    task = bellow(schedule={"iterations": 1, "ramp": 0})
    domain = make_domain(task)
    state = optimise(task)
    found = shape(domain, state)
    assert "not sealed" in found.leak
    assert found.air.is_leak.any()


def test_air_that_meets_nothing_ends_with_a_reason():
    """All void but the pad at the output: the air strains nothing, or too little to count."""
    held = [{"where": {"kind": "box", "x_m": [0.0, 0.0]}, "along": ["x"]}]
    task = bellow(void=[{"kind": "box", "y_m": [0.0, 0.009]}], held=held)
    with pytest.raises((ModelError, ConfigError)) as caught:
        optimise(task)
    assert "\n" not in str(caught.value)


def test_states_of_other_runs_are_refused(tmp_path):
    domain = make_domain(bellow())
    with refused("", names=("soro design",)):
        load_state(tmp_path, domain)
    save(first_state(make_domain(bellow(cells=[20, 10]))), tmp_path)
    with refused("x", names=("288",)):
        load_state(tmp_path, domain)
    whole = (tmp_path / "state.npz").read_bytes()
    for content in (b"nothing", whole[: len(whole) // 2]):
        (tmp_path / "state.npz").write_bytes(content)
        with refused(""):
            load_state(tmp_path, domain)
