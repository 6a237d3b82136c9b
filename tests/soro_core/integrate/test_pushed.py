"""A wrench that is a function of time and state: closed forms, and the order of its error."""

import numpy as np
import pytest

from soro_core import SoftArm, robot_from_dict, simulate
from soro_core.errors import ModelError
from tests.refused import fails

LENGTH, RADIUS, DENSITY, E = 0.2, 0.01, 1000.0, 1e5
AREA = np.pi * RADIUS**2
MASS = DENSITY * AREA * LENGTH
SPRING, DAMPER = 30.0, 0.4


def bar(**keys):
    """A rod that only stretches, without weight and losses: a third of its mass swings on E A / L."""
    material = {"youngs_modulus": E, "shear_modulus": E / 3, "viscosity": 0.0}
    link = {"length": LENGTH, "radius": RADIUS, "density": DENSITY, "material": material}
    data = {"links": [{**link, "strains": {"elongation": {}}}], "gravity": [0.0, 0.0, 0.0], **keys}
    return SoftArm(robot_from_dict(data))


def follows(t, state):
    """A spring and a damper at the tip."""
    return [0.0, 0.0, 0.0, 0.0, 0.0, -LENGTH * (SPRING * state.q[0] + DAMPER * state.qd[0])]


def swing(t, q0):
    """Strain at times of the bar on spring and damper, released at q0."""
    decay = DAMPER / (2 * MASS / 3)
    rate = np.sqrt((E * AREA / LENGTH + SPRING) / (MASS / 3) - decay**2)
    return q0 * np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t))


@pytest.mark.parametrize("integrator", ["trapezoidal", "rk4", "tr_bdf2_linear"])
def test_a_spring_and_a_damper_that_follow_the_tip_have_their_closed_form(integrator):
    errors = []
    for dt in (2e-3, 1e-3, 5e-4):
        run = simulate(bar(), [0.05], t_end=0.3, dt=dt, wrench=follows, integrator=integrator)
        assert run.status.ok
        errors.append(np.abs(run.q[:, 0] - swing(run.t, 0.05)).max())
    assert errors[2] < 1e-3 * 0.05 * (3.0 if integrator == "tr_bdf2_linear" else 1.0)
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 2.0, atol=0.35)


def test_a_function_of_time_alone():
    """A force sin(w t) on the bar, at the middle of each step."""
    w = 40.0
    run = simulate(bar(), t_end=0.3, dt=2e-4, wrench=lambda t, _: [0.0] * 5 + [np.sin(w * t)])
    own = np.sqrt(3 * E * AREA / (LENGTH * MASS))
    wanted = (np.sin(w * run.t) - w / own * np.sin(own * run.t)) / (LENGTH * MASS / 3) / (own**2 - w**2)
    np.testing.assert_allclose(run.q[:, 0], wanted, atol=2e-4 * np.abs(wanted).max())


def test_a_constant_function_is_the_constant():
    wrench = [0.0, 0.0, 0.0, 0.0, 0.0, 0.3]
    given = simulate(bar(), t_end=0.05, dt=1e-3, wrench=wrench)
    run = simulate(bar(), t_end=0.05, dt=1e-3, wrench=lambda t, state: wrench)
    np.testing.assert_allclose(run.q, given.q, rtol=1e-9, atol=1e-12)


def test_what_the_function_sees_is_the_middle_of_the_step():
    seen = []

    def note(t, state):
        seen.append((t, state.q[0], state.qd[0]))
        return np.zeros(6)

    run = simulate(bar(), [0.05], t_end=0.1, dt=1e-3, wrench=note)
    t, q, qd = np.array(seen).T
    np.testing.assert_allclose(t, 0.5 * (run.t[1:] + run.t[:-1]))
    np.testing.assert_allclose(q[1:], 0.5 * (run.q[2:, 0] + run.q[1:-1, 0]), atol=1e-4)
    np.testing.assert_allclose(qd[1:], 0.5 * (run.qd[2:, 0] + run.qd[1:-1, 0]), atol=2e-2)


@pytest.mark.parametrize("value", [[1.0], "push", [np.nan] * 6])
def test_what_is_no_wrench_is_refused(value):
    with fails(ModelError, "wrench"):
        simulate(bar(), t_end=0.01, wrench=lambda t, state: value)
