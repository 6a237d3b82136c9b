"""Slopes come into force where they predict better, and go where they do not."""

import numpy as np
import pytest

from soro_core.adaptation.learning.slope_evidence import NO_EVIDENCE, SlopeEvidence, compared, rivals

# One value that is known, and one slope.
LOWER, UPPER = np.array([-1.0, -10.0]), np.array([1.0, 10.0])
NOISE, EVERY_S = 0.01 * np.eye(1), 0.5


def after(evidence, slope, seconds, noise=NOISE):
    """The evidence after samples that a slope explains."""
    for k in range(round(seconds / EVERY_S)):
        regressor = np.array([[1.0, (-1.0) ** k]])
        residual = regressor @ np.array([0.5, slope])
        adopted, sum_s = compared(evidence, (residual, regressor), noise, EVERY_S)
        evidence = SlopeEvidence(adopted, sum_s, np.array([[0.5, 0.0], [0.5, 1.0]]))
    return evidence


def test_a_slope_that_predicts_better_is_adopted_and_dropped_where_it_does_not():
    assert not after(NO_EVIDENCE, 1.0, 0.5).adopted  # nothing has been predicted yet
    found = after(NO_EVIDENCE, 1.0, 4.0)
    assert found.adopted
    assert after(found, 0.5, 6.0).adopted  # as good is enough to stay
    assert not after(NO_EVIDENCE, 0.5, 6.0).adopted  # but not to come
    assert not after(found, 0.0, 6.0).adopted


def test_a_slope_of_a_residual_within_the_noise_is_not_adopted():
    quiet = NOISE * 1e5
    adopted, sum_s = compared(after(NO_EVIDENCE, 1.0, 0.5), (np.ones(1), np.ones((1, 2))), quiet, EVERY_S)
    assert not adopted
    assert abs(sum_s) < 1e-2


def test_what_has_brought_slopes_does_not_keep_them():
    found = after(NO_EVIDENCE, 1.0, 1.0)
    assert found.adopted
    assert found.sum_s == 0.0
    assert not after(found, 0.0, 0.5).adopted


@pytest.mark.parametrize("adopted", [False, True])
def test_a_residual_that_is_no_number_is_no_evidence(adopted):
    evidence = SlopeEvidence(adopted, 0.0, np.array([[0.5, 0.0], [0.5, 1.0]]))
    found = compared(evidence, (np.array([np.nan]), np.ones((1, 2))), NOISE, EVERY_S)
    assert found == (adopted, 0.0)


def test_what_is_missed_by_two_deviations_speaks_for_a_slope_only_if_it_lasts():
    noise = 0.25 * np.eye(1)
    assert not after(NO_EVIDENCE, 1.0, 2.0, noise).adopted
    assert after(NO_EVIDENCE, 1.0, 4.0, noise).adopted


def test_both_rivals_are_the_best_within_the_bounds():
    information, moment = np.array([[2.0, 1.0], [1.0, 1.0]]), np.array([1.0, 1.2])
    without, beside = rivals(information, moment, 1, (LOWER, UPPER))
    np.testing.assert_allclose(without, [0.5, 0.0])
    np.testing.assert_allclose(information @ beside, moment)
    bounded, _ = rivals(information, 10.0 * moment, 1, (LOWER, UPPER))
    np.testing.assert_allclose(bounded, [1.0, 0.0])


def test_slopes_that_explain_all_stay_where_nothing_is_left_to_explain():
    evidence, sides = after(NO_EVIDENCE, 1.0, 4.0), (np.ones(1), np.ones((1, 2)))
    for _ in range(40):
        evidence = SlopeEvidence(*compared(evidence, sides, 1e5 * NOISE, EVERY_S), evidence.rivals)
    assert abs(evidence.sum_s) < 1e-2
    assert evidence.adopted


def test_a_start_that_speaks_against_slopes_does_not_delay_them():
    against = after(NO_EVIDENCE, -1.0, 4.0)
    assert not against.adopted
    assert after(against, 0.75, 1.0).adopted
