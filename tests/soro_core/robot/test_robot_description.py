"""Robots as described: defaults, shipped files, changed copies, section properties."""

import math

import numpy as np
import pytest

from soro_core import SoftArm, simulate
from soro_core.robot import load_robot, robot_from_dict
from tests.refused import refused
from tests.small_links import PLAIN, ROD


@pytest.mark.parametrize("name", ["six_link", "silicone_rod", "asu_two_segment", "srl_one_segment"])
def test_shipped_robots_run(name):
    robot = load_robot(name)
    assert robot.name == name
    arm = SoftArm(robot)
    assert simulate(arm, t_end=0.1, dt=2e-3, pressure=np.full(arm.n_u, 1e3)).status.ok


def test_defaults():
    robot = robot_from_dict({"links": [PLAIN]})
    assert robot.gravity == (0.0, 0.0, -9.81)
    assert robot.base_quaternion == (0.0, 0.0, 0.0, 1.0)
    assert robot.base_position == (0.0, 0.0, 0.0)
    assert (robot.tip_mass, robot.bend_angle) == (0.0, "deformed")
    assert robot.pressure_range_pa == (0.0, 90e3)
    assert robot.coordinate_names == ("link0/elongation", "link0/bending_x", "link0/bending_y")
    assert robot.links[0].damping is None
    assert robot.n_u == 0
    arm = SoftArm(robot)
    np.testing.assert_array_equal(arm.damping_force(np.zeros(3), np.ones(3)), np.zeros(3))
    assert arm.actuation_matrix(np.zeros(3)).shape == (3, 0)
    assert arm.forward_dynamics(np.zeros(3), np.zeros(3), []).shape == (3,)


def test_a_quaternion_of_a_few_decimals_gets_length_1():
    """Everywhere that a file holds one; one of length 1 stays to the bit."""
    short, whole = [0.0, 0.7071, 0.0, 0.7071], [0.0, 0.7071067811865476, 0.0, 0.7071067811865476]
    body = {"at": 1.0, "quaternion": [0.5, 0.5, 0.5, 0.501]}
    calibration = {"tracker_quaternion": short, "bodies": [body]}
    robot = robot_from_dict({"links": [PLAIN], "base_quaternion": short, "calibration": calibration})
    seen = robot.base_quaternion, robot.calibration.tracker_quaternion, robot.calibration.bodies[0].quaternion
    for found in seen:
        assert abs(math.hypot(*found) - 1.0) < 1e-15
    assert robot.base_quaternion == pytest.approx(whole, abs=1e-15)
    assert robot.replace(base_quaternion=whole).base_quaternion == tuple(whole)


def test_changed_copies_are_checked():
    robot = robot_from_dict({"links": [ROD], "tip_mass": 0.01})
    heavier = robot.replace(tip_mass=0.02)
    assert (robot.tip_mass, heavier.tip_mass) == (0.01, 0.02)
    assert heavier.links == robot.links
    assert robot.replace(links=[*robot.links, *robot.links]).n_q == 6
    with refused("tip_mass", -1.0):
        robot.replace(tip_mass=-1.0)
    with refused("payload"):
        robot.replace(payload=1.0)
    with refused("tip_mass", 3.0, ("replace",)):
        robot.tip_mass = 3.0


def test_strains_are_carried_in_the_order_given():
    names = ("shear_y", "bending_x", "torsion")
    robot = robot_from_dict({"links": [{**ROD, "strains": {name: {"basis": "constant"} for name in names}}]})
    assert robot.coordinate_names == tuple(f"link0/{name}" for name in names)
    J = SoftArm(robot).jacobian(np.zeros(3), 0.2)
    # Straight along z: shear_y moves the tip by +y, bending_x turns about y and moves it to +x, torsion
    # turns about z.
    np.testing.assert_allclose(
        J.T,
        [[0, 0, 0, 0, 0.2, 0], [0, 0.2, 0, 0.02, 0, 0], [0, 0, 0.2, 0, 0, 0]],
        atol=1e-15,
    )


def test_material_gives_section_stiffness_and_damping():
    strains = ("torsion", "bending_x", "bending_y", "elongation", "shear_x", "shear_y")
    link = {**ROD, "strains": {name: {"basis": "constant"} for name in strains}}
    arm = SoftArm(robot_from_dict({"links": [link]}))
    L, r, E, G, eta = 0.2, 0.015, 5e5, 5e5 / 3, 300.0
    area, inertia = math.pi * r**2, math.pi * r**4 / 4
    want = L * np.array([2 * G * inertia, E * inertia, E * inertia, E * area, G * area, G * area])
    np.testing.assert_allclose(np.diag(arm.stiffness_matrix(np.zeros(6))), want, rtol=1e-12)
    losses = L * eta * np.array([2 * inertia, 3 * inertia, 3 * inertia, 3 * area, area, area])
    np.testing.assert_allclose(arm.damping_force(np.zeros(6), np.ones(6)), losses, rtol=1e-12)
    assert arm.robot.links[0].mass == pytest.approx(1100 * area * L, rel=1e-12)


@pytest.mark.parametrize(("strains", "limit"), [(3, 0.9), (6, 0.6)])
def test_silicone_rod_follows_the_reference_rod(reference, strains, limit):
    """RMS of the tip error over the whole run, in per cent of the length."""
    right = np.load(reference / "ref_cantilever_kv.npz")
    robot = load_robot("silicone_rod")
    if strains == 6:
        names = ("bending_x", "bending_y", "elongation", "torsion", "shear_x", "shear_y")
        links = [link.model_dump(exclude_unset=True) for link in robot.links]
        robot = robot.replace(
            links=[{**link, "strains": {n: {"basis": "constant"} for n in names}} for link in links]
        )
    arm = SoftArm(robot)
    result = simulate(arm, t_end=float(right["t"][-1]), dt=2e-3)
    tip = np.array([arm.pose(q, arm.length)[:3, 3] for q in result.q])
    at = np.array([np.interp(right["t"], result.t, tip[:, k]) for k in range(3)]).T
    error = 100 * np.linalg.norm(at - right["tip"], axis=1) / arm.length
    assert np.sqrt((error**2).mean()) < limit


@pytest.mark.slow
def test_six_link_benchmark_error_falls_with_steps():
    """Mean tip distance of mde at 50 Hz from the exact method falls with the second order of its steps."""
    robot = load_robot("six_link")
    q0 = np.tile([0.0, 1.0, 0.0], 6)

    def tips(arm):
        run = simulate(
            arm, q0, np.zeros(18), t_end=4.0, dt=0.02, pressure=lambda t: [80e3 * np.sin(np.pi * t)]
        )
        assert run.status.ok
        return np.array([arm.pose(q, arm.length)[:3, 3] for q in run.q])

    exact = tips(SoftArm(robot))
    errors = [
        np.linalg.norm(tips(SoftArm(robot, method="mde", steps=n)) - exact, axis=1).mean() / 0.15
        for n in (4, 10, 20)
    ]
    assert errors[0] > 4 * errors[1] > 12 * errors[2]
    assert errors[1] < 0.01


@pytest.mark.parametrize("keys", [{}, {"pressure_range_pa": [0.0, 6e4]}, {"pressure_range_pa": [-6e4, 0.0]}])
def test_a_range_that_bursts_a_chamber_is_refused(keys):
    chamber = {"angle_rad": 0.0, "area_m2": 1e-4, "offset_m": 0.01, "dead_band_pa": 5e3, "swell_per_pa": 2e-5}
    link = {**PLAIN, "chambers": [chamber]}
    assert robot_from_dict({"links": [link], "pressure_range_pa": [-5e4, 5.4e4]}).n_u == 1
    with refused("pressure_range_pa", names=("55000 Pa",)):
        robot_from_dict({"links": [link], **keys})
