"""20 000 random and damaged pieces a family, in both directions: nothing breaks, bad ones are counted."""

from pathlib import Path

import pytest

from benchmarks.options import Options
from soro_hardware.families import FAMILIES as ALL
from tests.apparatus import fuzz as fuzzing
from tests.apparatus.fuzz import FAMILIES, fuzz
from tests.apparatus.fuzz.pieces import Counted

TARGETS = [
    pytest.param(family, name, id=f"{family}-{name}") for family, names in FAMILIES.items() for name in names
]


@pytest.mark.process
@pytest.mark.parametrize(("family", "name"), TARGETS)
def test_nothing_breaks_and_each_bad_one_is_counted(family, name):
    found = fuzz(family, name, 20_000)
    assert found.missing == 0
    told = found.sent - found.untold
    assert min(found.good, found.bad) >= 0.08 * told


def test_every_family_has_the_whole_number():
    assert set(FAMILIES) == set(ALL)
    for targets in FAMILIES.values():
        assert sum(part for _, part in targets.values()) == pytest.approx(1.0)


def test_the_text_explains_the_columns_of_the_table(monkeypatch):
    monkeypatch.setattr(fuzzing, "FAMILIES", {})
    text, head = fuzzing.run(Options(False, True, Path(), print)).split("\n\n")
    assert "*Untold*" in text
    assert "untold" in head


def test_what_is_not_counted_shows():
    assert Counted(sent=10, good=4, bad=3, untold=1).missing == 2
