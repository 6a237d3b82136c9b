"""References to arrays in linked functions: counted where one is made, and nowhere else; ADR 0099."""

import sys
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from soro_core._linked import linked

pytestmark = pytest.mark.numerics


class Rows(NamedTuple):
    """Two rows."""

    first: np.ndarray
    second: np.ndarray


def product(x, y):
    rows = Rows(x[0], y)
    found = 0.0
    for i in range(x.shape[1]):
        found += rows.first[i] * rows.second[i] + x[1:, i][0]
    return found


def zeros(n):
    return np.zeros(n)


def tail(x):
    return x[1:]


def rows_of(x):
    return Rows(x[0], x[1] + 1.0)


def doubled_sum(x):
    return (2.0 * x).sum()


def picked(x):
    return x[np.array([0, 1])].sum()


MAKING = (zeros, tail, rows_of, doubled_sum, picked)


@pytest.fixture(scope="module")
def compiled():
    """Linked functions by name, and a kernel that calls them all n times."""
    found = {one.__name__: linked(one) for one in (product, *MAKING)}
    product_, zeros_, tail_, rows_, doubled_, picked_ = found.values()

    @numba.njit
    def use_all(x, n):
        total = 0.0
        for _ in range(n):
            rows = rows_(x)
            total += product_(x, rows.second) + zeros_(3)[0] + tail_(x)[0, 0] + rows.first[0]
            total += doubled_(rows.first) + picked_(rows.second)
        return total

    use_all(np.zeros((2, 3)), 1)
    return found, use_all


def test_only_what_makes_an_array_counts_references(compiled):
    functions, _ = compiled
    for name, function in functions.items():
        (made,) = function.overloads.values()
        assert ("NRT_" in str(made.library._final_module)) == (name != "product"), name


def test_every_array_is_given_back_and_the_callers_is_left(compiled):
    _, use_all = compiled
    x = np.arange(6.0).reshape(2, 3)
    was_on = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()
    try:
        before, held = rtsys.get_allocation_stats(), sys.getrefcount(x)
        total = use_all(x, 1000)
        after = rtsys.get_allocation_stats()
    finally:
        if not was_on:
            _nrt_python.memsys_disable_stats()
    assert total == 1000.0 * (product(x, x[1] + 1.0) + 3.0 + 0.0 + 6.0 + 9.0)
    assert after.alloc - before.alloc == after.free - before.free >= 4000
    assert sys.getrefcount(x) == held
