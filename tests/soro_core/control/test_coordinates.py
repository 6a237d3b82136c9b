"""Strains with several coefficients: the controller and the filter mean the same in every basis."""

import control_samples
import numpy as np
import pytest
from control_samples import adaptation
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import chebyshev, legendre

from soro_core import SoftArm, robot_from_dict
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.passivity.adaptation_config import ADAPTABLE
from soro_core.control.passivity.adaptive import law
from soro_core.control.passivity.parameters import ParameterSet
from soro_core.control.reference.trajectory import Point
from soro_core.estimation import Estimator, EstimatorConfig, PoseSample
from soro_core.estimation.config import InitialNoise
from soro_core.robot import shape_values
from soro_core.rotation import quaternion_from_matrix
from tests.refused import refused

STRAINS = ("elongation", "bending_x", "bending_y")
CHAMBERS = [{**chamber, "area_slope": -2.0} for chamber in control_samples.CHAMBERS]
LAW = {**control_samples.LAW, "chambers": CHAMBERS}
MATERIAL = {"youngs_modulus": 3e5, "shear_modulus": 1e5, "viscosity": 400.0}
SOFT = {"length": 0.064, "radius": 0.013, "mass": 0.017, "material": MATERIAL, "chambers": CHAMBERS}
DT = 0.005
AT = np.linspace(0.0, 1.0, 21)


def arm_of(field, link=LAW, links=1, **keys):
    link = {**link, "strains": dict.fromkeys(STRAINS, field), **keys}
    return robot_from_dict({"name": "test arm", "base_quaternion": [1.0, 0, 0, 0], "links": [link] * links})


def polynomial(basis, order):
    return {"basis": basis, "order": order}


def config(**changes):
    return parse({"law": "adaptive", **changes}, ControllerConfig, "test")


def to_chebyshev(order, strains=3):
    """Matrix from Legendre to Chebyshev coefficients, strain by strain."""
    one = np.zeros((order + 1, order + 1))
    for k, unit in enumerate(np.eye(order + 1)):
        found = chebyshev.poly2cheb(legendre.leg2poly(unit))
        one[: len(found), k] = found
    return np.kron(np.eye(strains), one)


def run_controller(robot, q, qd, **changes):
    control = Controller(robot, config(**changes))
    state = control.initial_state()
    rows = []
    for k in range(30):
        wave = np.sin(0.3 * k)
        state, command = control.step(state, wave * q, wave * qd, k * DT, DT, state.model_pa)
        rows.append(np.concatenate([command.setpoint_pa, state.law.estimate]))
    return control, np.array(rows), command


@pytest.mark.parametrize("compensation", ["reference", "measured"])
@pytest.mark.parametrize("seed", range(3))
def test_the_law_does_not_depend_on_the_basis(seed, compensation):
    """Legendre and Chebyshev polynomials of one order span the same strains: the same pressures come out."""
    order, turn = 2, to_chebyshev(2)
    rng = np.random.default_rng(seed)
    q = np.kron([0.03, 3.0, 3.0], np.ones(3)) * rng.normal(size=9)
    qd = 5.0 * np.kron([0.03, 3.0, 3.0], np.ones(3)) * rng.normal(size=9)
    settings = {
        "compensation": compensation,
        "gains": {"k_p": [1.0, 2e-5, 3e-5], "k_d": [0.1, 1e-6, 1e-6], "lambda_per_s": [4.0, 5.0, 6.0]},
        "reference": {"start_s": 0.05},
        "adaptation": {
            "parameters": ["tip_mass", "damping_curvature", "link_mass"],
            "gain": [0.5, 1e-9, 0.1],
            "lower": [0.0, 0.0, 0.0],
            "upper": [0.1, 1.0, 0.1],
            # A switch: round-off decides where the pressures just make the force.
            "hold_saturated": False,
        },
    }
    one, first, command = run_controller(arm_of(polynomial("legendre", order), SOFT), q, qd, **settings)
    two, second, other = run_controller(
        arm_of(polynomial("chebyshev", order), SOFT), turn @ q, turn @ qd, **settings
    )
    assert one.law.parameters.names == two.law.parameters.names
    np.testing.assert_allclose(first, second, rtol=1e-5)
    np.testing.assert_allclose(turn @ command.reference.q, other.reference.q, atol=1e-9)
    # Forces are turned the other way round: the power is the same.
    np.testing.assert_allclose(command.desired_force, turn.T @ other.desired_force, rtol=1e-6, atol=1e-9)


def test_modes_that_span_the_polynomials_give_the_same_law():
    """Sampled straight lines, which splines reproduce: pod is then legendre of order 1."""
    modes = np.stack([1.0 + 0.5 * AT, -1.0 + 3.0 * AT], axis=1)
    q = np.array([0.02, 0.01, 3.0, -2.0, 1.0, 4.0])
    # c0 (1 + x/2) + c1 (-1 + 3 x) = a + b (2 x - 1): a = 1.25 c0 + 0.5 c1, b = 0.25 c0 + 1.5 c1
    turn = np.kron(np.eye(3), np.linalg.inv([[1.25, 0.5], [0.25, 1.5]]))
    _, first, _ = run_controller(arm_of(polynomial("legendre", 1)), q, 3 * q)
    pod = arm_of({"basis": "pod", "samples": modes})
    _, second, _ = run_controller(pod, turn @ q, 3 * turn @ q)
    np.testing.assert_allclose(first, second, rtol=1e-5)


def test_tip_references_do_not_depend_on_the_basis():
    turn = to_chebyshev(2)
    one, two = (Controller(arm_of(polynomial(b, 2)), config()) for b in ("legendre", "chebyshev"))
    target = np.array([0.012, -0.008, -0.062])
    found = one.tip(one.initial_state(), target).sample(0.0).q
    assert one.arm.pose(found, 0.064)[:3, 3] == pytest.approx(target, abs=1e-7)
    other = two.tip(two.initial_state(), target).sample(0.0).q
    np.testing.assert_allclose(turn @ found, other, rtol=1e-5, atol=1e-7)


def test_order_zero_is_constant_strain():
    damping = {"damping": [0.01, 2e-7, 2e-7]}
    q, qd = np.array([0.02, 3.0, -2.0]), np.array([0.1, 10.0, 5.0])
    _, first, _ = run_controller(arm_of({}, **damping), q, qd)
    _, second, _ = run_controller(arm_of(polynomial("legendre", 0), **damping), q, qd)
    np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-6)


def changed_robot(name, value, field, losses):
    """Robot that really has the value of one adapted parameter of each kind."""
    link, keys = {**LAW}, {}
    if name in ("a1", "a2", "a4", "a5"):
        key, place = ("k_e", int(name[1]) - 1) if name < "a3" else ("k_b", int(name[1]) - 4)
        law_values = list(LAW[key])
        law_values[place] = value
        link[key] = law_values
    elif name == "tip_mass":
        keys["tip_mass"] = value
    elif name == "link_mass":
        link["mass"] = value
    return arm_of(field, link, damping=losses).replace(**keys)


@pytest.mark.parametrize("basis", ["legendre", "chebyshev"])
@pytest.mark.parametrize("name", ["a1", "a2", "a4", "a5", "tip_mass", "link_mass"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=5, deadline=None, derandomize=True)
def test_the_regressor_is_what_a_changed_robot_does(name, basis, seed):
    rng = np.random.default_rng(seed)
    field, losses = polynomial(basis, 2), (1e-7 * rng.uniform(1, 2, 9)).tolist()
    value = {"a1": 1500.0, "a2": 800.0, "a4": 0.01, "a5": 0.003, "tip_mass": 0.03, "link_mass": 0.02}[name]
    arm, other = (
        SoftArm(r) for r in (arm_of(field, damping=losses), changed_robot(name, value, field, losses))
    )
    parameters = ParameterSet(arm, adaptation(*ADAPTABLE))
    at = [i for i, column in enumerate(parameters.columns) if column.group == name]
    assert len(at) == 1
    estimate = parameters.nominal.copy()
    estimate[at] = value
    scale = np.kron([0.03, 4.0, 4.0], np.ones(3))
    q, qd, v, a = (scale * k * rng.normal(size=9) for k in (1.0, 5.0, 5.0, 20.0))
    force, regressor = parameters.model_force(q, qd, v, a)
    expected = (
        other.inertia_matrix(q) @ a
        + other.coriolis_matrix(q, qd) @ v
        + other.gravity_force(q)
        + other.elastic_force(q)
        + other.damping_force(q, v)
    )
    made = force + regressor @ (estimate - parameters.nominal)
    np.testing.assert_allclose(made, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("basis", ["legendre", "chebyshev"])
def test_adapted_damping_is_a_viscosity(basis):
    """One parameter a strain; Y pi is all of the damping force, and that of another viscosity as well."""
    thin, thick = (
        SoftArm(arm_of(polynomial(basis, 2), {**SOFT, "material": {**MATERIAL, "viscosity": eta}}))
        for eta in (400.0, 700.0)
    )
    parameters = ParameterSet(thin, adaptation("damping_stretch", "damping_curvature"))
    assert parameters.names == tuple(f"link0/{strain}/damping" for strain in STRAINS)
    rng = np.random.default_rng(4)
    q, v = np.zeros(9), rng.normal(size=9) * np.kron([0.1, 10.0, 10.0], np.ones(3))
    _, regressor = parameters.model_force(q, v, v, v)
    for arm, factor in ((thin, 1.0), (thick, 1.75)):
        want = arm.damping_force(q, v)
        np.testing.assert_allclose(
            regressor @ (factor * parameters.nominal), want, rtol=1e-9, atol=1e-12 * np.abs(want).max()
        )


def test_given_damping_leaves_a_rest_that_dissipates():
    arm = SoftArm(arm_of(polynomial("legendre", 1), damping=[0.02, 0.01, 3e-7, 3e-7, 1e-7, 4e-7]))
    parameters = ParameterSet(arm, adaptation("damping_stretch", "damping_curvature"))
    np.testing.assert_allclose(parameters.nominal, [0.02, 3e-7, 1e-7], rtol=1e-9)
    _, regressor = parameters.model_force(np.zeros(6), np.zeros(6), np.ones(6), np.zeros(6))
    rest = arm.damping_matrix() @ np.ones(6) - regressor @ parameters.nominal
    assert np.all(rest > -1e-15)


def test_values_a_strain_or_a_coordinate():
    robot = arm_of(polynomial("legendre", 1), links=2)
    by_strain = Controller(robot, config(gains={"k_p": [1.0, 2.0, 3.0]}))
    assert np.diag(by_strain.gains.k_p) == pytest.approx([1, 1 / 3, 2, 2 / 3, 3, 1] * 2)
    values = [float(i) for i in range(6)]
    assert np.diag(Controller(robot, config(gains={"k_p": values})).gains.k_p).tolist() == values * 2
    values = [float(i) for i in range(12)]
    assert np.diag(Controller(robot, config(gains={"k_p": values})).gains.k_p).tolist() == values
    with refused("gains.k_p", names=("3", "6", "12")):
        Controller(robot, config(gains={"k_p": [1.0] * 4}))


def test_set_points_a_strain_are_uniform():
    settings = {"reference": {"kind": "set_point", "set_point": [0.05, 1.0, 3.0], "start_s": 0.01}}
    _, _, command = run_controller(arm_of(polynomial("chebyshev", 1)), np.zeros(6), np.zeros(6), **settings)
    assert command.reference.q.tolist() == [0.05, 0.0, 1.0, 0.0, 3.0, 0.0]


def test_limits_hold_for_the_strain_along_the_link():
    control = Controller(arm_of(polynomial("legendre", 1)), config())
    names = control.robot.coordinate_names
    control.trajectory(0.0, names, [0.0], [[0.5, 0.1, 40.0, -6.0, 0.0, 0.0]])
    with refused("largest elongation along link0", pytest.approx(0.7), ("-0.6",)):
        control.trajectory(0.0, names, [0.0], [[0.5, 0.2, 0.0, 0.0, 0.0, 0.0]])
    # A wild state does not stop the controller.
    _, command = control.step(
        control.initial_state(), np.full(6, 1e300), np.full(6, -1e300), 0.0, DT, np.zeros(3)
    )
    assert np.all(np.isfinite(command.setpoint_pa))


def test_the_filter_does_not_depend_on_the_basis():
    turn, length = to_chebyshev(2), 0.064
    # A tenth of the doubt of the defaults, and less of it for a refused sample: the first samples would throw
    # nine coefficients far out, where the least difference grows.
    start = {key: 0.1 * std for key, std in InitialNoise().model_dump().items()}
    doubt = parse({"initial": start, "outlier_inflation": 2.0}, EstimatorConfig, "test")
    arms = [arm_of(polynomial(basis, 2)) for basis in ("legendre", "chebyshev")]
    filters = [Estimator(one, doubt, DT) for one in arms]
    states = [one.initial_state() for one in filters]
    rng = np.random.default_rng(1)
    arm = SoftArm(arm_of(polynomial("legendre", 2)))
    for k in range(1, 40):
        q = np.sin(0.05 * k) * np.array([0.03, 0.01, 0.0, 5.0, 1.0, 0.5, -3.0, 1.0, 1.0])
        pose = arm.pose(q, length)
        turn_of = quaternion_from_matrix(pose[:3, :3])
        sample = PoseSample(k * DT, pose[:3, 3] + 1e-4 * rng.normal(size=3), turn_of, length)
        results = [
            one.step(state, np.full(3, 2e4), [sample], [], DT)
            for one, state in zip(filters, states, strict=True)
        ]
        states = [result[0] for result in results]
    (first, second) = (result[1] for result in results)
    np.testing.assert_allclose(turn @ first.q, second.q, rtol=0.0, atol=1e-6)
    most = np.abs(first.tip_covariance).max()
    np.testing.assert_allclose(first.tip_covariance, second.tip_covariance, rtol=0.0, atol=1e-6 * most)


def test_a_law_of_one_error_is_its_mean_square():
    """e' K_p e = k_p mean(e^2) along the link."""
    robot = arm_of(polynomial("chebyshev", 2))
    control = Controller(robot, config(gains={"k_p": [1.0, 2.0, 3.0]}))
    rng = np.random.default_rng(2)
    e = rng.normal(size=9) * np.kron([0.01, 1.0, 1.0], np.ones(3))
    zero = np.zeros(9)
    known = control.law.parameters
    terms = law(known, control.gains, known.nominal, zero, e, zero, Point(zero, zero, zero))
    x, w = legendre.leggauss(8)
    shapes = shape_values(robot.links[0], (x + 1) / 2 * 0.064)
    squares = [w / 2 @ (e[3 * i : 3 * i + 3] @ shapes[3 * i : 3 * i + 3]) ** 2 for i in range(3)]
    assert -terms.proportional @ e == pytest.approx(np.dot([1.0, 2.0, 3.0], squares), rel=1e-12)
