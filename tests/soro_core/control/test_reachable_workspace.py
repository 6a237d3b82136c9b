"""Places of the tip at rest: symmetric, within the pressures."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.config import find_config
from soro_core.control import reachable_workspace as reachable_module
from soro_core.control.reachable_workspace import Reachable, pressure_grid, reachable
from soro_core.errors import ModelError
from soro_core.model.equilibrium.rest_forces import RestForces
from soro_core.model.equilibrium.statics import equilibrium


@pytest.fixture
def arm(monkeypatch):
    monkeypatch.setattr(reachable_module, "MOST", 27)
    return SoftArm(load_robot(find_config("tue_three_bellow", "robots")))


def test_the_places_are_rests_under_pressures_of_the_range(arm):
    found = reachable(arm, 0.0, 60e3, load_kg=0.01)
    assert found.pressure_pa.shape == (27, 3)
    assert {*np.unique(found.pressure_pa)} == {0.0, 30e3, 60e3}
    k = int(np.argmax(found.tip_m[:, 0]))
    loaded = SoftArm(arm.robot.replace(tip_mass=0.01))
    q = equilibrium(loaded, found.pressure_pa[k], found.q[k])
    assert loaded.pose(q, arm.length)[:3, 3] == pytest.approx(found.tip_m[k], abs=1e-6)
    numbers = dict(found.numbers())
    assert float(numbers["z, mm"].split()[-1]) == pytest.approx(1e3 * found.tip_m[:, 2].max(), abs=0.05)
    assert numbers["combinations of pressures"].startswith("27, 0 ")


def test_round_off_below_zero_is_printed_as_zero():
    one = np.array([[-1e-9, 0.0, 0.06]])
    numbers = dict(Reachable(one, one, one, one[0], 0).numbers())
    assert numbers["x, mm"] == "0.0 to 0.0"
    assert numbers["tip at the lowest pressures, mm"] == "0.0, 0.0, 60.0"


def test_more_load_lowers_the_places_and_an_unstable_rest_is_none(arm):
    light, heavy = (reachable(arm, 0.0, 60e3, load) for load in (0.0, 0.02))
    assert heavy.rest_m[2] < light.rest_m[2]
    none = np.zeros(3)
    for load, stable in ((0.0, True), (0.05, False)):
        upright = equilibrium(arm, none, none, load)
        assert np.abs(upright[1:]).max() < 1e-6
        assert RestForces(arm, none, load).is_stable(upright) == stable


def test_tendons_are_pulled_with_their_own_tensions(arm):
    tendons = [{"angle_rad": 0.4, "offset_m": 0.006, "max_tension_n": most} for most in (0.5, 1.0)]
    pulled = reachable(SoftArm(arm.robot.replace(tendons=tendons)), 0.0, 10e3)
    assert pulled.pressure_pa.min(axis=0).tolist() == [0.0] * 5
    assert pulled.pressure_pa.max(axis=0).tolist() == [10e3, 10e3, 10e3, 0.5, 1.0]


def test_many_chambers_are_sampled(monkeypatch):
    grid = pressure_grid(np.zeros(20), np.ones(20))
    assert len(grid) <= 1001
    assert grid[0].max() == 0.0
    assert 0.3 < grid.mean() < 0.7


@pytest.mark.slow
def test_an_arm_without_a_stable_rest_is_one_line(arm, monkeypatch):
    monkeypatch.setattr(RestForces, "is_stable", lambda *of: False)
    with pytest.raises(ModelError, match="no stable rest"):
        reachable(arm, 0.0, 60e3)
