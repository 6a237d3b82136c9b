"""Searches whose derivatives are taken once: few candidates, nearly the same place."""

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from soro_core.arrays import Array
from soro_core.jobs import Executor, Here, Threads
from soro_lab.identification.candidates import slopes
from soro_lab.identification.search import Search, SearchResult, SearchSettings, secant

T = np.linspace(0.0, 2.0, 40)
TRUE, START = np.array([1.5, 0.7, 0.3]), np.array([1.0, 1.0, 0.0])


def _searched(is_secant: bool, most: int) -> tuple[SearchResult, int]:
    """Where the search for an amplitude, a rate and an offset ends, and how many candidates it tried."""
    tried: list[Array] = []
    settings = SearchSettings(most=most, secant=is_secant, loss="linear")
    return _search(settings, tried), len(tried)


def _search(settings: SearchSettings, tried: list[Array]) -> SearchResult:
    def residuals(x: Array) -> Array:
        tried.append(x.copy())
        return _residuals(x)

    bounds = np.full(3, -5.0), np.full(3, 5.0)
    return Search(residuals, START, _residuals(START), bounds, settings).run()


def _residuals(x: Array) -> Array:
    return np.asarray(x[0] * np.exp(-x[1] * T) + x[2] - TRUE[0] * np.exp(-TRUE[1] * T) - TRUE[2])


def test_a_correction_explains_the_last_step_and_nothing_else() -> None:
    """The corrected derivatives give what the residuals did, and are the old ones across the step."""
    draw = np.random.default_rng(1)
    matrix, before, x = draw.normal(size=(5, 3)), draw.normal(size=3), draw.normal(size=3)
    there, here = draw.normal(size=5), draw.normal(size=5)
    found = secant((before, there, matrix), x, here)
    np.testing.assert_allclose(found @ (x - before), here - there, atol=1e-12)
    across = np.cross(x - before, draw.normal(size=3))
    np.testing.assert_allclose(found @ across, matrix @ across, atol=1e-12)


def test_a_few_steps_with_derivatives_of_the_start_cost_one_candidate_each() -> None:
    """Derivatives anew cost three candidates more a step; both ways take away nearly all of the cost."""
    (anew, many), (once, few) = (_searched(way, 6) for way in (False, True))
    assert few <= 3 + 7 < many
    assert anew.cost < 1e-6
    assert once.cost < 1e-4


def test_no_candidate_is_tried_twice() -> None:
    """Where a search ends it has taken derivatives already."""
    tried: list[Array] = []
    found = _search(SearchSettings(loss="linear"), tried)
    np.testing.assert_allclose(found.x, TRUE, atol=1e-5)
    assert len(tried) == len({x.tobytes() for x in tried})


@pytest.mark.parametrize("executor", [Here, Threads])
def test_the_progress_of_a_search_counts_every_derivative(executor: type[Executor]) -> None:
    """With many parameters one step asks for so many simulations that its derivatives take minutes."""
    count, told = 12, list[float]()
    matrix = np.vander(np.linspace(0.1, 1.0, 3 * count), count)

    def residuals(x: Array) -> Array:
        return np.asarray(matrix @ x - 1.0)

    x0, bounds = np.zeros(count), (np.full(count, -1e3), np.full(count, 1e3))
    with executor() as used:
        settings = SearchSettings(most=1, executor=used)
        Search(residuals, x0, residuals(x0), bounds, settings, told.append).run()
    assert len(told) >= count


@pytest.mark.parametrize("executor", [Here, partial(Threads, 2)])
def test_ctrl_c_among_derivatives_ends_them(executor: Callable[[], Executor]) -> None:
    count, asked = 40, list[int]()

    def residuals(x: Array) -> Array:
        asked.append(1)
        time.sleep(0.01)  # so long that others wait for a thread
        return x - 1.0

    def interrupted() -> None:
        raise KeyboardInterrupt

    x0, bounds = np.zeros(count), (np.full(count, -1e3), np.full(count, 1e3))
    with executor() as used, pytest.raises(KeyboardInterrupt):
        slopes(residuals, x0, -np.ones(count), 1e-4, bounds, used, interrupted)
    assert len(asked) < count // 2
