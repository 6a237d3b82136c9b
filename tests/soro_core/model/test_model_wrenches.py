"""Wrenches at the tip and at other places of the arm."""

import numpy as np
import pytest
from outside_arms import CASES, arm_of, state_of

from soro_core import SoftArm, simulate
from soro_core.errors import ModelError
from soro_core.integrate import make_stepper
from tests.refused import fails, refused


def places_of(n_links):
    """Inside a link, at the base, at the end of a link and, twice, at the tip; not in order."""
    return [0.1 * n_links, 0.0, 0.1 * n_links - 0.033, 0.1, 0.02, 0.1 * n_links]


@pytest.mark.parametrize(("n_links", "basis"), CASES)
def test_each_enters_by_the_jacobian_of_its_place(n_links, basis):
    places = places_of(n_links)
    arm = arm_of(n_links, basis, wrench_places=places)
    q, qd = state_of(arm)
    wrench = np.random.default_rng(1).normal(size=(len(places), 6))
    want = sum(arm.jacobian(q, s).T @ w for s, w in zip(places, wrench, strict=True))
    found = arm.external_forces(q, qd, wrench)
    np.testing.assert_allclose(found.generalised, want, atol=1e-12 * np.abs(want).max())
    M = arm.inertia_matrix(q)
    more = M @ (arm.forward_dynamics(q, qd, [], wrench) - arm.forward_dynamics(q, qd, []))
    np.testing.assert_allclose(more, want, atol=1e-9 * np.abs(want).max())
    for row, kind in enumerate(found.kind):
        k = kind // 6 - 1
        turned = arm.pose(q, places[k])[:3, :3] @ wrench[k, 3:]
        assert found.place[row] == pytest.approx(places[k])
        np.testing.assert_allclose(found.force[row], turned, atol=1e-12)


@pytest.mark.parametrize(("n_links", "basis"), CASES)
def test_the_default_is_one_at_the_tip(n_links, basis):
    arm = arm_of(n_links, basis)
    named = arm_of(n_links, basis, wrench_places=[0.1 * n_links])
    q, qd = state_of(arm)
    wrench = np.array([0.01, -0.02, 0.03, 0.4, -0.5, 0.6])
    want = arm.forward_dynamics(q, qd, [], wrench)
    np.testing.assert_allclose(named.forward_dynamics(q, qd, [], [wrench]), want, rtol=1e-10, atol=1e-9)
    runs = [
        simulate(one, 0.1 * q, t_end=0.02, dt=1e-3, wrench=w).q[-1]
        for one, w in ((arm, wrench), (named, [wrench]))
    ]
    np.testing.assert_allclose(runs[0], runs[1], atol=1e-9)


def test_a_step_takes_them_too():
    arm = arm_of(2, "constant", wrench_places=[0.05, 0.2])
    stepper = make_stepper("trapezoidal", arm)
    wrench = [[0.0, 0.0, 0.0, 0.1, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.1, 0.0]]
    state, status = stepper.step(stepper.initial_state(), [], 1e-3, wrench)
    assert status.ok
    run = simulate(arm, t_end=1e-3, dt=1e-3, wrench=wrench)
    np.testing.assert_array_equal(run.q[-1], state.q)
    assert np.abs(state.qd).max() > 1e-3
    wrench[1][0] = np.nan
    _, status = stepper.step(stepper.initial_state(), [], 1e-3, wrench)
    assert "wrench" in status


@pytest.mark.parametrize(
    ("places", "wrench", "names"),
    [
        ([0.05, 0.1], np.zeros(6), ("(6,)", "(2, 6)")),
        ([], np.zeros((1, 6)), ("(1, 6)", "(6,)")),
        ([], "up", ("'up'", "6")),
        ([0.05], np.full((1, 6), np.nan), ("nan",)),
    ],
)
def test_bad_wrenches(places, wrench, names):
    arm = arm_of(1, "constant", wrench_places=places)
    q, qd = state_of(arm)
    with fails(ModelError, *names, key="wrench"):
        arm.forward_dynamics(q, qd, [], wrench)
    with fails(ModelError, *names, key="wrench"):
        simulate(arm, t_end=0.01, dt=1e-3, wrench=wrench)


def test_one_place_takes_one_wrench_alone():
    arm = arm_of(1, "constant", wrench_places=[0.05])
    q, qd = state_of(arm)
    wrench = np.array([0.01, -0.02, 0.0, 0.1, 0.2, -0.1])
    rows = arm.forward_dynamics(q, qd, [], wrench[None, :])
    np.testing.assert_array_equal(arm.forward_dynamics(q, qd, [], wrench), rows)
    np.testing.assert_array_equal(arm.forward_dynamics(q, qd, [], wrench.tolist()), rows)
    assert not np.array_equal(arm.forward_dynamics(q, qd, []), rows)
    alone, row = (arm.external_forces(q, qd, each).generalised for each in (wrench, wrench[None, :]))
    np.testing.assert_array_equal(alone, row)


@pytest.mark.parametrize("places", [[-0.01], [0.05, 0.2001]])
def test_bad_places(places):
    with refused("wrench_places", names=("0.2 m",)):
        arm_of(2, "constant", wrench_places=places)


def test_method_mde_refuses():
    arm = arm_of(1, "constant", wrench_places=[0.05])
    with fails(ModelError, "mde", "exact", key="wrench_places"):
        SoftArm(arm.robot, method="mde")
