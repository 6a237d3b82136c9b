"""The coefficients that the kernel of the implicit steppers reads are those that their files name."""

import numpy as np
import pytest

from soro_core.integrate.steppers import midpoint, tr_bdf2, trapezoidal
from soro_core.integrate.steppers.scheme import Stage, scheme, stage_of

by_name = getattr(stage_of, "py_func", stage_of)  # the function itself where the JIT is off


def test_the_kernel_reads_each_coefficient_by_its_name():
    given = Stage(*np.arange(1.0, 11.0))
    assert by_name(scheme(given).stages, 0) == given


def test_the_rule_for_steps_that_are_not_resolved_follows_the_method():
    method = trapezoidal.TRAPEZOIDAL
    rows = [by_name(method.stages, k) for k in range(len(method.stages))]
    assert method.own == 1
    assert tuple(rows) == (trapezoidal.STAGE, *tr_bdf2.STAGES)


@pytest.mark.parametrize("stages", [[trapezoidal.STAGE], [midpoint.STAGE], tr_bdf2.STAGES])
def test_a_constant_acceleration_is_integrated_exactly(stages):
    """q = 1 + 2 t + 3 t^2: every stage lies on it, where the stages before do."""
    h, a = 0.3, 6.0

    def q(t):
        return 1.0 + 2.0 * t + 3.0 * t * t, 2.0 + 6.0 * t

    (q0, v0), v_before = q(0.0), q(0.0)[1]
    for c in stages:
        got = q0 + h * (c.q_v0 * v0 + c.q_v * v_before) + h * h * a * (c.q_a0 + c.q_a + c.c_q)
        v = v0 + h * a * (c.v_a0 + c.v_a + c.c_v)
        want_q, want_v = q(c.place * h)
        assert v == pytest.approx(want_v, rel=1e-14)
        if c is not midpoint.STAGE:  # that rule lets q in the middle lie on the chord
            assert got == pytest.approx(want_q, rel=1e-14)
        v_before = v
