"""Tendons along an arm: exact force of any route, against closed forms and a boundary-value problem."""

import math

import numpy as np
import pytest
from differences import extrapolated, worst
from scipy.integrate import solve_bvp
from scipy.linalg import expm
from scipy.optimize import root

from soro_core import SoftArm, equilibrium, load_robot, robot_from_dict, save_robot, simulate, simulate_many
from soro_core.control.config import ControllerConfig
from soro_core.control.controller import Controller
from soro_core.errors import ConfigError, ModelError
from soro_core.estimation import Estimator
from soro_core.integrate import make_stepper
from soro_core.model import checks
from soro_core.pneumatics import ValveModel
from soro_core.robot import Tendon
from soro_core.robot.coordinates import strain_fields
from soro_core.twin import TwinConfig
from soro_core.twin.plant import ArmPlant

SIX = ("elongation", "bending_x", "bending_y", "torsion", "shear_x", "shear_y")
E, G, RADIUS, LENGTH = 5e5, 2e5, 0.008, 0.12
AREA, SECOND = math.pi * RADIUS**2, math.pi * RADIUS**4 / 4
MATERIAL = {"youngs_modulus": E, "shear_modulus": G, "shear_correction": False}
HELIX = {"angle_rad": 0.4, "offset_m": 0.006, "turns": 0.75}


def arm_of(tendons, strains=SIX, order=0, links=1, **keys):
    shape = {"basis": "legendre", "order": order} if order else {}
    link = {"length": LENGTH / links, "radius": RADIUS, "density": 1100.0, "material": MATERIAL}
    own = keys.pop("link", {})
    if "sections" in own:
        link.pop("radius")
    whole = {**link, **own, "strains": dict.fromkeys(strains, shape)}
    return SoftArm(
        robot_from_dict({"gravity": [0, 0, 0], "links": [whole] * links, "tendons": tendons, **keys})
    )


def state_of(arm, scale=1.0):
    rng, fields = np.random.default_rng(3), strain_fields(arm.robot)
    unit = np.where(fields.stretch, 0.03, 4.0) * scale
    return rng.normal(size=arm.n_q) * unit, 5.0 * rng.normal(size=arm.n_q) * unit


def route(tendon, s):
    """Place of a tendon in the frame of the section at s, (3,), and its first two derivatives."""
    rate = 2 * math.pi * tendon.get("turns", 0.0) / LENGTH
    angle = tendon["angle_rad"] + rate * s
    out = tendon["offset_m"] * np.array([math.cos(angle), math.sin(angle), 0.0])
    across = tendon["offset_m"] * np.array([-math.sin(angle), math.cos(angle), 0.0])
    return out, rate * across, -(rate**2) * out


BENT = {
    "sections": [
        {"place": 0.0, "radius": 0.010, "rest_curvature_per_m": [4.0, -2.0], "rest_torsion_per_m": 3.0},
        {"place": 0.03, "radius": 0.008, "rest_curvature_per_m": [9.0, 1.0], "rest_torsion_per_m": 1.0},
        {"place": LENGTH, "radius": 0.008, "rest_curvature_per_m": [0.0, 0.0], "rest_torsion_per_m": -2.0},
    ]
}


@pytest.mark.parametrize(
    ("order", "turns", "link"), [(0, -1.5, {}), (3, -1.5, {}), (0, 0.0, BENT), (2, 0.75, BENT)]
)
def test_length_is_that_of_the_curve_in_space_and_the_force_its_gradient(order, turns, link):
    tendon = {**HELIX, "turns": turns}
    robot = arm_of([tendon], order=order, link=link, base_quaternion=[0.5, 0.5, 0.5, 0.5]).robot
    arm = SoftArm(robot, nodes=60)
    q, _ = state_of(arm, 0.6)

    def chords(q, n):
        s = np.linspace(0.0, LENGTH, n + 1)
        places = [
            pose[:3, :3] @ route(tendon, x)[0] + pose[:3, 3]
            for x, pose in zip(s, arm.poses(q, s), strict=True)
        ]
        return np.linalg.norm(np.diff(places, axis=0), axis=1).sum()

    # Richardson's step removes the first error of chords.
    length, rest = ((4 * chords(x, 400) - chords(x, 200)) / 3 for x in (q, 0 * q))
    assert arm.displaced_volume(q)[0] == pytest.approx(rest - length, abs=1e-8 * LENGTH)
    H = arm.actuation_matrix(q)
    assert worst(H.T, extrapolated(arm.displaced_volume, q, np.full(arm.n_q, 0.1))) < 1e-9


def test_a_straight_tendon_is_a_chamber_that_pulls():
    chamber = {"angle_rad": 0.7, "area_m2": 2e-5, "offset_m": 5e-3}
    bent = ("elongation", "bending_x", "bending_y")
    pushed = arm_of([], bent, order=2, link={"chambers": [chamber]})
    pulled = arm_of([{"angle_rad": 0.7, "offset_m": 5e-3}], bent, order=2)
    q, qd = state_of(pulled)
    np.testing.assert_allclose(2e-5 * pulled.actuation_matrix(q), -pushed.actuation_matrix(q), atol=1e-18)
    np.testing.assert_allclose(
        pulled.forward_dynamics(q, qd, [0.4]), pushed.forward_dynamics(q, qd, [-0.4 / 2e-5]), rtol=1e-10
    )


def test_a_straight_tendon_bends_a_rod_to_an_arc():
    r, tension = 0.006, 0.3
    arm = arm_of([{"angle_rad": math.pi, "offset_m": r}], ("elongation", "bending_x", "bending_y"))
    wanted = [-tension / (E * AREA), -tension * r / (E * SECOND), 0.0]
    np.testing.assert_allclose(equilibrium(arm, [tension]), wanted, rtol=1e-9, atol=1e-12)


def strains_of_helix(tendon, tension):
    """Strains where a tendon alone loads a rod, seen from a frame that turns with the tendon: a closed form.

    Energy and length are both integrals of local strains: each section takes those of least sum.
    """
    out, onward, _ = route({**tendon, "angle_rad": 0.0}, 0.0)
    stiffness = np.array([E * SECOND] * 2 + [2 * G * SECOND] + [G * AREA] * 2 + [E * AREA])

    def balance(strain):
        u = strain[3:] + np.cross(strain[:3], out) + onward
        pull = tension * u / np.linalg.norm(u)
        rest = np.array([0, 0, 0, 0, 0, 1.0])
        return (stiffness * (strain - rest) + np.concatenate([np.cross(out, pull), pull])) / tension

    found = root(balance, [0, 0, 0, 0, 0, 1.0], tol=1e-13)
    assert np.abs(found.fun).max() < 1e-9
    return found.x


@pytest.mark.parametrize("turns", [0.75, -1.25])
def test_a_helical_tendon_makes_the_rod_of_its_closed_form(turns):
    tendon, tension = {**HELIX, "turns": turns}, 1.5
    arm = arm_of([tendon], order=9, links=2)
    q = equilibrium(arm, [tension])
    local = strains_of_helix(tendon, tension)
    # In the turning frame the strain is constant, and so is the twist of that frame: one exponential.
    rate, start = 2 * math.pi * turns / LENGTH, tendon["angle_rad"]
    twist = local + np.array([0, 0, rate, 0, 0, 0])
    hat = np.zeros((4, 4))
    hat[:3, :3] = _hat(twist[:3])
    hat[:3, 3] = twist[3:]
    wanted = _turn(start) @ expm(LENGTH * hat) @ _turn(-start - rate * LENGTH)
    np.testing.assert_allclose(arm.pose(q, LENGTH), wanted, atol=1e-6 * LENGTH)
    assert np.linalg.norm(wanted[:3, 3] - [0, 0, LENGTH]) > 0.02 * LENGTH


def _hat(w):
    """Matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    return np.cross(np.eye(3), np.asarray(w)[..., None, :])


def _turn(angle):
    turn = np.eye(4)
    turn[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    return turn


def rod_of_rucker_and_webster(tendons, tensions, weight, tip_force):
    """Tip of a rod with distributed tendon loads and their moment at the end [RW11, (2) to (17)].

    States p, R, v, u; the loads of the tendons contain v' and u', for which each section is solved.
    """
    shear, bend = np.diag([G * AREA, G * AREA, E * AREA]), np.diag([E * SECOND, E * SECOND, 2 * G * SECOND])
    e3 = np.array([0, 0, 1.0])

    def tangent(tendon, s, v, u):
        d, d1, d2 = (np.array(one) for one in zip(*(route(tendon, x) for x in s), strict=True))
        x = v + np.cross(u, d) + d1
        return d, d1, d2, x, np.linalg.norm(x, axis=-1)[:, None]

    def slopes(s, y):
        """Rates (18, n) at n places at once: one by one they took 40 s."""
        R, v, u = y[3:12].T.reshape(-1, 3, 3), y[12:15].T, y[15:18].T
        A, b = np.zeros((s.size, 6, 6)), np.zeros((s.size, 6))
        A[:, :3, :3], A[:, 3:, 3:] = shear, bend
        n, m = (v - e3) @ shear, u @ bend
        b[:, :3] = -np.cross(u, n) - np.einsum("kji,j->ki", R, weight)
        b[:, 3:] = -np.cross(u, m) - np.cross(v, n)
        for tendon, tension in zip(tendons, tensions, strict=True):
            d, d1, d2, x, size = tangent(tendon, s, v, u)
            # f = T R (u x t + (1 - t t') x' / |x|), x' = v' + u' x d + u x d' + d''
            t = x / size
            P = tension * (np.eye(3) - t[:, :, None] * t[:, None, :]) / size[:, None]
            known = tension * np.cross(u, t) + np.einsum("kij,kj->ki", P, np.cross(u, d1) + d2)
            for rows, arm in ((slice(0, 3), np.eye(3)), (slice(3, 6), _hat(d))):
                A[:, rows, :3] += arm @ P
                A[:, rows, 3:] -= arm @ P @ _hat(d)
                b[:, rows] -= np.einsum("...ij,...j->...i", arm, known)
        rates = np.linalg.solve(A, b[:, :, None])[:, :, 0]
        turned = (R @ _hat(u)).reshape(-1, 9)
        return np.concatenate([np.einsum("kij,kj->ki", R, v), turned, rates], axis=1).T

    def at_ends(a, b):
        R, v, u = b[3:12].reshape(3, 3), b[12:15], b[15:18]
        force, moment = shear @ (v - e3) - R.T @ tip_force, bend @ u
        for tendon, tension in zip(tendons, tensions, strict=True):
            (d,), _, _, (x,), (size,) = tangent(tendon, [LENGTH], v, u)
            force, moment = force + tension * x / size, moment + np.cross(d, tension * x / size)
        return np.concatenate([a[:3], a[3:12] - np.eye(3).ravel(), force, moment / LENGTH])

    s = np.linspace(0.0, LENGTH, 41)
    guess = np.zeros((18, s.size))
    guess[2], guess[3], guess[7], guess[11], guess[14] = s, 1.0, 1.0, 1.0, 1.0
    found = solve_bvp(
        slopes,
        at_ends,
        s,
        guess,
        tol=1e-8,
        max_nodes=4000,
    )
    assert found.success, found.message
    return found.y[:3, -1]


@pytest.mark.slow
def test_tip_is_that_of_the_boundary_value_problem_of_rucker_and_webster():
    tendons = [HELIX, {"angle_rad": 2.0, "offset_m": 0.005}]
    tensions, mass = [1.2, 0.8], 4e-3
    gravity = np.array([3.0, -2.0, -9.0])
    arm = arm_of(tendons, order=7, links=2, gravity=gravity.tolist(), tip_mass=mass)
    q = equilibrium(arm, tensions)
    wanted = rod_of_rucker_and_webster(tendons, tensions, 1100.0 * AREA * gravity, mass * gravity)
    np.testing.assert_allclose(arm.pose(q, LENGTH)[:3, 3], wanted, atol=1e-6 * LENGTH)
    assert np.linalg.norm(wanted - [0, 0, LENGTH]) > 0.1 * LENGTH


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "lost"), [("midpoint", 2e-3), ("tr_bdf2", 0.01)])
def test_the_work_of_the_tensions_is_the_energy_of_the_arm(integrator, lost):
    arm = arm_of([HELIX, {"angle_rad": 2.0, "offset_m": 0.005, "links": [0, 0]}], order=1, links=2)
    tension = np.array([0.8, 0.5])
    run = simulate(arm, tension=tension, t_end=0.1, dt=2.5e-4, integrator=integrator)
    assert run.status.ok, run.status
    work = np.array([tension @ arm.displaced_volume(q) for q in run.q])
    energy = np.array([sum(arm.energy(*state)) for state in zip(run.q, run.qd, strict=True)])
    gained = energy - energy[0] - work
    size = np.abs(work).max()
    assert np.abs(gained).max() < lost * size
    if integrator == "tr_bdf2":
        assert gained.max() < 1e-9 * size
    assert max(arm.energy(*state)[0] for state in zip(run.q, run.qd, strict=True)) > 0.1 * size


@pytest.mark.slow
def test_varying_tension_does_the_work_of_its_path():
    arm = arm_of([HELIX], order=1)
    run = simulate(
        arm, tension=lambda t: [0.5 + 0.5 * math.sin(30 * t)], t_end=0.1, dt=2.5e-5, integrator="rk4"
    )
    short = np.array([arm.displaced_volume(q)[0] for q in run.q])
    force = run.pressure[:, 0]
    work = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(short))
    ends = [sum(arm.energy(run.q[k], run.qd[k])) for k in (0, -1)]
    assert ends[1] - ends[0] == pytest.approx(work, rel=1e-4)


@pytest.mark.slow
def test_derivatives_of_dynamics_and_of_a_step_are_those_of_differences():
    arm = arm_of([HELIX, {"angle_rad": 2.0, "offset_m": 0.005}], order=1)
    q, qd = state_of(arm, 0.5)
    p = np.array([0.7, 0.4])
    by = arm.derivatives(q, qd, p)
    wanted = (
        extrapolated(lambda x: arm.forward_dynamics(x, qd, p), q, np.full(arm.n_q, 0.05)),
        extrapolated(lambda x: arm.forward_dynamics(q, x, p), qd, np.ones(arm.n_q)),
        extrapolated(lambda x: arm.forward_dynamics(q, qd, x), p, np.full(2, 0.1)),
    )
    for found, difference in zip(by, wanted, strict=True):
        assert worst(found, difference) < 1e-8
    stepper = make_stepper("midpoint", arm, guarded=False)
    state = stepper.initial_state(0.1 * q)
    found = stepper.derivatives(state, p, 1e-4)

    def after(x):
        return np.concatenate([(end := stepper.step(state, x, 1e-4)[0]).q, end.qd])

    assert worst(found.by_p, extrapolated(after, p, np.full(2, 0.1))) < 1e-6


def test_many_states_and_many_runs_are_those_one_by_one():
    arm = arm_of([HELIX], order=1)
    q, qd = state_of(arm, 0.3)
    rows = arm.forward_dynamics([q, 0 * q], [qd, qd], [[0.3], [0.9]])
    np.testing.assert_array_equal(rows[1], arm.forward_dynamics(0 * q, qd, [0.9]))
    runs = simulate_many(arm, pressure=[[0.2], [0.4]], t_end=0.01)
    one = simulate(arm, tension=[0.4], t_end=0.01)
    np.testing.assert_array_equal(runs[1].q, one.q)
    same = simulate_many(arm, [0 * q, 0 * q], tension=[0.4], t_end=0.01)
    np.testing.assert_array_equal(same[1].q, one.q)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["exact", "mde"])
def test_the_parts_of_a_refined_link_carry_the_same_tendon(method):
    robot = arm_of([HELIX, {**HELIX, "links": [1, 1]}], links=2).robot
    q = np.array([0.02, 3.0, -2.0, 5.0, 0.01, 0.02] * 2)
    whole = SoftArm(robot, method=method)
    parts = SoftArm(robot.refine(3), method=method)
    fine = np.concatenate([np.tile(q[:6], 3), np.tile(q[6:], 3)])
    np.testing.assert_allclose(parts.displaced_volume(fine), whole.displaced_volume(q), rtol=1e-9)
    coarse = whole.forward_dynamics(q, 0 * q, [0.5, 0.2])
    assert np.isfinite(coarse).all()


def test_a_file_and_python_build_the_same_robot(tmp_path):
    robot = arm_of([HELIX, {"angle_rad": 1.0, "offset_m": 0.004, "links": [0, 0]}]).robot
    save_robot(robot, tmp_path / "one.yaml")
    again = load_robot(tmp_path / "one.yaml")
    assert again == robot
    assert robot.replace(tendons=[Tendon(**HELIX), robot.tendons[1]]) == robot
    assert robot.with_({"tendons[0].turns": 2.0}).tendons[0].turns == 2.0
    assert "2 tendons" in repr(robot)
    assert robot.n_u == 2
    assert again.tendon_names == ("tendon0", "tendon1")


@pytest.mark.parametrize(
    ("tendon", "words"),
    [
        ({"angle_rad": 0.0}, ("tendons[0].offset_m",)),
        ({**HELIX, "offset_m": -1.0}, ("tendons[0].offset_m", "-1.0")),
        ({**HELIX, "links": [0, 1]}, ("tendons", "0 to 0")),
        ({**HELIX, "links": [1]}, ("tendons[0].links", "first <= last")),
        ({**HELIX, "turns": 1000}, ("tendons[0].turns", "100")),
        ({**HELIX, "max_tension_n": 0}, ("tendons[0].max_tension_n",)),
        ({**HELIX, "pitch": 0}, ("pitch",)),
    ],
)
def test_bad_keys_are_named_in_one_line(tendon, words):
    with pytest.raises(ConfigError) as caught:
        arm_of([tendon])
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_a_tendon_does_not_push_and_its_range_is_named(caplog, monkeypatch):
    monkeypatch.setattr(checks, "_noted", set())
    arm = arm_of([HELIX, {**HELIX, "max_tension_n": 0.5}])
    q = np.zeros(6)
    for call in (
        lambda: arm.forward_dynamics(q, q, [0.0, -1.0]),
        lambda: arm.forward_dynamics([q, q], [q, q], [0.0, -1.0]),
        lambda: arm.pressure_force(q, [0.0, -1.0]),
        lambda: equilibrium(arm, [0.0, -1.0]),
        lambda: simulate(arm, pressure=[0.0, -1.0], t_end=0.01),
        lambda: simulate(arm, tension=lambda t: [0.0, -1.0], t_end=0.01),
        lambda: make_stepper("rk4", arm).step(make_stepper("rk4", arm).initial_state(), [0.0, -1.0], 1e-3),
    ):
        with pytest.raises(ModelError, match="-1 N of tendon1; allowed is 0 or more"):
            call()
    with pytest.raises(ModelError, match="tension has shape"):
        simulate(arm, tension=[1.0], t_end=0.01)
    simulate(arm, tension=[0.0, 0.6], t_end=0.004)
    assert "tension: tendon1" in caplog.text
    assert "0 to 0.5 N (max_tension_n)" in caplog.text


def test_what_drives_pressures_alone_refuses_tendons_in_one_line():
    robot = load_robot("tue_three_bellow").replace(tendons=[HELIX])
    arm = SoftArm(robot)
    with pytest.raises(ModelError, match="valves with tendons"):
        simulate(arm, valves=ValveModel())
    for build in (
        lambda: Controller(robot, ControllerConfig()),
        lambda: Controller(arm_of([HELIX]).robot, ControllerConfig()),
        lambda: ArmPlant(robot, TwinConfig()),
        lambda: Estimator(robot),
    ):
        with pytest.raises(ConfigError, match="simulate and fit take tendons") as caught:
            build()
        assert "\n" not in str(caught.value)


def test_a_run_with_tendons_is_plotted():
    run = simulate(arm_of([HELIX]), tension=[0.2], t_end=0.01)
    assert "tension, N" in [axes.get_ylabel() for axes in run.plot().axes]
