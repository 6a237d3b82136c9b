"""Who moves a hinged body: how it follows, and what torque that takes."""

import numpy as np
import pytest

from soro_core.bodies import BodyWorld, BoxShape, Hinge, RigidBody, WorldState, WorldStepper
from soro_core.bodies.body import HingeDrive

DT = 5e-3
SWING = {"at_s": [0.5, 1.0, 2.0, 3.0], "angle_rad": [0.0, 0.5, -0.5, 0.0]}


def limb_of(stiffness=8.0, damping=0.4):
    return RigidBody(
        shape=BoxShape(size=(0.18, 0.08, 0.03)),
        mass=0.4,
        position=(0.09, 0.01, 0.02),
        quaternion=(0.0, 0.0, 0.3826834, 0.9238795),
        hinge=Hinge(
            point=(0.0, 0.0, 0.0),
            axis=(0.0, 2.0, 0.5),
            stiffness=0.2,
            damping=0.01,
            drive=HingeDrive(stiffness=stiffness, damping=damping, **SWING),
        ),
    )


def moved(limb, until_s=3.0):
    """Times [s], angles [rad] and torques [N m] of each tick."""
    world = WorldStepper(BodyWorld({"limb": limb}, {}), 5e-4)
    state, rows = world.initial_state(), []
    axis, _, _ = limb.about_hinge()
    for t in np.arange(0.0, until_s, DT):
        torque = limb.hinge.drive.torque(t, *state.angle[0])
        wrench = np.concatenate((torque * axis, np.zeros(3)))
        result = world.step(state, {}, DT, t, {"limb": wrench})
        assert result.status.ok, result.status
        rows.append((t, state.angle[0, 0], torque))
        state = WorldState.last_of(result)
    return np.array(rows).T


def test_it_is_relaxed_first_and_takes_the_torque_of_the_motion_then():
    """The world of bodies knows nothing of `torque_alone`."""
    limb = limb_of(stiffness=100.0, damping=0.6)
    t, angle, torque = moved(limb)
    before = t < SWING["at_s"][0]
    np.testing.assert_array_equal(torque[before], 0.0)
    assert angle[before][-1] > 0.2  # it falls
    late = t > 1.2  # behind the catch
    wanted = np.array([limb.hinge.drive(one)[0] for one in t])
    np.testing.assert_allclose(angle[late], wanted[late], atol=5e-3)
    alone = np.array([limb.torque_alone(*limb.hinge.drive(one)) for one in t])
    np.testing.assert_allclose(torque[late], alone[late], atol=0.02)  # at a jump of the acceleration
    assert np.std(torque[late]) == pytest.approx(np.std(alone[late]), rel=0.01)
    assert np.mean(torque[late]) == pytest.approx(np.mean(alone[late]), rel=0.01)


@pytest.mark.parametrize(("damping", "is_allowed"), [(0.4, True), (0.7, True), (6.0, False)])
def test_what_rings_is_stiffer_than_allowed(damping, is_allowed):
    limb = limb_of(stiffness=20.0, damping=damping)
    inertia = limb.about_hinge()[2]
    assert (limb.hinge.drive.least_inertia(DT) <= inertia) == is_allowed
    t, angle, _ = moved(limb, 1.0 + DT)
    rings = np.abs(np.diff(angle[t > 0.75], 2)).max() > 5e-3
    assert rings != is_allowed


def test_the_motion_of_a_drive_rests_at_each_angle():
    drive = HingeDrive(**SWING)
    for t, angle in zip(SWING["at_s"], SWING["angle_rad"], strict=True):
        np.testing.assert_allclose(drive(t)[:2], (angle, 0.0), atol=1e-12)
    assert drive(9.0) == (0.0, 0.0, 0.0)
    h = 1e-5
    for t in (0.7, 1.3, 2.8):
        angle, rate, acceleration = drive(t)
        assert rate == pytest.approx((drive(t + h)[0] - drive(t - h)[0]) / (2 * h), rel=1e-6)
        assert acceleration == pytest.approx((drive(t + h)[1] - drive(t - h)[1]) / (2 * h), rel=1e-6)
