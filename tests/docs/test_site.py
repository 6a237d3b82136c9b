"""The pages that are written from the code; `make docs` builds them, and there a warning is an error."""

import sys
from dataclasses import dataclass
from typing import Literal, NamedTuple

import pytest
from pydantic import Field

from soro_core.config import Strict
from tests.docs.test_pages import ROOT


@pytest.fixture(autouse=True)
def extensions(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "extensions"))
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] in ("reference", "four_parts")]:
        del sys.modules[name]


class Round(Strict):
    """A round valve."""

    kind: Literal["round"]
    radius_m: float = Field(ge=0.1, lt=2, description="of the seat")


class Square(Strict):
    """A square valve."""

    kind: Literal["square"]


class Box(Strict):
    """A box of valves."""

    valves: tuple[Round | Square, ...] = ()
    force: float = Field(0.5, description="of the lid [N]")


def test_keys_have_defaults_units_and_ranges():
    from reference.keys import sections

    text = sections(Box, "", 2, [])
    assert "| `force` | `0.5` | N | number | of the lid [N] |" in text
    assert "## valves[] (kind: round)\n\nA round valve." in text
    assert "| `radius_m` | **required** | m | at least 0.1, below 2 | of the seat |" in text
    assert "## valves[] (kind: square)" in text


def test_every_command_has_its_section():
    from reference.commands import pages

    (_, _, text) = pages()["commands"]
    assert "## soro hil first-pressure\n" in text
    assert "| `--set KEY=VALUE` | Change a key of the scene" in text


def test_the_sidebar_has_the_pages_of_the_index():
    from four_parts import parts

    found = parts(ROOT / "docs" / "README.md", ROOT)
    assert list(found) == ["Tutorials", "How-to", "Reference", "Explanation", "Developers"]
    assert found["Tutorials"][0] == "docs/first_run"
    assert "docs/generated/scene_keys" in found["Reference"]
    assert "examples/model" in found["Explanation"]
    assert "docs/adr/README" in found["Developers"]
    listed = [page for pages in found.values() for page in pages]
    assert {f"docs/{page.stem}" for page in (ROOT / "docs").glob("*.md")} - {"docs/README"} <= set(listed)


def test_every_public_field_has_a_text():
    from reference.api import public
    from reference.fields import undescribed

    classes = [thing for _, things in public() for thing in things.values() if isinstance(thing, type)]
    without = {f"{one.__module__}.{one.__name__}": undescribed(one) for one in classes}
    assert {place: names for place, names in without.items() if names} == {}


class Flow(NamedTuple):
    """Air through a valve.

    Attributes
    ----------
    mass, volume : float
        Rates [kg/s], [m^3/s].
    valve : Box
    """

    mass: float
    volume: float
    valve: Box
    note: str = ""


@dataclass
class Seat:
    """Seat of a valve."""

    radius_m: float
    """Of the hole [m]."""
    hardness: float


def test_a_field_without_a_text_is_found():
    from reference.fields import undescribed

    assert undescribed(Flow) == ["valve", "note"]
    assert undescribed(Seat) == ["hardness"]
    assert undescribed(Box) == ["valves"]


def test_a_model_shows_its_fields_and_links_to_its_keys():
    from reference.fields import is_alias, show
    from reference.keys import sections

    linked = []
    text = sections(Box, "", 2, linked) + sections(Box, "", 2, linked)
    assert linked == [Box, Round, Square]
    assert text.count("(keys-tests.docs.test_site.box)=\n") == 1
    lines = [":ivar mass, volume: Rates [kg/s],", "             [m^3/s].", ":vartype mass, volume: float"]
    show(linked, "class", Box, lines)
    assert [line.strip() for line in lines if line] == [
        ":ivar mass: Rates [kg/s],", "[m^3/s].", ":ivar volume: Rates [kg/s],", "[m^3/s].",
        ":vartype mass: float", ":vartype volume: float",
        ":ivar force: of the lid [N]",
        ".. seealso:: :ref:`The keys in files <keys-tests.docs.test_site.box>`",
    ]  # fmt: skip
    assert is_alias("class", Flow.mass)
    assert not is_alias("class", Flow)
