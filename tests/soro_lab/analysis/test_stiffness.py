"""Stiffness of the tip against forces that displace it, and places at rest near buckling and collapse."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot, robot_from_dict
from soro_core.control.reachable_workspace import reachable
from soro_core.model.equilibrium.rest_forces import RestForces
from soro_core.model.equilibrium.statics import NoBalanceError, stable_equilibrium
from soro_lab.analysis.reach_picture import ellipse
from soro_lab.analysis.stiffness import tangent_stiffness, tip_stiffness
from tests.soro_core.model.collapsing import LIMIT_PA, bent_arm

HANGING = {"base_quaternion": [1.0, 0.0, 0.0, 0.0]}
ARMS = {
    "standing": ("tue_three_bellow", {"tip_mass": 0.01}, [60e3, 10e3, 0.0]),
    "hanging": ("tue_three_bellow", HANGING | {"tip_mass": 0.02}, [60e3, 10e3, 0.0]),
    "two links": ("asu_two_segment", {}, [70e3, 0.0, 30e3, 0.0, 40e3, 20e3]),
    "six links": ("six_link", HANGING, [60e3]),
    "planar, without chambers": ("silicone_rod_planar", {}, []),
}


def at_rest(name):
    robot, keys, pressure = ARMS[name]
    arm, p = SoftArm(load_robot(robot).replace(**keys)), np.array(pressure)
    return arm, p, stable_equilibrium(arm, p)


def displaced_tip(arm, p, q, force):
    """Position of the tip under a force in the world, that keeps its direction, by the model's wrench."""
    forces, x = RestForces(arm, p), q
    inverse = np.linalg.inv(forces.stiffness(q))
    for _ in range(30):
        turned = arm.pose(x, arm.length)[:3, :3].T @ force
        wrench = arm.external_forces(x, wrench=[0, 0, 0, *turned]).generalised
        x = x - inverse @ (forces.unbalanced(x) - wrench)
    return arm.pose(x, arm.length)[:3, 3]


@pytest.mark.parametrize("name", ARMS)
def test_a_force_displaces_the_tip_by_the_compliance(name, figure):
    arm, p, q = at_rest(name)
    tip = tip_stiffness(arm, q, tangent_stiffness(arm, p, q))
    size = 1e-3 * arm.length * tip.stiffness[0]

    def slope(part):
        sides = [displaced_tip(arm, p, q, s * part * size * e) for e in np.eye(3) for s in (1.0, -1.0)]
        return np.stack([(a - b) / (2 * part * size) for a, b in zip(sides[::2], sides[1::2], strict=True)])

    measured = (4.0 * slope(1.0) - slope(2.0)) / 3.0  # without the error of the second order of the force
    error = np.abs(measured - tip.compliance).max() / np.abs(tip.compliance).max()
    figure(f"{name}: compliance {error:.1e} from the measured one")
    assert error < 1e-6
    free = np.isfinite(tip.stiffness)
    along = np.einsum("ka,ab,kb->k", tip.directions, tip.compliance, tip.directions)
    assert tip.stiffness[free] == pytest.approx(1.0 / along[free])
    assert np.all(np.diff(tip.stiffness[free]) >= 0.0)
    assert np.isinf(tip.stiffness[-1]) == ("planar" in name)


def test_one_straight_link_in_closed_form():
    """A link of constant curvature: the tip moves by L^2 / 2 per curvature, and by L per strain."""
    link = {"length": 0.1, "radius": 0.01, "mass": 0.05, "k_e": [300.0, 0.0, 0.0], "k_b": [0.04, 0.0, 0.0]}
    arm = SoftArm(robot_from_dict({"links": [link], "gravity": [0.0, 0.0, 0.0]}))
    q = np.zeros(3)
    tip = tip_stiffness(arm, q, tangent_stiffness(arm, np.zeros(0), q))
    assert tip.stiffness == pytest.approx([4 * 0.04 / 0.1**2] * 2 + [300.0], rel=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_exact_derivatives_and_differences_agree(name):
    arm, p, q = at_rest(name)
    exact, differences = tangent_stiffness(arm, p, q), RestForces(arm, p).stiffness(q)
    unit = np.sqrt(np.diag(exact))
    assert np.abs((exact - differences) / np.outer(unit, unit)).max() < 1e-6


def test_an_arm_without_derivatives_takes_differences():
    robot, _, pressure = ARMS["standing"]
    arm, other = (SoftArm(load_robot(robot), method=method) for method in ("exact", "mde"))
    q = stable_equilibrium(arm, pressure)
    near = stable_equilibrium(other, pressure, q)
    a, b = (tangent_stiffness(x, np.array(pressure), y) for x, y in ((arm, q), (other, near)))
    assert np.abs(a / b - 1.0)[np.abs(b) > 1e-6 * np.abs(b).max()].max() < 1e-2


def test_the_ellipse_is_what_the_force_does():
    compliance = np.diag([0.2, 0.1, 0.0])
    x, z = ellipse(compliance, 0.5, (0, 2))
    assert x.max() == pytest.approx(0.1)
    assert np.abs(z).max() < 1e-12
    x, y = ellipse(compliance, 0.5, (0, 1))
    assert (x / 0.1) ** 2 + (y / 0.05) ** 2 == pytest.approx(np.ones_like(x))


@pytest.mark.slow
def test_places_near_collapse_are_found_and_none_beyond(monkeypatch):
    monkeypatch.setattr("soro_core.control.reachable_workspace.MOST", 51)  # pressures: steps of a fortieth
    arm = bent_arm()
    q = stable_equilibrium(arm, [0.999 * LIMIT_PA])
    assert RestForces(arm, np.array([0.999 * LIMIT_PA])).is_stable(q)
    assert q[0] == pytest.approx(-0.25, abs=0.02)  # docs/model.md (51)
    with pytest.raises(NoBalanceError) as caught:
        stable_equilibrium(arm, [1.01 * LIMIT_PA])
    assert caught.value.reached_pa[0] == pytest.approx(LIMIT_PA, rel=1e-3)
    found = reachable(arm, 0.0, 1.25 * LIMIT_PA)
    assert found.pressure_pa.max() == pytest.approx(LIMIT_PA, rel=2e-3)
    assert found.failed == 10


def test_a_standing_arm_that_buckles_rests_beside_its_base():
    arm = SoftArm(load_robot("six_link"))
    for p in (np.zeros(1), np.array([10e3]), np.array([-80e3])):
        forces, q = RestForces(arm, p), stable_equilibrium(arm, p)
        scale = np.abs(np.diag(forces.stiffness(q)))
        assert np.abs(forces.unbalanced(q) / scale).max() < 1e-6
        assert forces.is_stable(q)
        assert arm.pose(q, arm.length)[2, 3] < 0.0
    straight = np.zeros(arm.n_q)
    assert not RestForces(arm, np.zeros(1)).is_stable(straight)
