"""Frequencies and modes against simulated swings, closed forms of beams, and their own equations."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from soro_core import SoftArm, load_robot, robot_from_dict, simulate
from soro_core.errors import ModelError
from soro_core.model.equilibrium.statics import stable_equilibrium
from soro_lab.analysis.modes import first_order, modes
from soro_lab.analysis.stiffness import tangent_stiffness, tip_stiffness
from tests.soro_lab.analysis.test_stiffness import ARMS, at_rest


def rate_of(times, values):
    """Frequency [Hz] from the first and the last zero, and the decrement from the peaks between."""
    up = np.flatnonzero((values[:-1] < 0.0) != (values[1:] < 0.0))
    zeros = times[up] - values[up] * (times[1] - times[0]) / (values[up + 1] - values[up])
    hz = 0.5 * (len(zeros) - 1) / (zeros[-1] - zeros[0])
    peaks = [np.abs(values[a : b + 1]).max() for a, b in pairwise(up)]
    decay = np.log(peaks[0] / peaks[-1]) / ((len(peaks) - 1) * np.pi)
    return hz, decay / np.hypot(1.0, decay)


@pytest.mark.parametrize("pressure", [[0.0, 0.0, 0.0], [70e3, 20e3, 0.0]])
@pytest.mark.parametrize("k", [0, 1])
def test_a_free_swing_has_frequency_and_damping_of_its_mode(pressure, k, figure):
    robot = load_robot("tue_three_bellow")
    (link,) = robot.links
    link = link.model_copy(update={"creep": (), "damping": (0.01, 3e-7, 3e-7)})
    arm = SoftArm(robot.replace(links=[link]))
    q = stable_equilibrium(arm, pressure)
    found = modes(arm, q, tangent_stiffness(arm, np.array(pressure), q))
    start = 1e-3 * found.shapes[:, k] / np.abs(found.shapes[:, k]).max()
    run = simulate(arm, q + start, np.zeros(3), t_end=6.0 / found.frequency_hz[0], dt=2e-4, pressure=pressure)
    assert run.status.ok
    part = (run.q - q) @ arm.inertia_matrix(q) @ found.shapes[:, k]
    hz, ratio = rate_of(run.t, part)
    figure(f"mode {k + 1} at {pressure}: swing {hz:.5g} Hz, computed {found.damped_hz[k]:.5g} Hz")
    assert hz == pytest.approx(found.damped_hz[k], rel=5e-3)
    assert ratio == pytest.approx(found.damping_ratio[k], rel=2e-2)
    assert found.damped_hz[k] < found.frequency_hz[k]


@pytest.mark.parametrize("name", ["standing", "two links"])
def test_the_linear_system_with_creep_moves_as_the_arm(name):
    arm, p, q = at_rest(name)
    n, stiffness = arm.n_q, tangent_stiffness(arm, p, q)
    matrix = first_order(arm, q, stiffness, arm.inertia_matrix(q))
    rng = np.random.default_rng(1)
    x = np.zeros(len(matrix))
    x[:n] = 1e-6 * rng.standard_normal(n) / np.sqrt(np.diag(stiffness) / stiffness[0, 0])
    run = simulate(arm, q + x[:n], np.zeros(n), t_end=0.1, dt=1e-4, pressure=p)
    end = expm(0.1 * matrix) @ x
    assert run.q[-1] - q == pytest.approx(end[:n], rel=1e-2, abs=1e-3 * np.abs(end[:n]).max())
    assert arm.n_internal == 0 or run.internal[-1] == pytest.approx(end[2 * n :], rel=1e-2, abs=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_modes_are_orthogonal_and_make_the_compliance(name):
    arm, p, q = at_rest(name)
    stiffness, inertia = tangent_stiffness(arm, p, q), arm.inertia_matrix(q)
    found = modes(arm, q, stiffness)
    squares = (2.0 * np.pi * found.frequency_hz) ** 2
    assert np.abs(found.shapes.T @ inertia @ found.shapes - np.eye(arm.n_q)).max() < 1e-9
    kept = found.shapes.T @ stiffness @ found.shapes
    assert np.abs(kept - np.diag(squares)).max() < 1e-9 * squares.max()
    assert found.tip_share.sum() == pytest.approx(1.0)
    assert found.strain_share.sum(axis=1) == pytest.approx(np.ones(arm.n_q))
    pose, jacobian = arm.pose_and_jacobian(q, arm.length)
    tip = pose[:3, :3] @ jacobian[3:] @ found.shapes
    compliance = tip_stiffness(arm, q, stiffness).compliance
    assert (tip / squares) @ tip.T == pytest.approx(compliance, rel=1e-6, abs=1e-9 * compliance.max())
    assert found.tip_share == pytest.approx(np.sum(tip**2, axis=0) / squares / np.trace(compliance))


def test_a_slender_rod_that_bends_alone_has_the_frequencies_of_euler_and_bernoulli(figure):
    length, radius, density, young = 0.3, 3e-4, 1100.0, 1e6
    link = {"length": length, "radius": radius, "density": density}
    link |= {"strains": {"bending_x": {"basis": "legendre", "order": 8}}}
    link |= {"material": {"youngs_modulus": young, "shear_modulus": young / 3, "viscosity": 0.0}}
    arm = SoftArm(robot_from_dict({"links": [link], "gravity": [0.0, 0.0, 0.0]}))
    q = np.zeros(arm.n_q)
    found = modes(arm, q, tangent_stiffness(arm, np.zeros(0), q)).frequency_hz[:4]
    roots = np.array([1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349])
    bending = young * radius**2 / 4  # E I / A
    right = roots**2 * np.sqrt(bending / density) / length**2 / (2.0 * np.pi)
    error = found / right - 1.0
    figure(f"slender rod: first four frequencies {error} from Euler and Bernoulli")
    assert np.abs(error[:3]).max() < 1e-4
    assert abs(error[3]) < 2e-3


def test_many_links_of_constant_curvature_come_near_to_them():
    """Second order in the number of links."""
    length, radius, density, young = 0.3, 3e-4, 1100.0, 1e6
    right = 1.8751040687**2 * np.sqrt(young * radius**2 / 4 / density) / length**2 / (2.0 * np.pi)
    errors = []
    for n in (6, 12):
        link = {"length": length / n, "radius": radius, "density": density, "strains": {"bending_x": {}}}
        link |= {"material": {"youngs_modulus": young, "shear_modulus": young / 3, "viscosity": 0.0}}
        arm = SoftArm(robot_from_dict({"links": [link] * n, "gravity": [0.0, 0.0, 0.0]}))
        q = np.zeros(arm.n_q)
        errors.append(modes(arm, q, tangent_stiffness(arm, np.zeros(0), q)).frequency_hz[0] / right - 1.0)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_equal_frequencies_have_shapes_of_one_coordinate_each():
    arm = SoftArm(load_robot("tue_three_bellow"))
    q = stable_equilibrium(arm, np.zeros(3))
    found = modes(arm, q, tangent_stiffness(arm, np.zeros(3), q))
    assert found.frequency_hz[0] == pytest.approx(found.frequency_hz[1])
    assert np.abs(found.shapes[2, 0]) < 1e-6 * found.shapes[1, 0]
    assert np.abs(found.shapes[1, 1]) < 1e-6 * found.shapes[2, 1]
    assert found.dominant(2) == [0, 1]


def test_modes_about_an_unstable_equilibrium_are_refused():
    arm = SoftArm(load_robot("six_link"))
    q = np.zeros(arm.n_q)
    with pytest.raises(ModelError) as caught:
        modes(arm, q, tangent_stiffness(arm, np.zeros(1), q))
    assert caught.value.key == "q"
