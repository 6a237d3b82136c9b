"""The law against its definition and its proof: consistency, Lyapunov function, convergence, projection."""

import control_samples
import numpy as np
import pytest
from control_samples import LINK, adaptation
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core import SoftArm, robot_from_dict
from soro_core.control.passivity.adaptation_config import ADAPTABLE
from soro_core.control.passivity.adaptive import FeedbackGains, adapt, law
from soro_core.control.passivity.parameters import ParameterSet
from soro_core.control.reference.trajectory import Circle, Point
from tests.refused import refused

ROBOT = {**control_samples.ROBOT, "tip_mass": 0.004, "links": [LINK]}
ARM = SoftArm(robot_from_dict(ROBOT))
TWO_LINKS = SoftArm(robot_from_dict({**ROBOT, "links": [LINK, LINK]}))


def gains(n=3, k_p=(0.2, 1e-4, 1e-4), k_d=(1e-2, 1e-6, 1e-6), rate=5.0):
    links = n // 3
    return FeedbackGains(np.diag(np.tile(k_p, links)), np.diag(np.tile(k_d, links)), np.full(n, rate))


def state(seed, n=3):
    rng = np.random.default_rng(seed)
    scale = np.tile([0.08, 8.0, 8.0], n // 3)
    q, q_d = scale * rng.uniform(-1, 1, n), scale * rng.uniform(-1, 1, n)
    qd, qd_d, qdd_d = (scale * k * rng.uniform(-1, 1, n) for k in (5.0, 5.0, 20.0))
    return q, qd, Point(q_d, qd_d, qdd_d)


def dynamics(arm, q, qd, v, a):
    """M a + C v + G + f_e + R v, term by term from the model."""
    return (
        arm.inertia_matrix(q) @ a
        + arm.coriolis_matrix(q, qd) @ v
        + arm.gravity_force(q)
        + arm.elastic_force(q)
        + arm.damping_force(q, v)
    )


@given(st.integers(0, 2**32 - 1), st.sampled_from([ARM, TWO_LINKS]))
@settings(max_examples=40, deadline=None)
def test_with_true_parameters_the_law_is_the_model(seed, arm):
    q, qd, reference = state(seed, arm.n_q)
    k = gains(arm.n_q)
    parameters = ParameterSet(arm, adaptation(*ADAPTABLE))
    internal = np.arange(arm.n_q) * 1e-6
    terms = law(parameters, k, parameters.nominal, internal, q, qd, reference)
    e = q - reference.q
    v = reference.qd - k.rate * e
    a = reference.qdd - k.rate * (qd - reference.qd)
    expected = dynamics(arm, q, qd, v, a)
    assert terms.model == pytest.approx(expected, rel=1e-9, abs=1e-12)
    feedback = internal - k.k_p @ e - k.k_d @ (qd - v)
    assert terms.desired == pytest.approx(expected + feedback, rel=1e-9, abs=1e-12)
    assert terms.learnt == pytest.approx(np.zeros(arm.n_q), abs=1e-15)


@pytest.mark.parametrize("name", [name for name in ADAPTABLE if name != "chamber_gain"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_the_regressor_is_what_a_changed_robot_does(name, seed):
    """Y pi equals the force of a robot that really has the changed parameter."""
    q, qd, reference = state(seed)
    parameters = ParameterSet(ARM, adaptation(name))
    rng = np.random.default_rng(seed)
    changed = parameters.nominal * rng.uniform(0.7, 1.4, parameters.size) + (
        1e-8 if "damping" in name else 0.0
    )
    link, tip = {**LINK}, ROBOT["tip_mass"]
    if name in ("a1", "a2", "a4", "a5"):
        law_name, place = ("k_e", int(name[1]) - 1) if name in ("a1", "a2") else ("k_b", int(name[1]) - 4)
        value = list(LINK[law_name])
        low, high = (0.0, 0.95 * value[0]) if place == 1 else (1.05 * value[1], np.inf)
        changed = np.clip(changed, low, high)
        value[place] = float(changed[0])
        link[law_name] = value
    elif name == "tip_mass":
        tip = float(changed[0])
    elif name == "link_mass":
        link["mass"] = float(changed[0])
    elif name == "damping_stretch":
        link["damping"] = [float(changed[0]), *LINK["damping"][1:]]
    else:
        link["damping"] = [LINK["damping"][0], *(float(c) for c in changed)]
    other = SoftArm(robot_from_dict({**ROBOT, "tip_mass": tip, "links": [link]}))
    k = gains()
    terms = law(parameters, k, changed, np.zeros(3), q, qd, reference)
    v = reference.qd - k.rate * (q - reference.q)
    a = reference.qdd - k.rate * (qd - reference.qd)
    assert terms.model + terms.learnt == pytest.approx(dynamics(other, q, qd, v, a), rel=1e-9, abs=1e-12)


def closed_loop(arm, parameters, k, reference, start, estimate, true_gain, seconds, h):
    """Ideal actuator, exact structure: law and adaptation inside one RK4 step. Yields (t, V, -dV/dt, e)."""
    n, metric = arm.n_q, parameters.polytope.gain
    q, qd = start

    def rates(t, q, qd, pi):
        point = reference.sample(t)
        terms = law(parameters, k, pi, np.zeros(n), q, qd, point)
        actuation = arm.actuation_matrix(q)
        believed = actuation * parameters.gains(pi)
        pressure = np.linalg.solve(believed, terms.desired)
        regressor = terms.regressor + parameters.gain_regressor(actuation, pressure)
        made = true_gain * pressure
        return qd, arm.forward_dynamics(q, qd, made), -metric * (regressor.T @ terms.s), terms

    def lyapunov(q, qd, pi, terms, true):
        e = terms.error
        return 0.5 * (
            terms.s @ arm.inertia_matrix(q) @ terms.s + e @ k.k_p @ e + np.sum((pi - true) ** 2 / metric)
        )

    true = np.array(
        [true_gain if column.group == "chamber_gain" else column.nominal for column in parameters.columns]
    )
    pi, t = estimate.copy(), 0.0
    for _ in range(round(seconds / h)):
        *a, terms = rates(t, q, qd, pi)
        fall = terms.s @ k.k_d @ terms.s + terms.s @ arm.damping_force(q, terms.s)
        fall += terms.error @ k.k_p @ (k.rate * terms.error)
        yield t, lyapunov(q, qd, pi, terms, true), fall, terms.error
        b = rates(t + h / 2, q + h / 2 * a[0], qd + h / 2 * a[1], pi + h / 2 * a[2])
        c = rates(t + h / 2, q + h / 2 * b[0], qd + h / 2 * b[1], pi + h / 2 * b[2])
        d = rates(t + h, q + h * c[0], qd + h * c[1], pi + h * c[2])
        q = q + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        qd = qd + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        pi = parameters.polytope.project(pi + h / 6 * (a[2] + 2 * b[2] + 2 * c[2] + d[2]))
        t += h


CIRCLE = Circle(
    np.array([0.05, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), 6.0, 2.0, 0.0
)
SUBSETS = [
    ("tip_mass", "a1", "a4"),
    ("a1", "a2", "a4", "a5"),
    ("damping_curvature", "link_mass"),
    ("chamber_gain",),
]


@pytest.mark.parametrize("names", SUBSETS)
@pytest.mark.parametrize("seed", range(2))
def test_the_lyapunov_function_falls_as_the_proof_says(names, seed):
    rng = np.random.default_rng(seed)
    parameters = ParameterSet(ARM, adaptation(*names))
    wrong = parameters.polytope.project(parameters.nominal * rng.uniform(0.6, 1.5, parameters.size))
    true_gain = 1.15 if "chamber_gain" in names else 1.0
    start = (np.array([0.02, 1.0, -2.0]) * rng.uniform(0.5, 1.5, 3), np.array([0.1, 3.0, 2.0]))
    k = gains(k_d=(1e-1, 1e-5, 1e-5))
    h = 2e-4
    run = list(closed_loop(ARM, parameters, k, CIRCLE, start, wrong, true_gain, 0.2, h))
    values = np.array([value for _, value, _, _ in run])
    falls = np.array([fall for _, _, fall, _ in run])
    assert np.all(np.diff(values) <= 1e-9 * values[0])
    # The loss is what the dissipation adds up to; the projection can only add to it.
    lost, dissipated = values[0] - values[-1], np.sum(0.5 * (falls[1:] + falls[:-1])) * h
    assert lost >= dissipated * (1 - 2e-3)


@pytest.mark.slow
def test_the_tracking_error_converges():
    parameters = ParameterSet(ARM, adaptation("tip_mass", "a1", "a4", gain=[0.1, 1e8, 0.1]))
    wrong = parameters.polytope.project(parameters.nominal * np.array([0.1, 1.3, 0.7]))
    start = (np.zeros(3), np.zeros(3))
    k = gains(k_d=(1e-1, 1e-5, 1e-5))
    errors = np.array(
        [
            np.hypot(*e[1:])
            for _, _, _, e in closed_loop(ARM, parameters, k, CIRCLE, start, wrong, 1.0, 4.0, 5e-4)
        ]
    )
    assert errors[0] > 5.0
    assert np.sqrt(np.mean(errors[-1000:] ** 2)) < 0.02


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_estimates_stay_admissible_whatever_comes(seed):
    rng = np.random.default_rng(seed)
    parameters = ParameterSet(ARM, adaptation(*ADAPTABLE))
    estimate = parameters.nominal
    for _ in range(5):
        s = rng.standard_normal(3) * 10.0 ** rng.uniform(-3, 6)
        regressor = rng.standard_normal((3, parameters.size)) * 10.0 ** rng.uniform(-6, 6)
        estimate = adapt(parameters, estimate, regressor, s, 0.005)
        assert parameters.polytope.contains(estimate)
    bad = adapt(parameters, estimate, regressor, np.full(3, np.nan), 0.005)
    assert np.all(np.isfinite(bad))
    assert parameters.polytope.contains(bad)


def test_dead_zone_leakage_and_shortfall():
    parameters = ParameterSet(ARM, adaptation("tip_mass"))
    regressor = np.array([[0.5], [0.01], [0.0]])
    s = np.array([0.01, 2.0, 0.0])
    free = adapt(parameters, np.array([0.05]), regressor, s, 0.005)
    assert free == pytest.approx([0.05 - 0.005 * 0.1 * (0.5 * 0.01 + 0.01 * 2.0)])
    quiet = adapt(parameters, np.array([0.05]), regressor, s, 0.005, dead_zone=np.array([0.02, 1.5, 1.0]))
    assert quiet == pytest.approx([0.05 - 0.005 * 0.1 * 0.01 * 0.5])
    leaking = adapt(parameters, np.array([0.05]), regressor, np.zeros(3), 0.005, leakage=2.0)
    assert leaking == pytest.approx([0.05 - 0.005 * 2.0 * (0.05 - 0.004)])
    # A lower estimate wishes for less force along +x. Where even less than that is made, learning goes on;
    # where the pressures already make more than the wish, it would only lengthen the difference.
    more_made = adapt(parameters, np.array([0.05]), regressor, s, 0.005, shortfall=np.array([-0.1, 0.0, 0.0]))
    less_made = adapt(parameters, np.array([0.05]), regressor, s, 0.005, shortfall=np.array([0.1, 0.0, 0.0]))
    assert more_made == pytest.approx([0.05])
    assert less_made == pytest.approx(free)


def test_taken_at_the_reference_the_forces_do_not_depend_on_the_state():
    parameters = ParameterSet(ARM, adaptation("tip_mass", "a4"))
    q, qd, reference = state(1)
    one = law(parameters, gains(), parameters.nominal, np.zeros(3), q, qd, reference, at_reference=True)
    two = law(
        parameters, gains(), parameters.nominal, np.zeros(3), 0.5 * q, 0.1 * qd, reference, at_reference=True
    )
    assert one.model.tolist() == two.model.tolist()
    assert one.regressor.tolist() == two.regressor.tolist()
    expected = dynamics(ARM, reference.q, reference.qd, reference.qd, reference.qdd)
    assert one.model == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_a_material_has_no_elastic_parameters_to_adapt():
    link = {key: value for key, value in LINK.items() if key not in ("k_e", "k_b")}
    rubber = {**link, "material": {"youngs_modulus": 1e5, "shear_modulus": 3e4}}
    arm = SoftArm(robot_from_dict({**ROBOT, "links": [rubber]}))
    with refused("adaptation.parameters", "a4"):
        ParameterSet(arm, adaptation("a4"))
    assert ParameterSet(arm, adaptation("tip_mass")).names == ("tip_mass",)


@pytest.mark.parametrize(
    ("names", "changes", "named"),
    [
        (("a1",), {"gain": [1.0, 2.0]}, ("gain", "parameters")),
        (("a1",), {"upper": [50.0]}, ("lower", "upper", "a1")),
        (("tip_mass",), {"lower": [-1.0]}, ("lower", "tip_mass")),
        (("chamber_gain",), {"lower": [0.0]}, ("lower", "chamber_gain", "0")),
        (("a1", "a1"), {}, ("parameters",)),
    ],
)
def test_wrong_lists_are_refused(names, changes, named):
    with refused("", names=named):
        adaptation(*names, **changes)


def test_bounds_that_exclude_the_robot_are_refused():
    with refused("adaptation.tip_mass", (0.0, 0.001)):
        ParameterSet(ARM, adaptation("tip_mass", upper=[0.001]))
    with refused("adaptation", names=("margin",)):
        ParameterSet(ARM, adaptation("a1", margin_stretch_n_m=500.0))
