"""Frozen dataclasses with other values: as the standard library has them."""

from dataclasses import dataclass, replace

import pytest

from soro_core.frozen import replaced


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
