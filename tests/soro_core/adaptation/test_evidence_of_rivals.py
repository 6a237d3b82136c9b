"""Slopes, or another stiffness, come into force where they predict better, and go where they do not."""

import numpy as np
import pytest

from soro_core.adaptation.config import LearnerConfig
from soro_core.adaptation.learner import Learner
from soro_core.adaptation.learning.evidence import NO_EVIDENCE, RivalEvidence, compared, rivals
from soro_core.model import SoftArm
from soro_core.robot import load_robot

# One value that is known, and one slope; the other stiffness says nothing of the slope but of the value.
LOWER, UPPER = np.array([-1.0, -10.0]), np.array([1.0, 10.0])
NOISE, EVERY_S = np.eye(1), 0.5
VALUES = np.array([[0.5, 0.0], [0.5, 1.0], [0.7, 0.0]])


def after(evidence, slope, seconds, value=0.5, noise=NOISE):
    """The evidence after samples that a slope, or another value, explains."""
    for k in range(round(seconds / EVERY_S)):
        regressor = np.array([[1.0, (-1.0) ** k]])
        residual = regressor @ np.array([value, slope])
        evidence = RivalEvidence(*compared(evidence, (residual, regressor), noise, EVERY_S), VALUES)
    return evidence


def test_a_slope_that_predicts_better_is_adopted_and_dropped_where_it_does_not():
    assert after(NO_EVIDENCE, 1.0, 0.5).adopted == "file"  # nothing has been predicted yet
    found = after(NO_EVIDENCE, 1.0, 4.0)
    assert found.adopted == "slopes"
    assert after(found, 0.5, 6.0).adopted == "slopes"  # as good is enough to stay
    assert after(NO_EVIDENCE, 0.57, 6.0).adopted == "file"  # but not to come
    assert after(found, 0.0, 6.0).adopted == "file"


def test_another_stiffness_is_adopted_where_that_predicts_better():
    quiet = 0.05 * NOISE
    found = after(NO_EVIDENCE, 0.0, 4.0, 0.7, quiet)
    assert found.adopted == "stiffness"
    assert after(found, 1.0, 4.0, 0.5, quiet).adopted == "slopes"  # each gives way to a better one
    assert after(found, 0.0, 6.0, 0.5, quiet).adopted == "file"


@pytest.mark.parametrize(("stiffness", "adopted"), [(0.95, "stiffness"), (0.6, "slopes")])
def test_slopes_do_not_stand_in_for_another_stiffness(stiffness, adopted):
    """One that predicts nearly as well."""
    found, regressor = NO_EVIDENCE, np.array([[0.0, 1.0]])
    for _ in range(8):
        values = np.array([[0.5, 0.0], [0.5, 1.0], [0.5, stiffness]])
        found = RivalEvidence(*compared(found, (np.ones(1), regressor), NOISE, EVERY_S), values)
    assert found.adopted == adopted


def test_what_is_no_better_than_the_file_does_not_take_the_place_of_what_is_worse():
    bad = RivalEvidence("stiffness", (0.0, 0.4, -0.4), VALUES)
    sides = np.full(1, 0.54), np.array([[0.0, 1.0]])
    assert compared(bad, sides, NOISE, EVERY_S)[0] == "stiffness"


def test_a_slope_of_a_residual_within_the_noise_is_not_adopted():
    sides = np.ones(1), np.ones((1, 2))
    adopted, means = compared(after(NO_EVIDENCE, 1.0, 0.5), sides, 1e3 * NOISE, EVERY_S)
    assert adopted == "file"
    assert np.max(np.abs(means)) < 1e-2


def test_all_rivals_are_the_best_within_the_bounds():
    information, moment = np.array([[2.0, 1.0], [1.0, 1.0]]), np.array([1.0, 1.2])
    each = information, information, 0.8 * information
    without, beside, stiffer = rivals(each, moment, 1, (LOWER, UPPER))
    np.testing.assert_allclose(without, [0.5, 0.0])
    np.testing.assert_allclose(information @ beside, moment)
    np.testing.assert_allclose(stiffer, [0.625, 0.0])
    np.testing.assert_allclose(rivals(each, 10.0 * moment, 1, (LOWER, UPPER))[0], [1.0, 0.0])


def test_slopes_that_explain_all_stay_where_nothing_is_left_to_explain():
    evidence, sides = after(NO_EVIDENCE, 1.0, 4.0), (np.ones(1), np.ones((1, 2)))
    for _ in range(40):
        evidence = RivalEvidence(*compared(evidence, sides, 1e3 * NOISE, EVERY_S), evidence.rivals)
    assert np.max(np.abs(evidence.means)) < 1e-2
    assert evidence.adopted == "slopes"


def test_a_start_that_speaks_against_slopes_does_not_delay_them():
    against = after(NO_EVIDENCE, -1.0, 4.0)
    assert against.adopted == "file"
    assert after(against, 0.75, 1.0).adopted == "slopes"


def test_the_prior_of_another_stiffness_lets_all_strains_be_stiffer_together():
    learner = Learner(SoftArm(load_robot("tue_three_bellow")), LearnerConfig())
    start, together, apart = (np.zeros(learner.size) for _ in range(3))
    together[[2, 7, 12]] = 3.0  # W of an arm that is stiffer by 30 % than its file
    apart[[2, 7, 12]] = 3.0, -3.0, 0.0
    file, stiffness = (learner._prior(start, start, rival) for rival in ("file", "stiffness"))
    assert together @ stiffness @ together < 0.05 * (together @ file @ together)
    assert apart @ stiffness @ apart == pytest.approx(apart @ file @ apart)
