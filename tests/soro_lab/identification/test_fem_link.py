"""The link of a part: numbers come back from states that a link made, errors are those of tips, refusals."""

import numpy as np
import pytest
from made_rod import KNOWN, LENGTH, VALUES, Z, made_data, made_states

from soro_design.parts.file import LoadSweep
from soro_design.robot_of_part.direct import direct
from soro_design.robot_of_part.joint import refine, tip_errors
from soro_design.robot_of_part.link import at_bound, parameters, robot_of
from soro_design.robot_of_part.snapshots import check_sweeps, snapshots
from tests.refused import refused

DATA = made_data()


def test_strains_are_those_of_a_robot():
    arm_states = [state for state in DATA.uneven if state.sweep == "two"]
    last = DATA.strains(arm_states[-1])
    assert np.ptp(last, axis=0) == pytest.approx(0.0, abs=1e-10)
    # Chambers at 0 and 120 degrees push the tip away from both.
    assert last[0, 1] < 0.0
    assert last[0, 2] < 0.0
    assert DATA.mean(arm_states[-1]) == pytest.approx(last[0])


def test_single_loads_give_the_stiffness_at_rest_and_first_numbers_of_chambers():
    first = direct(made_data(n=16))
    assert first.k_b_nm == pytest.approx(VALUES["k_b_rest"], rel=1e-3)
    assert first.k_e_n_per_m == pytest.approx(VALUES["k_e_rest"], rel=0.01)
    assert first.area_m2 == pytest.approx(VALUES["area_m2"], rel=0.01)
    assert first.area_slope == pytest.approx(VALUES["area_slope"], rel=0.02)
    assert first.offset_m == pytest.approx(VALUES["offset_m"], rel=0.03)


def test_shear_is_no_part_of_the_bending_stiffness():
    stiff, soft = direct(DATA), direct(made_data(n=1, shear=0.1))
    assert soft.k_b_nm == pytest.approx(stiff.k_b_nm, rel=1e-3)
    assert soft.k_b_whole_nm < 0.9 * stiff.k_b_whole_nm


@pytest.mark.slow
def test_a_joint_fit_gives_all_numbers_back():
    found = refine(DATA, KNOWN, direct(DATA))
    assert found.converged
    assert found.values == pytest.approx(VALUES, rel=2e-3)
    errors = tip_errors(DATA, robot_of(KNOWN, found.values), DATA.held_out)
    assert max(error.share for error in errors) < 1e-6


def test_numbers_at_a_bound_are_named():
    start = direct(DATA)
    values = {p.name: 0.5 * (p.lower + p.upper) for p in parameters(KNOWN, start)}
    assert at_bound(KNOWN, start, values) == []
    assert at_bound(KNOWN, start, {**values, "k_b_rest": 0.9 * start.k_b_nm}) == ["k_b_rest"]


def test_loads_of_a_single_chamber_are_along_its_bend_and_held_out_ones_are_never_fitted():
    def sweep(name, pressure=0.0, force=(0.0, 0.0, 0.0), **keys):
        return LoadSweep(name=name, pressures_pa=(pressure,) if pressure else (), force_n=force, **keys)

    fitted = [sweep("pull", force=(0.0, 0.0, 1.0)), sweep("side", force=(0.1, 0.0, 0.0)), sweep("blown", 1e3)]
    check_sweeps([*fitted, sweep("pushed", 1e3, (0.1, 0.0, 0.2), held_out=True)], 1, "part")
    with refused("sweeps.side.force_n"):
        check_sweeps([sweep("side", force=(0.0, 0.1, 0.0))], 1, "part")
    with refused("sweeps.both"):
        check_sweeps([sweep("both", 1e3, (0.1, 0.0, 0.0))], 1, "part")
    with refused("sweeps", names=("held_out",)):
        check_sweeps(fitted, 1, "part")
    alone = [fitted[0], sweep("side", force=(0.1, 0.0, 0.0), held_out=True), fitted[2]]
    with refused("sweeps", names=("force_n: [F, 0, 0]",)):
        check_sweeps(alone, 1, "part")
    with refused("sweeps"):
        snapshots(Z, [], "part")


def test_errors_are_distances_of_tips_over_the_length():
    wrong = robot_of(KNOWN, {**VALUES, "k_b_rest": 0.052, "k_b_level": 0.042})
    errors = tip_errors(DATA, wrong, DATA.held_out)
    assert [e.state.sweep for e in errors] == ["mixed"] * 4
    for error in errors:
        assert error.share == pytest.approx(
            np.linalg.norm(error.places[-1] - error.state.poses[-1][:3, 3]) / LENGTH
        )
    assert 0.001 < errors[-1].share < 0.05


@pytest.mark.parametrize("kind", ["pull", "side", "all", "mixed"])
def test_a_missing_kind_of_sweep_is_named(kind):
    with refused("sweeps"):
        snapshots(Z, [state for state in made_states(n=1) if state.sweep != kind], "made")


def test_pressure_and_force_at_once_are_refused():
    states = made_states(n=1)
    states[0].pressures_pa[0] = 1.0
    with refused("sweeps.pull"):
        snapshots(Z, states, "made")
