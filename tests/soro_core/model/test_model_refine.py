"""A refined robot is the same physics."""

import numpy as np
import pytest
from sample_arms import chambers, law_link, material_link
from scipy.optimize import root

from soro_core import SoftArm, robot_from_dict
from tests.refused import refused


def robot(**keys):
    rng = np.random.default_rng(3)
    link = law_link(
        rng,
        chambers=chambers(rng, area_slope=-1.5),
        damping=[0.1, 1e-5, 2e-5],
        creep=[{"tau": 0.05, "stiffness": [10.0, 1e-3, 2e-3]}],
        hysteresis=[{"stiffness": [5.0, 1e-4, 1e-4], "range": [0.01, 1.0, 1.0]}],
        **keys,
    )
    gains = [{"angle_rad": 1.0, "alpha_eps": 3e-6, "alpha_kappa": 2e-8}]
    silicone = material_link(rng, ("bending_x", "elongation", "bending_y"), chambers=gains)
    return robot_from_dict({"links": [link, silicone], "tip_mass": 0.01})


def spread(q, k):
    """The same uniform strain on every part."""
    return np.concatenate([np.tile(part, k) for part in q.reshape(2, 3)])


@pytest.mark.parametrize("k", [2, 3])
def test_same_energy_and_power_at_uniform_strain(k):
    whole, parts = SoftArm(robot()), SoftArm(robot().refine(k))
    q, qd = np.array([0.1, 5.0, -3.0, 2.0, -0.05, 4.0]), np.array([0.3, 10.0, 20.0, -10.0, 0.2, 5.0])
    p = np.array([1e4, 2e4, 3e4, 4e4])
    many, many_rate = spread(q, k), spread(qd, k)
    np.testing.assert_allclose(parts.energy(many, many_rate), whole.energy(q, qd), rtol=1e-9)
    for power in (
        lambda arm, x, v: v @ arm.damping_force(x, v),
        lambda arm, x, v: v @ arm.elastic_force(x),
        lambda arm, x, v: v @ arm.gravity_force(x),
        lambda arm, x, v: v @ arm.actuation_matrix(x) @ p,
        lambda arm, x, v: v @ arm.internal_force(x, np.ones(arm.n_internal)),
    ):
        assert power(parts, many, many_rate) == pytest.approx(power(whole, q, qd), rel=1e-9)
    np.testing.assert_allclose(parts.pose(many, parts.length), whole.pose(q, whole.length), atol=1e-12)
    assert sum(link.mass for link in parts.robot.links) == pytest.approx(
        sum(link.mass for link in whole.robot.links)
    )


def test_chambers_and_names():
    fine = robot().refine(2).refine(2)
    assert fine.refinement == 4
    assert len(fine.links) == 8
    assert fine.n_u == robot().n_u
    assert (
        fine.chamber_names
        == robot().chamber_names
        == ("link0/chamber0", "link0/chamber1", "link0/chamber2", "link1/chamber0")
    )
    assert fine.coordinate_names[3:5] == ("link1/elongation", "link1/bending_x")
    H = SoftArm(fine).actuation_matrix()
    base = SoftArm(robot()).actuation_matrix()
    np.testing.assert_allclose(H.reshape(2, 4, 3, 4).sum(axis=1), base.reshape(2, 3, 4))
    assert (np.abs(H[:12, :3]) > 0).all()
    assert (H[12:, :3] == 0).all()
    assert (np.abs(H[12:, 3]) > 0).all()
    assert robot().refine(1) == robot()
    with refused("refine", 0, ("1",)):
        robot().refine(0)


def test_statics_converge_with_refinement():
    """Under its own weight and pressure the tip moves less and less with every halving."""
    tips = []
    for k in (1, 2, 4, 8):
        arm = SoftArm(robot().replace(base_quaternion=[0.0, 1.0, 0.0, 0.0], tip_mass=0.03).refine(k))
        p = np.array([1e5, 0.0, 0.0, 1e4])
        balance = root(
            lambda q, arm=arm, p=p: arm.gravity_force(q) + arm.elastic_force(q) - arm.actuation_matrix(q) @ p,
            np.zeros(arm.n_q),
        )
        assert balance.success
        tips.append(arm.pose(balance.x, arm.length)[:3, 3])
    moves = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    assert moves[1] < 0.5 * moves[0]
    assert moves[2] < 0.5 * moves[1]


def test_scaled_changes_what_it_says():
    base, other = SoftArm(robot()), SoftArm(robot().scaled(stiffness=1.1, damping=0.8, gain=0.9))
    q, qd = np.array([0.1, 5.0, -3.0, 2.0, -0.05, 4.0]), np.ones(6)
    np.testing.assert_allclose(other.elastic_force(q), 1.1 * base.elastic_force(q), rtol=1e-6)
    np.testing.assert_allclose(other.damping_force(q, qd), 0.8 * base.damping_force(q, qd))
    np.testing.assert_allclose(other.actuation_matrix(q), 0.9 * base.actuation_matrix(q))
    z = np.ones(base.n_internal)
    np.testing.assert_allclose(other.internal_force(q, z), 0.8 * base.internal_force(q, z))
    np.testing.assert_array_equal(other.inertia_matrix(q), base.inertia_matrix(q))
