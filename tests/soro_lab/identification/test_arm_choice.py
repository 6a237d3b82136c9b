"""Laws chosen by what was held out, and how sure numbers are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from soro_lab.identification.arm.cases.parameters import ArmParameter
from soro_lab.identification.arm.choose import Trial, choose
from soro_lab.identification.arm.laws import LAWS, LawTerm
from soro_lab.identification.arm.search.solve import FitSolution
from soro_lab.identification.arm.search.uncertainty import certainty
from soro_lab.identification.arm.stages import IdentificationOptions

SLOPE, CREEP = (law for law in LAWS if law.name in ("area slope", "creep"))


def _fit(errors: Mapping[frozenset[str], tuple[float, ...]]):
    def fit(laws: tuple[LawTerm, ...], start: Mapping[str, float], in_full: bool) -> Trial | None:
        squares = errors.get(frozenset(law.name for law in laws))
        return None if squares is None else Trial(laws, squares, {})

    return fit


def test_laws_are_added_while_held_out_stretches_gain() -> None:
    found = choose(
        LAWS,
        _fit(
            {
                frozenset(): (9.0, 9.0, 9.0),
                frozenset({"creep"}): (8.0, 8.0, 8.0),
                frozenset({"area slope"}): (4.0, 4.1, 3.9),
                frozenset({"area slope", "creep"}): (1.0, 1.1, 0.9),
                frozenset({"area slope", "hyper-elastic"}): (3.9, 4.1, 3.9),
            }
        ),
    )
    assert {law.name for law in found.chosen.laws} == {"area slope", "creep"}
    assert len(found.tried) == 5


def test_the_simplest_within_one_standard_error_is_taken() -> None:
    # Creep helps in one stretch and harms in two: no more than chance.
    uneven = {
        frozenset(): (9.0, 9.0, 9.0),
        frozenset({"area slope"}): (4.0, 4.0, 4.0),
        frozenset({"area slope", "creep"}): (1.0, 5.0, 5.0),
    }
    assert choose(LAWS, _fit(uneven)).chosen.name == "area slope"
    even = uneven | {frozenset({"area slope", "creep"}): (3.6, 3.7, 3.7)}
    assert choose(LAWS, _fit(even)).chosen.name == "area slope + creep"


def test_a_law_that_takes_little_away_is_not_added() -> None:
    # In each stretch the same 2 % of the error: more than any standard error, and no use.
    little = {
        frozenset(): (1.0, 1.1, 0.9),
        frozenset({"creep"}): (0.96, 1.056, 0.864),
        frozenset({"creep", "area slope"}): (0.1, 0.1, 0.1),
    }
    found = choose(LAWS, _fit(little))
    assert found.chosen.laws == ()
    assert [trial.name for trial in found.tried] == ["linear", "creep"]


def test_ctrl_c_ends_the_choice_with_the_best_until_there() -> None:
    calls: list[str] = []

    def fit(laws: tuple[LawTerm, ...], start: Mapping[str, float], in_full: bool) -> Trial:
        calls.append("+".join(law.name for law in laws))
        size = 9.0 if not laws else 4.0
        return Trial(laws, (size, size), {}, interrupted=len(calls) == 3)

    found = choose(LAWS, fit)
    assert len(calls) == 3
    assert any(trial.interrupted for trial in found.tried)
    assert found.chosen.laws == ()


@dataclass(frozen=True)
class _Shape:
    name: str
    t: np.ndarray


@dataclass(frozen=True)
class _Case:
    name: str
    shapes: tuple[_Shape, ...]
    block_s: float = 1.0


@dataclass(frozen=True)
class _Straight:
    """A line through data: two numbers, of which certainty needs what a problem has."""

    numbers: tuple[ArmParameter, ...]
    cases: tuple[_Case, ...]
    expected: dict[str, np.ndarray]

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(len(self.numbers), -1e3), np.full(len(self.numbers), 1e3)


def _straight(rows: np.ndarray, design: np.ndarray, t: np.ndarray) -> tuple[Any, FitSolution]:
    numbers = tuple(
        ArmParameter(f"link0/n{k}", 0.0, "", "shift", 1.0, -1e3, 1e3) for k in range(design.shape[1])
    )
    x, *_ = np.linalg.lstsq(design, rows, rcond=None)
    left = design @ x - rows
    case = _Case("line", (_Shape("y", t),))
    solution = FitSolution(
        {n.name: float(v) for n, v in zip(numbers, x, strict=True)}, x, left, design, 0.0, True
    )
    return _Straight(numbers, (case,), {"y": np.ones(1)}), solution


def test_errors_that_last_make_numbers_less_sure() -> None:
    # 200 draws of a constant under noise that is one value for a whole second: the true deviation of the mean
    # of 20 s is 0.3 / sqrt(20); 50 samples a second are no 1000 witnesses.
    draw = np.random.default_rng(3)
    t = np.arange(0.0, 20.0, 0.02)
    found, said = [], []
    for _ in range(200):
        rows = 0.3 * np.repeat(draw.normal(size=20), 50)
        problem, solution = _straight(rows, np.ones((len(t), 1)), t)
        found.append(solution.x[0])
        said.append(certainty(problem, solution).deviations["link0/n0"])
    assert np.std(found) / 1.3 < np.mean(said) < 1.3 * np.std(found)


def test_a_combination_that_stays_open_is_named() -> None:
    # Only the sum of two numbers is seen: their difference stays as doubtful as it was.
    t = np.arange(0.0, 20.0, 0.02)
    design = np.ones((len(t), 2))
    rows = np.random.default_rng(1).normal(0.0, 0.1, len(t))
    problem, solution = _straight(rows, design, t)
    sure = certainty(problem, solution)
    assert set(sure.undetermined) == {"link0/n0", "link0/n1"}
    assert {c.replace("+", "").replace("-", "") for cs in sure.undetermined.values() for c in cs} == {
        "link0/n0 link0/n1"
    }
    signs = next(iter(sure.undetermined.values()))[0]
    assert {signs.split()[0][0], signs.split()[1][0]} == {"+", "-"}
    assert sure.correlation[0, 1] < -0.9


def test_default_options_try_all_laws() -> None:
    assert IdentificationOptions().laws == LAWS
