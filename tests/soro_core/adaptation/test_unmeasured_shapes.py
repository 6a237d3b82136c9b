"""A deviation of the estimate that its covariance names is not learned, by whatever force it shows."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.adaptation.config import LearnerConfig
from soro_core.adaptation.learner import Learner
from soro_core.adaptation.learning.state import LearnerSample
from soro_core.config import find_config
from soro_core.model.equilibrium.statics import equilibrium

pytestmark = pytest.mark.numerics

DT = 0.005


@pytest.fixture(scope="module")
def hanging():
    """Two links with 50 g: weight is as much of the slope of their forces as stiffness."""
    one = load_robot(find_config("tue_three_bellow", "robots"))
    return SoftArm(
        one.replace(links=(one.links[0],) * 2, base_quaternion=(1.0, 0.0, 0.0, 0.0), tip_mass=0.05)
    )


def learned(learner, deviation, covariance, start):
    """Force (n_q,) in its units that is learned from an arm at rest in `start`, estimated beside it."""
    arm, state, zero = learner.arm, learner.initial_state(), np.zeros(learner.arm.n_q)
    force = arm.gravity_force(start) + arm.elastic_force(start)
    pressure = np.linalg.lstsq(arm.actuation_matrix(zero), force, rcond=None)[0]
    q = start + deviation
    samples = {name: zero for name in ("qdd",) if name in LearnerSample.__dataclass_fields__}
    sample = LearnerSample(
        q=q, qd=zero, pressure_pa=pressure, creep=np.zeros(arm.n_internal), covariance=covariance, **samples
    )
    for _ in range(400):
        state = learner.step(state, sample, DT)
    return learner.force.force(state.learned, q, zero, zero) / learner.force.scales.force


def test_the_slope_holds_the_weight_of_the_arm(hanging):
    learner = Learner(hanging, LearnerConfig())
    scales = learner.force.scales
    beyond = learner.slope - np.diag(scales.stiffness)
    weight = np.array(
        [hanging.gravity_force(x) - hanging.gravity_force(-x) for x in 1e-4 * np.diag(scales.q)]
    )
    wanted = weight.T / (2e-4 * scales.force[:, None] * scales.q)
    np.testing.assert_allclose(beyond, wanted, atol=1e-4 * np.abs(learner.slope).max())
    bend = np.arange(hanging.n_q) % 3 > 0
    assert np.abs(wanted[np.ix_(bend, bend)]).max() > 0.5 * scales.stiffness[bend].max()


def test_what_the_covariance_names_is_hardly_learned(hanging):
    learner = Learner(hanging, LearnerConfig())
    start = equilibrium(hanging, np.zeros(hanging.n_u))
    rng = np.random.default_rng(1)
    direction = np.where(np.arange(hanging.n_q) % 3 == 0, 0.0, rng.normal(size=hanging.n_q))
    deviation = 0.02 * learner.force.scales.q * direction / np.linalg.norm(direction)
    sure = learned(learner, deviation, np.zeros((hanging.n_q, hanging.n_q)), start)
    unsure = learned(learner, deviation, 1e3 * np.outer(deviation, deviation), start)
    assert np.linalg.norm(unsure) < 0.05 * np.linalg.norm(sure)
