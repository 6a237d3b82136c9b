"""Frozen dataclasses with other values: as the standard library has them."""

from dataclasses import dataclass, replace
from inspect import signature

import pytest

from soro_core.frozen import quick, replaced


@dataclass(frozen=True)
class Pair:
    first: int
    second: list[int]


def test_it_is_what_replace_gives():
    pair = Pair(1, [2])
    other = replaced(pair, first=3)
    assert other == replace(pair, first=3)
    assert other.second is pair.second
    assert pair == Pair(1, [2])
    with pytest.raises(AttributeError):
        other.first = 4


def test_a_name_that_is_no_field_is_refused():
    with pytest.raises(TypeError, match="Pair has no field third"):
        replaced(Pair(1, []), third=3)


@quick
@dataclass(frozen=True)
class Mark:
    place: float
    own: tuple[str, ...] = ()


def test_a_quick_one_is_made_as_the_standard_library_does():
    mark = Mark(1.0, own=("far",))
    assert mark == replace(Mark(place=1.0), own=("far",))
    assert Mark(2.0).own == ()
    assert str(signature(Mark)) == "(place: float, own: tuple[str, ...] = ()) -> None"
    for wrong in ({}, {"place": 1.0, "third": 2}):
        with pytest.raises(TypeError, match=r"third|place"):
            Mark(**wrong)
    with pytest.raises(AttributeError):
        mark.place = 4
