"""References to arrays in linked functions: counted where one is made, and nowhere else; ADR 0099."""

import sys
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core import caching
from numba.core.runtime import _nrt_python, rtsys

from soro_core import _linked
from soro_core._linked import linked

pytestmark = pytest.mark.numerics


class Rows(NamedTuple):
    """Two rows."""

    first: np.ndarray
    second: np.ndarray


def product(x, y):
    """With branches, in which numba itself does not see that references are even."""
    rows = Rows(x[0], y)
    if x[0, 0] > 1e9:
        return rows.second[0]
    found = 0.0
    for i in range(x.shape[1]):
        if y[i] < -1e9:
            return found
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


def shifted(x):
    room = np.zeros(x.shape[0])
    room[:] = x
    room[1:] = room[:-1]
    return room[0]


def refused(x):
    if x[0] < -1e9:
        raise ValueError("too small", x[0])
    return x[0]


def listed(x):
    rows = [x, x]
    return rows[1][0]


# Of arguments, where they are not one row.
TABLE = numba.float64[:, ::1]
KINDS = {product: (TABLE, numba.float64[::1]), zeros: (numba.int64,), tail: (TABLE,), rows_of: (TABLE,)}
MAKING = (zeros, tail, rows_of, doubled_sum, picked, shifted, refused, listed)


@pytest.fixture(scope="module")
def compiled():
    """Linked functions by name, and a kernel that calls them all n times."""
    found = {one.__name__: linked(one) for one in (product, *MAKING)}
    product_, zeros_, tail_, rows_, doubled_, picked_, shifted_, refused_, listed_ = found.values()

    @numba.njit
    def use_all(x, n):
        total = 0.0
        for _ in range(n):
            rows = rows_(x)
            total += product_(x, rows.second) + zeros_(3)[0] + tail_(x)[0, 0] + rows.first[0]
            total += doubled_(rows.first) + picked_(rows.second)
            total += shifted_(rows.second) + refused_(rows.first) + listed_(rows.second)
        return total

    use_all(np.zeros((2, 3)), 1)
    return found, use_all


def test_what_makes_no_array_counts_no_references(monkeypatch):
    """What it decides: numba removes counts where it sees that they are even, so code does not tell."""
    decide, decided = _linked._makes_array, {}

    def noted(state):
        decided[state.func_id.func_name] = decide(state)
        return decided[state.func_id.func_name]

    monkeypatch.setattr(_linked, "_makes_array", noted)
    for one in (product, *MAKING):
        function = _linked.linked(one)
        function._cache = caching.NullCache()
        function.compile(KINDS.get(one, (numba.float64[::1],)))
    assert decided == {"product": False} | {one.__name__: True for one in MAKING}


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
    assert total == 1000.0 * (product(x, x[1] + 1.0) + 3.0 + 0.0 + 6.0 + 9.0 + 4.0 + 0.0 + 4.0)
    assert after.alloc - before.alloc == after.free - before.free >= 4000
    assert sys.getrefcount(x) == held
