"""A link that bending pulls short: where its balance ends, and walls that touch and hold it."""

import numpy as np
import pytest
from collapsing import ALPHA_KAPPA, K_E, LENGTH, LIMIT_PA, bent_arm
from differences import extrapolated

from soro_core import SoftArm, robot_from_dict
from soro_core.errors import ModelError
from soro_core.model.equilibrium.statics import NoBalanceError, equilibrium
from soro_core.robot.collapse import collapsing
from tests.refused import fails


@pytest.mark.parametrize("alpha_eps", [0.0, 1e-6, 3e-6])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_branch_from_rest_ends_at_the_limit_of_the_document(alpha_eps, sign):
    """alpha_kappa p = 0.325 L^2 sqrt(k_b k_e) (1 + e)^2 with e = alpha_eps p / (k_e L^2)."""
    with pytest.raises(NoBalanceError) as caught:
        equilibrium(bent_arm(alpha_eps), [sign * 3.0 * LIMIT_PA])
    (reached,) = caught.value.reached_pa
    e = alpha_eps * reached / (K_E * LENGTH**2)
    assert reached == pytest.approx(sign * LIMIT_PA * (1.0 + e) ** 2, rel=1e-6)
    assert caught.value.key == "equilibrium"


def test_two_chambers_collapse_a_link_where_the_check_of_a_robot_file_says():
    chambers = [{"angle_rad": angle, "alpha_eps": 1e-6, "alpha_kappa": ALPHA_KAPPA} for angle in (0.3, 1.5)]
    arm = bent_arm(robot={"pressure_range_pa": [0.0, LIMIT_PA]}, chambers=chambers)
    (limit,) = collapsing(arm.robot)
    with pytest.raises(NoBalanceError) as caught:
        equilibrium(arm, [2.0 * LIMIT_PA] * 2)
    assert caught.value.reached_pa == pytest.approx([limit.pressure_pa] * 2, rel=1e-5)


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99, 0.9999])
def test_up_to_there_the_equilibrium_is_that_of_the_closed_form(share):
    """(alpha_kappa p)^2 = k_b k_e L^4 (-eps) (1 + eps)^3, of whose two roots the branch has the first."""
    arm = bent_arm()
    q = equilibrium(arm, [share * LIMIT_PA])
    roots = np.roots([1.0, 3.0, 3.0, 1.0, share**2 * 27.0 / 256.0])
    wanted = max(root.real for root in roots if abs(root.imag) < 1e-9)
    assert q[0] == pytest.approx(wanted, abs=1e-6)
    force = arm.elastic_force(q) - arm.actuation_matrix(q)[:, 0] * share * LIMIT_PA
    assert np.abs(force).max() < 1e-6 * ALPHA_KAPPA * LIMIT_PA


def test_with_walls_the_branch_goes_on_behind_its_turn():
    arm = bent_arm(least_elongation=-0.6)
    before, behind = (equilibrium(arm, [share * LIMIT_PA]) for share in (0.9, 1.3))
    assert before[0] > -0.25
    assert -0.6 < behind[0] < -0.3
    stiffness = extrapolated(
        lambda q: arm.elastic_force(q) - 1.3 * LIMIT_PA * arm.actuation_matrix(q)[:, 0],
        behind,
        np.array([1e-3, 0.1, 0.1]),
    )
    assert np.linalg.eigvalsh(0.5 * (stiffness + stiffness.T)).min() > 0.0


def test_a_start_is_searched_from_and_not_left():
    """The unstable balance beyond the turn, which the search from there finds."""
    arm, p = bent_arm(), [0.9 * LIMIT_PA]
    near = equilibrium(arm, p)
    roots = np.roots([1.0, 3.0, 3.0, 1.0, 0.81 * 27.0 / 256.0]).real
    eps = sorted(root for root in roots if -1.0 < root < -0.25)[0]
    far = equilibrium(arm, p, [eps, *(near[1:] * ((1.0 + near[0]) / (1.0 + eps)) ** 2)])
    assert far[0] == pytest.approx(eps, abs=1e-6)


def two_links(**keys):
    common = {"radius": 0.02, "mass": 0.05, "k_b": [0.05, 0.01, 0.5], "least_elongation": -0.3, **keys}
    uniform = {**common, "length": 0.1, "k_e": [400.0, 150.0, 20.0]}
    elongation = {"basis": "legendre", "order": 1}
    varying = {**common, "length": 0.07, "k_e": [300.0, 0.0, 0.0]}
    varying["strains"] = {"elongation": elongation, "bending_x": {}, "bending_y": {}}
    return robot_from_dict({"links": [uniform, varying], "tip_mass": 0.02})


Q = np.array([-0.24, 6.0, -3.0, -0.15, 0.08, 5.0, 2.0])
STEP = np.array([1e-2, 1.0, 1.0, 1e-2, 1e-2, 1.0, 1.0])


def test_walls_push_by_the_gradient_of_their_energy_and_exact_stiffness():
    arm = SoftArm(two_links())
    none = np.zeros(arm.n_q)
    gradient = extrapolated(lambda q: np.array([arm.energy(q, none)[2]]), Q, STEP)[0]
    assert arm.elastic_force(Q) == pytest.approx(gradient, rel=1e-8, abs=1e-8)
    slope = extrapolated(arm.elastic_force, Q, STEP)
    np.testing.assert_allclose(arm.stiffness_matrix(Q), slope, atol=1e-8 * np.abs(slope).max())
    open_robot = two_links(least_elongation=None)
    without = SoftArm(open_robot).elastic_force(Q)
    assert arm.elastic_force(Q)[0] < 1.5 * without[0] < 0.0


def test_walls_change_nothing_in_extension_and_little_near_rest():
    with_walls, without = (SoftArm(two_links(least_elongation=least)) for least in (-0.3, None))
    np.testing.assert_array_equal(
        with_walls.elastic_force(-Q * [1, 1, 1, 1, 0, 1, 1]),
        without.elastic_force(-Q * [1, 1, 1, 1, 0, 1, 1]),
    )
    np.testing.assert_array_equal(with_walls.stiffness_matrix(0 * Q), without.stiffness_matrix(0 * Q))
    near = 0.05 * Q
    np.testing.assert_allclose(with_walls.elastic_force(near), without.elastic_force(near), rtol=3e-3)


def test_walls_are_linear_in_the_parameters_of_the_law():
    arm = SoftArm(two_links())
    pi = np.concatenate([[law[0], law[1], law[3], law[4]] for law in arm.tables.law])
    np.testing.assert_allclose(arm.elastic_regressor(Q) @ pi, arm.elastic_force(Q), rtol=1e-12)


def test_walls_are_those_of_the_parts_of_a_link():
    robot = robot_from_dict({"links": two_links().model_dump(exclude_unset=True)["links"][:1]})
    fine, q = SoftArm(robot.refine(3)), np.array([-0.2, 4.0, 1.0])
    none = np.zeros(9)
    whole = SoftArm(robot).energy(q, none[:3])[2]
    assert fine.energy(np.tile(q, 3), none)[2] == pytest.approx(whole, rel=1e-12)


def test_beyond_its_walls_a_link_has_no_forces():
    arm = SoftArm(two_links())
    with fails(ModelError, key="elongation"):
        arm.elastic_force(np.array([-0.3, 0, 0, 0, 0, 0, 0]))
    with fails(ModelError, key="elongation"):
        bent_arm().elastic_force([-0.99, 0.0, 0.0])
    assert np.isfinite(bent_arm().elastic_force([-0.9, 100.0, 0.0])).all()
