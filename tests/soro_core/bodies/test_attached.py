"""Bodies that an arm holds: against masses and wrenches of the arm's own model, and a hinged limb by hand."""

import numpy as np
import pytest

from soro_core import BaseState, SoftArm, equilibrium, load_robot, simulate
from soro_core.bodies import (
    Attachment,
    BallShape,
    BodyWorld,
    BoxShape,
    Hinge,
    RigidBody,
    WorldStepper,
    simulate_world,
)
from soro_core.errors import ModelError, SoroError

HANGING = load_robot("three_bellow_hanging")
LEVEL = HANGING.replace(base_quaternion=(0.0, 0.5**0.5, 0.0, 0.5**0.5))
BALL = BallShape(radius=0.008)
PUSH = [20e3, 0.0, 5e3]


def tip_of(robot):
    return SoftArm(robot).pose(np.zeros(SoftArm(robot).n_q), robot.length)[:3, 3]


def world_of(robot, joint="ball", body=None, **keys):
    arm = SoftArm(robot)
    keys = {"mass": 0.02, "position": tip_of(robot), **keys}
    held = RigidBody(shape=body or BALL, **{"attached": Attachment(joint=joint), **keys})
    return BodyWorld({"held": held}, {"arm": arm})


def run_of(world, dt=1e-3, t_end=0.5, **keys):
    result = simulate_world(world, t_end=t_end, dt=dt, pressures={"arm": PUSH}, **keys)
    assert result.status.ok, result.status
    return result


def test_a_ball_on_a_joint_at_its_centre_is_a_tip_mass():
    """The same motion as with `tip_mass`, whose weight and inertia are terms of the arm's own equations."""
    other = simulate(SoftArm(HANGING.replace(tip_mass=0.02)), t_end=0.5, dt=2.5e-4, pressure=PUSH)
    swing = np.ptp(other.tip, axis=0).max()
    errors = []
    for dt in (2e-3, 1e-3):
        run = run_of(world_of(HANGING), dt)
        apart = np.linalg.norm(run.place["held"] - other.tip[:: round(dt / 2.5e-4)], axis=1)
        errors.append(apart.max() / swing)
    assert errors[1] < 0.02
    assert errors[0] / errors[1] > 1.7, "first order in dt"


def test_a_bar_welded_to_the_tip_bends_the_arm_by_its_weight_and_its_moment():
    """At rest, against the equilibrium under the wrench of its weight, which turns with no section."""
    robot = LEVEL
    arm, mass, half = SoftArm(robot), 0.01, 0.03
    bar = BoxShape(size=(0.06, 0.006, 0.006))
    tip = tip_of(robot)
    world = world_of(robot, "weld", bar, mass=mass, position=tip + np.array([half, 0.0, 0.0]))
    run = simulate_world(world, t_end=6.0, dt=4e-3)
    assert run.status.ok, run.status

    def weight(q):
        R = arm.pose(q, robot.length)[:3, :3]
        force = R.T @ [0.0, 0.0, -9.81 * mass]
        lever = arm.pose(np.zeros(arm.n_q), robot.length)[:3, :3].T @ [half, 0.0, 0.0]
        return np.concatenate([np.cross(lever, force), force])

    expected = equilibrium(arm, np.zeros(3), wrench=weight)
    bent = np.abs(expected).max()
    np.testing.assert_allclose(run.q["arm"][-1], expected, atol=0.01 * bent)
    without = equilibrium(arm, np.zeros(3), wrench=lambda q: [0, 0, 0, *weight(q)[3:]])
    assert np.abs(without - expected).max() > 0.1 * bent, "its moment matters"


def test_an_arm_that_pulls_at_a_hinged_limb_holds_it_where_moments_balance():
    """The joint's force, by the moments about the hinge, worked out by hand; its place is kept."""
    tip = tip_of(HANGING)
    hinge = Hinge(point=tip + np.array([0.05, 0.0, 0.0]), axis=(0.0, 1.0, 0.0), damping=1e-3)
    limb = BoxShape(size=(0.1, 0.01, 0.01))
    world = world_of(HANGING, "ball", limb, mass=0.03, hinge=hinge, position=tip + np.array([0.01, 0.0, 0.0]))
    run = run_of(world, t_end=5.0, dt=2e-3)
    last = run.contacts.behind
    rows = slice(last[-2], last[-1])
    (force,), (where,) = run.contacts.force[rows], run.contacts.point[rows]
    centre = run.place["held"][-1]
    lever, arm = where - hinge.point, centre - hinge.point
    moments = np.cross(lever, -force)[1] + np.cross(arm, [0.0, 0.0, -9.81 * 0.03])[1]
    assert abs(moments) < 1e-3 * abs(np.cross(arm, [0.0, 0.0, -9.81 * 0.03])[1])
    assert abs(run.twist["held"][-1]).max() < 1e-4
    place = SoftArm(HANGING).pose(run.q["arm"][-1], HANGING.length)[:3, 3]
    assert np.linalg.norm(place - where) < 1e-4
    assert abs(run.angle["held"][-1, 0]) > 0.02, "it has moved"


def test_no_energy_is_gained_at_a_joint():
    """A bar thrown by an arm that was bent: kinetic and potential energy of both never grow."""
    robot = HANGING
    arm = SoftArm(robot)
    q0 = np.array([0.02, 6.0, -4.0])
    tip = arm.pose(q0, robot.length)
    bar = RigidBody(
        shape=BoxShape(size=(0.01, 0.01, 0.06)),
        mass=0.02,
        position=tip[:3, 3] - [0.0, 0.0, 0.03],
        attached=Attachment(joint="ball"),
    )
    world = BodyWorld({"bar": bar}, {"arm": arm}, {"arm": q0})
    run = simulate_world(world, t_end=0.6, dt=1e-3)
    assert run.status.ok, run.status
    moments = bar.moments()
    energy = []
    for k in range(len(run.t)):
        turned = run.rotation["bar"][k].T @ run.twist["bar"][k, :3]
        own = 0.5 * moments @ turned**2 + 0.5 * 0.02 * run.twist["bar"][k, 3:] @ run.twist["bar"][k, 3:]
        energy.append(
            sum(arm.energy(run.q["arm"][k], run.qd["arm"][k])) + own + 0.02 * 9.81 * run.place["bar"][k, 2]
        )
    span = np.ptp(energy)
    assert span > 1e-3
    assert max(np.diff(energy)) < 1e-3 * span


@pytest.mark.parametrize(("mass", "length"), [(0.1, 0.2), (0.2, 0.3)])
def test_a_long_tool_across_a_weld_moves_as_with_a_shorter_step(mass, length):
    """Leaps of the impulses, which no cone bounds at a joint, grew beyond all numbers."""
    bar, place = BoxShape(size=(length, 0.01, 0.01)), tip_of(HANGING) + np.array([0.5 * length, 0.0, 0.0])
    world = world_of(HANGING, "weld", bar, mass=mass, position=place)
    runs = [run_of(world, dt, t_end=0.3) for dt in (1e-3, 2.5e-4)]
    coarse, fine = (run.place["held"] for run in runs)
    assert np.abs(coarse - fine[::4]).max() < 0.1 * np.ptp(fine, axis=0).max()


@pytest.mark.parametrize(
    ("attached", "position", "said"),
    [
        ({"arm": "legs"}, None, "allowed: arm"),
        ({"place": 0.5}, None, "the end of arm"),
        ({}, (0.3, 0.0, 0.0), "from the centre to the place"),
    ],
)
def test_a_joint_that_cannot_be_is_refused_in_one_line(attached, position, said):
    keys = {"position": position or tip_of(HANGING), "attached": Attachment(**attached)}
    with pytest.raises(SoroError, match=said) as caught:
        simulate_world(world_of(HANGING, **keys), t_end=0.01)
    assert "bodies.held" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_weld_bears_the_weight_without_a_normal_force():
    """Its three points bear moments against each other, which no sum of normal forces counts."""
    bar = BoxShape(size=(0.06, 0.006, 0.006))
    run = simulate_world(world_of(HANGING, "weld", bar, mass=0.015), t_end=4.0, dt=2e-3)
    assert run.contact_force("held")[-1] == pytest.approx([0.0, 0.0, 9.81 * 0.015], abs=1e-4)
    assert not run.normal_force("held").any()


def test_a_driven_body_holds_the_tip():
    world = world_of(HANGING, fixed=True, mass=None)
    run = run_of(world, t_end=1.0)
    tip = SoftArm(HANGING).pose(run.q["arm"][-1], HANGING.length)[:3, 3]
    assert np.linalg.norm(tip - tip_of(HANGING)) < 5e-5
    assert np.linalg.norm(run.contacts.force[-1]) > 0.5


def test_what_is_displaced_at_the_start_is_refused():
    away = BaseState(displacement=[0.0, 0.03, 0.0])
    for who, world in (("arm", world_of(HANGING)), ("held", world_of(HANGING, fixed=True, mass=None))):
        with pytest.raises(ModelError, match=f"{who} is displaced at 0 s"):
            simulate_world(world, t_end=0.01, motions={who: lambda t: away})


def test_wrenches_on_what_is_fixed_or_not_there_are_refused():
    stepper = WorldStepper(world_of(HANGING, fixed=True, mass=None))
    for who in ("held", "other"):
        with pytest.raises(ModelError, match=f"wrenches: got '{who}'"):
            stepper.step(stepper.initial_state(), {"arm": [PUSH, PUSH]}, 1e-3, wrenches={who: np.zeros(6)})
