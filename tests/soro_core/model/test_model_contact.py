"""Contact of the backbone: forces, tangents, and what arms do on planes and spheres."""

import numpy as np
import pytest
from outside_arms import CASES, PLANE, SPHERE, arm_of, gradient, loose_arm, state_of

from soro_core import SoftArm, robot_from_dict, simulate
from soro_core._box import view
from soro_core._jit import kernel
from soro_core.errors import ConfigError, ModelError
from soro_core.model.entries import make_box
from soro_core.model.method import factor_system, inverse_dynamics, solve_system
from soro_core.model.records import Motion, TangentFactors
from soro_core.model.tables import CONTACT
from tests.refused import fails
from tests.small_links import LAW

LOSSY = {"damping": 0.5, "friction": 0.6, "slip_velocity": 0.05}


def obstacles(**law):
    return {"planes": [{**PLANE, **law}], "spheres": [{**SPHERE, **law}], "points_per_link": 4}


def touching(n_links, basis, **law):
    """Arm, state and number of points that touch; both obstacles are met."""
    arm = arm_of(n_links, basis, contacts=obstacles(**law))
    q, qd = state_of(arm)
    assert (np.linalg.norm(arm.external_forces(q).force, axis=1) > 0).sum() >= 2
    return arm, q, qd


def law(robot, x, u, radius):
    """Force at one point in plain numpy, and where on the section each obstacle presses, from its centre."""
    for body in (*robot.contacts.planes, *robot.contacts.spheres):
        if hasattr(body, "normal"):
            n = np.array(body.normal) / np.linalg.norm(body.normal)
            depth = radius - n @ (x - np.array(body.point))
        else:
            n = x - np.array(body.centre)
            depth = radius + body.radius - np.linalg.norm(n)
            n = n / np.linalg.norm(n)
        if depth > 0:
            arm = -radius * n
            at = u[1] + np.cross(u[0], arm)
            normal = body.stiffness * depth * max(0.0, 1 - body.damping * (n @ at))
            slip = at - n * (n @ at)
            force = normal * n - body.friction * normal * slip / np.hypot(
                np.linalg.norm(slip), body.slip_velocity
            )
            yield arm, force


@pytest.mark.parametrize(("n_links", "basis"), CASES)
def test_forces_are_the_gradient_of_the_stored_energy(n_links, basis):
    arm, q, _ = touching(n_links, basis, friction=0.5, damping=1.0)  # neither acts at rest
    force = arm.external_forces(q).generalised
    slope = gradient(lambda x: arm.external_forces(x).energy, q)
    np.testing.assert_allclose(force, -slope, atol=1e-7 * np.abs(force).max())


@pytest.mark.parametrize(("n_links", "basis"), CASES)
def test_forces_enter_by_the_jacobian_of_the_point_that_touches(n_links, basis):
    arm, q, qd = touching(n_links, basis, **LOSSY)
    found = arm.external_forces(q, qd)
    want = np.zeros(arm.n_q)
    for s, force in zip(found.place, found.force, strict=True):
        g, J = arm.pose(q, s), arm.jacobian(q, s)
        turned = np.vstack([g[:3, :3] @ J[:3], g[:3, :3] @ J[3:]])
        total = np.zeros(3)
        twist = (turned[:3] @ qd, turned[3:] @ qd)
        for lever, one in law(arm.robot, g[:3, 3], twist, 0.01):
            want += turned[3:].T @ one + turned[:3].T @ np.cross(lever, one)
            total += one
        np.testing.assert_allclose(force, total, atol=1e-10)
    assert np.abs(want).max() > 0.1
    np.testing.assert_allclose(found.generalised, want, atol=1e-10 * np.abs(want).max())


@pytest.mark.slow
def test_forward_dynamics_has_the_same_forces():
    arm, q, qd = touching(2, "legendre", **LOSSY)
    right = arm.external_forces(q, qd).generalised
    left = arm.inertia_matrix(q) @ arm.forward_dynamics(q, qd, [])
    left += arm.coriolis_force(q, qd) + arm.gravity_force(q) + arm.elastic_force(q) + arm.damping_force(q, qd)
    np.testing.assert_allclose(left, right, atol=1e-9 * np.abs(right).max())


def test_contact_stays_out_of_the_terms_of_the_arm():
    """What the controller takes for the arm's own inertia and weight knows nothing of a floor."""
    arm, q, qd = touching(2, "constant", **LOSSY)
    bare = SoftArm(arm.robot.replace(contacts=None))
    np.testing.assert_array_equal(arm.inverse_dynamics(q, qd, qd, qd), bare.inverse_dynamics(q, qd, qd, qd))
    np.testing.assert_array_equal(arm.gravity_force(q), bare.gravity_force(q))


def test_out_of_reach_nothing_changes():
    far = {
        "planes": [{**PLANE, "point": [0.0, 0.0, 5.0]}],
        "spheres": [{**SPHERE, "centre": [1.0, 1.0, 1.0]}],
    }
    arm = arm_of(3, "constant", contacts=far)
    q, qd = state_of(arm)
    bare = SoftArm(arm.robot.replace(contacts=None))
    np.testing.assert_array_equal(arm.forward_dynamics(q, qd, []), bare.forward_dynamics(q, qd, []))


@pytest.mark.parametrize("speed", [0.1, 0.4, 0.6, 10.0, 1000.0])
def test_never_pulls(speed):
    """Torn away, the floor pushes less, and at 1 / damping lets go; pressed on, it pushes more."""
    arm = loose_arm(0.009, damping=2.0)
    q, qd = np.zeros(arm.n_q), np.zeros(arm.n_q)
    qd[0] = -speed / 0.05  # shear of the carrier: the rod goes up
    assert arm.pose(0.001 * qd, 0.15)[2, 3] > arm.pose(q, 0.15)[2, 3]
    rest = arm.external_forces(q).force[:, 2]
    assert rest.max() == pytest.approx(200.0 * 0.001)
    np.testing.assert_allclose(
        arm.external_forces(q, qd).force[:, 2], rest * max(0.0, 1 - 2 * speed), atol=1e-12
    )
    assert arm.external_forces(q, -qd).force[5:, 2].min() > rest.max()


@pytest.mark.parametrize("seed", range(6))
def test_friction_and_damping_only_take_energy(seed):
    arm, q, _ = touching(3, "constant", **LOSSY)
    qd = state_of(arm, seed)[1] * 10.0 ** (seed - 3)
    loss = (arm.external_forces(q, qd).generalised - arm.external_forces(q).generalised) @ qd
    assert loss < 0


@kernel
def system(box, q, qd, by_q, by_v, secant, X):
    """Rows of X <- (M - by_q dF/dq - by_v dF/dqd)^-1 rows of X."""
    arm = view(box)
    t, w = arm.tables, arm.work
    inverse_dynamics(t, w, np.zeros(6), Motion(q, qd, qd, qd), 1.0, w.applied)
    good = factor_system(t, w, q, qd, TangentFactors(by_q, by_v, secant))
    for k in range(X.shape[0]):
        solve_system(t, w, X[k])
    return good


def tangent(arm, q, qd, by_q, by_v, secant=0.0):
    X = np.eye(arm.n_q)
    assert system(make_box(arm.tables), q, qd, by_q, by_v, secant, X)
    return np.linalg.inv(X) - arm.inertia_matrix(q)


@pytest.mark.slow
@pytest.mark.parametrize(("n_links", "basis"), CASES)
@pytest.mark.parametrize("law", [{"damping": 0.5}, {"friction": 0.6, "slip_velocity": 0.1}])
def test_tangent_by_velocity(n_links, basis, law):
    """Exact with friction or damping; together, how friction follows the normal force is left out."""
    arm, q, qd = touching(n_links, basis, **law)
    qd *= 0.2
    slope = gradient(lambda v: arm.external_forces(q, v).generalised, qd).T
    assert np.abs(slope).max() > 1e-4
    np.testing.assert_allclose(tangent(arm, q, qd, 0.0, 1.0), -slope, atol=2e-6 * np.abs(slope).max())


@pytest.mark.parametrize(("n_links", "basis"), CASES)
def test_tangent_by_place(n_links, basis):
    """k J' n n' J: the exact derivative but for the turn of normals and columns, which depth alone feeds."""
    arm, q, qd = touching(n_links, basis)
    want = np.zeros((arm.n_q, arm.n_q))
    found = arm.external_forces(q)
    for s in found.place:
        g, J = arm.pose(q, s), arm.jacobian(q, s)
        for lever, _ in law(arm.robot, g[:3, 3], np.zeros((2, 3)), 0.01):
            n = -lever / np.linalg.norm(lever)
            k = (
                800.0
                if abs(n @ np.array(PLANE["normal"]) / np.linalg.norm(PLANE["normal"]) - 1) > 1e-9
                else 500
            )
            row = n @ g[:3, :3] @ J[3:]
            want += k * np.outer(row, row)
    np.testing.assert_allclose(tangent(arm, q, 0 * qd, 1.0, 0.0), want, atol=1e-8 * np.abs(want).max())


@pytest.mark.parametrize("n_links", [1, 3])
def test_the_ratio_of_force_to_velocity_is_the_safe_tangent(n_links):
    """Symmetric, no smaller than the derivative, and a step with it never turns a slip around."""
    arm, q, qd = touching(n_links, "constant", friction=0.6, slip_velocity=1e-3)
    exact, ratio = tangent(arm, q, qd, 0.0, 1.0), tangent(arm, q, qd, 0.0, 1.0, 1.0)
    size = np.abs(ratio).max()
    assert np.linalg.eigvalsh(exact).min() > -1e-9 * size
    assert np.linalg.eigvalsh(ratio - exact).min() > -1e-9 * size
    friction = arm.external_forces(q, qd).generalised - arm.external_forces(q).generalised
    np.testing.assert_allclose(ratio @ qd, -friction, atol=1e-7 * np.abs(friction).max())


def test_parts_of_a_refined_link_meet_the_same_points():
    arm = arm_of(2, "constant", contacts=obstacles(**LOSSY))
    fine = SoftArm(arm.robot.refine(2))
    q, qd = state_of(arm)
    twice = [np.repeat(x.reshape(2, -1), 2, axis=0).ravel() for x in (q, qd)]
    found, again = arm.external_forces(q, qd), fine.external_forces(*twice)
    np.testing.assert_allclose(again.place, found.place, atol=1e-12)
    np.testing.assert_allclose(again.force, found.force, atol=1e-10)
    assert (found.kind == CONTACT).all()


def energies(arm, result, every=1):
    rows = zip(result.q[::every], result.qd[::every], strict=True)
    return np.array([sum(arm.energy(q, v)) + arm.external_forces(q, v).energy for q, v in rows])


def test_rod_on_a_plane_comes_to_rest_with_its_weight_on_it():
    arm = loose_arm(0.011, damping=5.0, friction=0.5)
    result = simulate(arm, t_end=3.0, dt=2e-3)
    assert result.status.ok, result.status
    assert np.abs(result.qd[-1]).max() < 1e-6
    force = arm.external_forces(result.q[-1], result.qd[-1]).force.sum(axis=0)
    weight = 9.81 * (arm.robot.links[1].mass + 0.5 * arm.robot.links[0].mass)
    assert force[2] == pytest.approx(weight, rel=1e-4)


@pytest.mark.parametrize("integrator", ["trapezoidal", "tr_bdf2"])
def test_slides_above_the_angle_of_friction_and_stays_below_it(integrator):
    slope = np.arctan(0.5)
    ends = {}
    for friction in (0.3, 0.7):
        arm = loose_arm(0.0098, slope=slope, damping=5.0, friction=friction)
        result = simulate(arm, t_end=1.0, dt=2e-3, integrator=integrator)
        assert result.status.ok, result.status
        ends[friction] = arm.jacobian(result.q[-1], 0.15)[5] @ result.qd[-1]
    want = 9.81 * (np.sin(slope) - 0.3 * np.cos(slope))
    assert ends[0.3] == pytest.approx(want, rel=0.03)
    # mu N v / sqrt(v^2 + v_s^2) = m g sin(slope): a creep of about v_s.
    assert ends[0.7] == pytest.approx(1e-3 / np.sqrt((0.7 / 0.5) ** 2 - 1), rel=0.05)


@pytest.mark.parametrize("integrator", ["trapezoidal", "tr_bdf2"])
def test_bounces_with_less_and_less_energy(integrator):
    arm = loose_arm(0.03, stiffness=500.0, damping=2.0, friction=0.3)
    result = simulate(arm, t_end=0.6, dt=5e-4, integrator=integrator)
    assert result.status.ok, result.status
    energy = energies(arm, result, 4)
    heights = np.array([arm.pose(q, 0.15)[2, 3] for q in result.q])
    peaks = heights[1:-1][
        (heights[1:-1] > heights[:-2]) & (heights[1:-1] >= heights[2:]) & (heights[1:-1] > 0.0101)
    ]
    assert len(peaks) >= 2
    assert (np.diff(np.concatenate([[0.03], peaks])) < 0).all()
    # tr_bdf2 takes out what it would gain.
    assert np.diff(energy).max() < (1e-12 if integrator == "tr_bdf2" else 2e-4) * np.ptp(energy)


def test_a_bounce_without_losses_keeps_its_energy_the_better_the_smaller_the_step():
    arm = loose_arm(0.02, stiffness=500.0)
    drift = []
    for dt in (1e-3, 2.5e-4):
        result = simulate(arm, t_end=0.3, dt=dt)
        energy = energies(arm, result, 5)
        drift.append(
            (energy.max() - energy[0])
            / np.ptp([arm.energy(q, v)[1] for q, v in zip(result.q, result.qd, strict=True)])
        )
    assert drift[0] < 5e-3
    assert drift[1] < drift[0] / 4


@pytest.mark.slow
@pytest.mark.parametrize("n_links", [1, 2, 3, 4])
def test_falls_on_a_ball(n_links):
    """Stiff obstacle, friction, varying strain: a millimetre deep at most, and no energy out of nothing."""
    bare = arm_of(n_links, "legendre")
    middle = bare.pose(np.zeros(bare.n_q), 0.06 * n_links)[:3, 3]
    ball = {"centre": (middle - np.array([0.0, 0.0, 0.065])).tolist(), "radius": 0.05}
    ball |= {"stiffness": 2e4, "damping": 1.0, "friction": 0.5}
    half = np.sqrt(0.5)
    flat = {"base_quaternion": [0.0, half, 0.0, half], "base_position": middle.tolist()}
    flat["base_position"][0] -= 0.06 * n_links
    arm = arm_of(n_links, "legendre", contacts={"spheres": [ball]}, **flat)
    result = simulate(arm, t_end=0.6, dt=2e-3, integrator="tr_bdf2")
    assert result.status.ok, result.status
    rows = zip(result.q[::5], result.qd[::5], strict=True)
    forces = [arm.external_forces(q, v).force for q, v in rows]
    assert 0.1 < np.linalg.norm(forces, axis=2).max() < 20.0
    energy = energies(arm, result, 10)
    assert np.diff(energy).max() < 1e-12 * np.ptp(energy)


BAD = [
    ({"planes": [{**PLANE, "normal": [0.0, 0.0, 0.0]}]}, "contacts.planes[0].normal", "a direction"),
    ({"planes": [{**PLANE, "stiffness": 0.0}]}, "contacts.planes[0].stiffness", "greater than 0"),
    ({"planes": [{"point": [0.0, 0.0, 0.0], "stiffness": 1.0}]}, "contacts.planes[0].normal", "required"),
    ({"spheres": [{**SPHERE, "friction": -0.1}]}, "contacts.spheres[0].friction", "greater than or equal"),
    ({"spheres": [{**SPHERE, "colour": "red"}]}, "contacts.spheres[0].colour", "centre, radius"),
    ({"points_per_link": 0}, "contacts.points_per_link", "greater than or equal to 1"),
]


@pytest.mark.parametrize(("contacts", "key", "allowed"), BAD)
def test_bad_obstacles(contacts, key, allowed):
    with pytest.raises(ConfigError) as caught:
        robot_from_dict({"links": [LAW], "contacts": contacts})
    assert caught.value.key == key
    assert allowed in caught.value.allowed


def test_method_mde_refuses():
    arm = arm_of(1, "constant", contacts=obstacles())
    with fails(ModelError, "mde", "exact", key="contacts"):
        SoftArm(arm.robot, method="mde")
