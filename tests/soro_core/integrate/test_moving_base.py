"""A base that moves as given: forces of inertia against gravity, a closed form, and Lagrange's equations."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from soro_core import BaseState, Shake, SoftArm, robot_from_dict, simulate, simulate_many
from soro_core.config import parse
from soro_core.errors import ConfigError, ModelError
from soro_core.integrate import STEPPERS, make_stepper
from soro_core.pneumatics import ValveModel
from soro_core.robot import Discretisation
from soro_core.rotation import rotation_exp
from soro_core.twin import Twin, TwinConfig

LENGTH, RADIUS, DENSITY, E = 0.12, 0.01, 1100.0, 2e5
MATERIAL = {"youngs_modulus": E, "shear_modulus": 7e4, "shear_correction": False}
BENDING = ("elongation", "bending_x", "bending_y")
TURN = np.array([0.3, -0.5, 0.4])
SHIFT = np.array([0.02, 0.01, -0.015])
RATE = 11.0


def arm_of(strains=BENDING, order=0, links=1, viscosity=0.0, nodes=None, **keys):
    shape = {"basis": "legendre", "order": order} if order else {}
    material = {**MATERIAL, "viscosity": viscosity}
    link = {"length": LENGTH / links, "radius": RADIUS, "density": DENSITY, "material": material}
    links = [{**link, "strains": dict.fromkeys(strains, shape)}] * links
    return SoftArm(robot_from_dict({"links": links, **keys}), nodes=nodes)


def swing(t):
    """Turn about a fixed axis and shift with other phases: all of Coriolis, Euler and centrifugal forces."""
    x, v = math.sin(RATE * t), RATE * math.cos(RATE * t)
    y, u = math.sin(RATE * t + 1.0), RATE * math.cos(RATE * t + 1.0)
    return BaseState(
        y * SHIFT, u * SHIFT, -(RATE**2) * y * SHIFT, rotation_exp(x * TURN), v * TURN, -(RATE**2) * x * TURN
    )


@pytest.mark.slow
@pytest.mark.parametrize("integrator", STEPPERS)
def test_a_base_of_constant_acceleration_is_another_gravity(integrator):
    a = np.array([2.0, -1.0, 3.0])
    arm = arm_of(links=2, tip_mass=0.01, base_quaternion=[0.5, 0.5, 0.5, 0.5], gravity=[0.0, 0.0, -9.81])
    other = SoftArm(arm.robot.replace(gravity=(np.array([0.0, 0.0, -9.81]) - a).tolist()))
    options = {"t_end": 0.1, "dt": 1e-3, "integrator": integrator}
    run = simulate(arm, base=lambda t: BaseState(0.5 * a * t**2, a * t, a), **options)
    wanted = simulate(other, **options)
    assert run.status.ok, run.status
    assert np.abs(wanted.q).max() > 0.5
    # The balance of energy of TR-BDF2 applies to a base at rest.
    tolerance = 1e-3 if "bdf2" in integrator else 1e-9
    np.testing.assert_allclose(run.q, wanted.q, atol=tolerance * np.abs(wanted.q).max())
    np.testing.assert_allclose(run.tip, wanted.tip + 0.5 * np.outer(run.t**2, a), atol=tolerance * LENGTH)


def test_a_spinning_rod_is_stretched_as_its_closed_form():
    """E z'' + rho w^2 z = 0 with z(0) = 0 and z'(L) = 1: the rod points out from the axis of its base."""
    spin = 60.0
    arm = arm_of(
        ("elongation",),
        order=5,
        viscosity=2e3,
        gravity=[0.0, 0.0, 0.0],
        base_quaternion=[0.0, 0.5**0.5, 0.0, 0.5**0.5],
    )
    axis = np.array([0.0, 0.0, 1.0])

    def base(t):
        return BaseState(rotation=rotation_exp(spin * t * axis), angular_velocity=spin * axis)

    run = simulate(arm, base=base, t_end=1.0, dt=2e-3)
    k = spin * math.sqrt(DENSITY / E)
    reach = math.tan(k * LENGTH) / k
    assert reach > 1.05 * LENGTH
    assert np.linalg.norm(run.tip[-1]) == pytest.approx(reach, abs=1e-6 * LENGTH)
    turned = rotation_exp(spin * 1.0 * axis) @ [reach, 0.0, 0.0]
    np.testing.assert_allclose(run.tip[-1], turned, atol=1e-6 * LENGTH)


class Lagrange:
    """Energies in the world of an arm on a base that moves, from poses and Jacobians of its sections."""

    def __init__(self, arm, base):
        self.arm, self.base = arm, base
        x, w = np.polynomial.legendre.leggauss(10)
        self.places, self.shares = 0.5 * LENGTH * (x + 1.0), 0.5 * w
        mass = DENSITY * math.pi * RADIUS**2 * LENGTH
        turn = 0.25 * RADIUS**2
        self.slice = mass * np.array([turn, turn, 2 * turn, 1.0, 1.0, 1.0])

    def sections(self, q):
        return [
            (*self.arm.pose_and_jacobian(q, s), w * self.slice)
            for s, w in zip(self.places, self.shares, strict=True)
        ] + [
            (
                *self.arm.pose_and_jacobian(q, LENGTH),
                self.arm.robot.tip_mass * np.array([0, 0, 0, 1.0, 1.0, 1.0]),
            )
        ]

    def parts(self, q, t):
        """M, and the share of the base in the twists: T = qd M qd / 2 + qd b + c, with -U_g."""
        now = self.base(t)
        n = self.arm.n_q
        M, b, c, weight = np.zeros((n, n)), np.zeros(n), 0.0, 0.0
        for pose, J, inertia in self.sections(q):
            R, x = now.rotation @ pose[:3, :3], now.rotation @ pose[:3, 3]
            carried = np.concatenate(
                [R.T @ now.angular_velocity, R.T @ (now.velocity + np.cross(now.angular_velocity, x))]
            )
            M += J.T @ (inertia[:, None] * J)
            b += J.T @ (inertia * carried)
            c += 0.5 * carried @ (inertia * carried)
            weight += inertia[5] * self.arm.tables.gravity @ (x + now.displacement)
        return M, b, c, weight

    def slope(self, t, y):
        """Hamilton's equations in q and the momenta."""
        n = self.arm.n_q
        q, momentum = y[:n], y[n:]
        M, b, _, _ = self.parts(q, t)
        qd = np.linalg.solve(M, momentum - b)

        def lagrangian(x):
            M, b, c, weight = self.parts(x, t)
            return 0.5 * qd @ M @ qd + qd @ b + c + weight

        steps = np.diag([1e-3, 0.1, 0.1])
        force = np.array(
            [
                (8 * (lagrangian(q + e) - lagrangian(q - e)) - lagrangian(q + 2 * e) + lagrangian(q - 2 * e))
                / (12 * e.sum())
                for e in steps
            ]
        )
        return np.concatenate([qd, force - self.arm.elastic_force(q)])


@pytest.mark.slow
def test_coriolis_euler_and_centrifugal_forces_are_those_of_lagrange():
    arm = arm_of(tip_mass=0.005, nodes=12)
    reference = Lagrange(arm, swing)
    q0, qd0 = np.array([0.02, 2.0, -1.0]), np.array([0.1, 10.0, 20.0])
    M, b, _, _ = reference.parts(q0, 0.0)
    end = 0.15
    found = solve_ivp(
        reference.slope, (0.0, end), np.concatenate([q0, M @ qd0 + b]), method="DOP853", rtol=1e-9, atol=1e-11
    )
    run = simulate(arm, q0, qd0, base=swing, t_end=end, dt=2e-5, integrator="rk4")
    assert run.status.ok, run.status
    still = simulate(arm, q0, qd0, t_end=end, dt=1e-4, integrator="rk4")
    wanted = found.y[:3, -1]
    assert np.abs(still.q[-1] - wanted).max() > 0.1 * np.abs(wanted).max()
    np.testing.assert_allclose(run.q[-1], wanted, atol=1e-6 * np.abs(wanted).max())


@pytest.mark.slow
def test_the_base_does_the_work_that_the_arm_gains():
    """The force on a shaken base is the rate of the arm's momentum less its weight."""
    arm = arm_of(tip_mass=0.005, nodes=12)
    shake = Shake(frequency_hz=4.0, amplitude_m=(0.02, 0.01, 0.005))
    reference = Lagrange(arm, shake)
    run = simulate(arm, [0.01, 2.0, -1.0], base=shake, t_end=0.2, dt=1e-4, integrator="rk4")
    total, momentum, speed = [], [], []
    for t, q, qd in zip(run.t, run.q, run.qd, strict=True):
        now = shake(t)
        M, b, c, weight = reference.parts(q, t)
        total.append(0.5 * qd @ M @ qd + qd @ b + c - weight + arm.energy(q, qd)[2])
        parts = [(i[5], pose[:3, :3] @ J[3:] @ qd + now.velocity) for pose, J, i in reference.sections(q)]
        mass = sum(m for m, _ in parts)
        momentum.append(sum(m * v for m, v in parts) - mass * t * arm.tables.gravity)
        speed.append(now.velocity)
    middle = 0.5 * np.sum((np.array(speed)[1:] + np.array(speed)[:-1]) * np.diff(momentum, axis=0), axis=1)
    gained, work = np.array(total) - total[0], np.append(0.0, np.cumsum(middle))
    assert np.abs(work).max() > 1e-3
    np.testing.assert_allclose(gained, work, atol=1e-5 * np.abs(work).max())


@pytest.mark.slow
def test_implicit_steppers_converge_to_the_same_motion():
    arm = arm_of(order=1, viscosity=100.0, tip_mass=0.005)
    exact = simulate(arm, base=swing, t_end=0.1, dt=5e-5, integrator="rk4").q[-1]
    for integrator in ("trapezoidal", "midpoint", "tr_bdf2", "tr_bdf2_linear", "dopri5"):
        errors = [
            np.abs(simulate(arm, base=swing, t_end=0.1, dt=dt, integrator=integrator).q[-1] - exact).max()
            for dt in (1e-3, 5e-4)
        ]
        assert errors[1] < 0.4 * errors[0] or errors[1] < 1e-7, integrator
        assert errors[1] < 3e-3 * np.abs(exact).max(), integrator


@pytest.mark.slow
def test_a_tip_held_in_the_world_stays_while_the_base_moves():
    arm = arm_of(order=2, viscosity=100.0)
    point = arm.pose(np.zeros(arm.n_q), LENGTH)[:3, 3].tolist()
    held = SoftArm(arm.robot.replace(tip_constraint={"point": point}))
    shake = Shake(frequency_hz=2.0, amplitude_m=(0.01, 0.0, 0.0), amplitude_rad=(0.0, 0.0, 0.2))
    run = simulate(held, base=shake, t_end=0.4, dt=1e-3)
    assert run.status.ok, run.status
    assert np.abs(run.tip - point).max() < 5e-5
    free = simulate(arm, base=shake, t_end=0.4, dt=1e-3)
    assert np.abs(free.tip - point).max() > 5e-3


def test_a_base_at_rest_is_the_base_of_the_file():
    arm = arm_of(links=2, tip_mass=0.01)
    plain = simulate(arm, [0.0, 2.0, 1.0] * 2, t_end=0.05)
    still = simulate(arm, [0.0, 2.0, 1.0] * 2, t_end=0.05, base=lambda t: BaseState())
    np.testing.assert_array_equal(still.q, plain.q)
    np.testing.assert_allclose(still.tip, plain.tip, atol=1e-15)
    assert plain.base is None
    many = simulate_many(arm, [[0.0, 2.0, 1.0] * 2] * 2, t_end=0.05, base=swing)
    np.testing.assert_array_equal(many[1].q, simulate(arm, [0.0, 2.0, 1.0] * 2, t_end=0.05, base=swing).q)
    assert np.abs(many.tip[1] - plain.tip).max() > 1e-3


@pytest.mark.parametrize(
    ("base", "words"),
    [
        (lambda t: [0.0, 0.0, 0.0], "a BaseState"),
        (lambda t: BaseState(velocity=[1.0]), "velocity"),
        (lambda t: BaseState(rotation=2 * np.eye(3)), "a rotation"),
        (lambda t: BaseState(acceleration=[0.0, math.nan, 0.0]), "acceleration"),
    ],
)
def test_what_is_no_motion_is_refused_in_one_line(base, words):
    with pytest.raises(ModelError, match=words) as caught:
        simulate(arm_of(), base=base, t_end=0.01)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_what_has_no_moving_base_says_so():
    arm = arm_of()
    mde = SoftArm(arm.robot, method="mde")
    with pytest.raises(ModelError, match="method 'mde'"):
        simulate(mde, base=swing, t_end=0.01)
    stepper = make_stepper("midpoint", arm, guarded=False, base=swing)
    with pytest.raises(ModelError, match="a base that moves"):
        stepper.derivatives(stepper.initial_state(), [], 1e-3)
    blown = SoftArm(
        arm.robot.with_({"links[0].chambers": [{"angle_rad": 0.0, "area_m2": 1e-5, "offset_m": 5e-3}]})
    )
    with pytest.raises(ModelError, match="base with valves"):
        simulate(blown, base=swing, valves=ValveModel(), t_end=0.01)


def test_the_base_of_the_twin_shakes_as_in_a_run():
    bent = {"links[0].chambers": [{"angle_rad": 0.0, "area_m2": 1e-5, "offset_m": 5e-3}]}
    arm = arm_of(viscosity=200.0, tip_mass=0.005)
    robot = arm.robot.with_(bent)
    shake = Shake(frequency_hz=3.0, amplitude_m=(0.01, 0.0, 0.0), amplitude_rad=(0.0, 0.2, 0.1))
    keys = {"refine": 1, "rate_hz": 100.0, "model": Discretisation()}
    twin = Twin(robot, TwinConfig(base_shake=shake, **keys))
    state = twin.initial()
    run = simulate(twin.plant.arm, state.arm.q, base=shake, t_end=0.2, dt=twin.config.step_s)
    for k in range(21):
        state, seen = twin.observe(state)
        np.testing.assert_allclose(seen.tip[:3, 3], run.tip[4 * k], atol=1e-9)
        state = twin.step_setpoints(state, np.zeros(1))
    still = Twin(robot, TwinConfig(**keys))
    assert np.linalg.norm(seen.tip - still.observe(still.initial())[1].tip) > 5e-3


@pytest.mark.parametrize("beside", [{"air": "states"}, {"imu": {"enabled": True, "rate_hz": 100.0}}])
def test_a_twin_names_what_does_not_go_with_a_base_that_moves(beside):
    keys = {"base_shake": {"frequency_hz": 2.0, "amplitude_m": [0.01, 0.0, 0.0]}}
    assert parse({**keys, "base_shake": {}, **beside}, TwinConfig, where="twin").base_shake == Shake()
    with pytest.raises(ConfigError, match="base_shake") as caught:
        parse({**keys, **beside}, TwinConfig, where="twin")
    assert "\n" not in str(caught.value)
    for wrong in ({"frequency_hz": 0}, {"amplitude_m": [1.0]}, {"amplitude": 1.0}):
        with pytest.raises(ConfigError, match="base_shake"):
            parse({"base_shake": wrong}, TwinConfig, where="twin")
