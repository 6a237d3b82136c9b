"""A page shows what a report has as it is, whatever characters names have."""

import json
from html.parser import HTMLParser

import pytest

from soro_lab.reporting.drawing import Image
from soro_lab.reporting.html import (
    Bullets,
    Cell,
    Chapter,
    Folded,
    Heading,
    Page,
    Picture,
    Table,
    Words,
    number,
    write,
)

# What a user may call an arm, a run, a file.
NAME = """a <b>&amp; 'x' "y" </td>{{ 7 * 7 }}"""
SVG, PNG = Image(b"<svg/>", "svg"), Image(b"\x89PNG", "png")


class Parsed(HTMLParser):
    """Texts by the element that they stand in, all attributes, elements that are not closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.texts, self.attributes, self.tags = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.attributes += attributes
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if data.strip():
            self.texts.append((self.open[-1], data))

    def of(self, tag):
        return [text for where, text in self.texts if where == tag]


def page(*blocks, **keys):
    given = {"title": "t", "source": "s", "verdict": "good", "is_good": True, "notes": []}
    return Page(**{**given, **keys}, chapters=[Chapter("one", "One", blocks)])


def test_every_text_is_shown_as_it_is():
    blocks = [
        *(Heading(NAME), Words(NAME), Bullets([NAME]), Folded(NAME)),
        Table([NAME, f"#{NAME}"], [[NAME, Cell(NAME, NAME), Cell(NAME, is_bad=True)]]),
        Picture(SVG, NAME, NAME),
    ]
    found = Parsed(page(*blocks, title=NAME, source=NAME, verdict=NAME, notes=[Words(NAME)]).html)
    assert not found.open
    for tag, count in (
        ("title", 1),
        ("h1", 1),
        ("h3", 1),
        ("li", 1),
        ("pre", 1),
        ("th", 2),
        ("figcaption", 1),
    ):
        assert found.of(tag) == [NAME] * count, tag
    assert found.of("p") == [NAME] * 3
    assert (found.of("td"), found.of("span")) == ([NAME, NAME], [NAME])
    assert found.of("div") == ["A" + NAME[1:]]
    assert "b" not in found.tags
    assert {key for key, value in found.attributes if value == NAME} == {"data-path", "alt"}


def test_a_number_has_its_place_and_what_is_unknown_is_a_dash():
    cells = [number(0.0123, "a.b", 1e3), number(None, "a.c"), Cell("7", is_number=True), "word"]
    found = Parsed(page(Table(["#mm", "mm", "n", "word"], [cells])).html)
    assert found.of("td") == ["12.3", "–", "7", "word"]
    assert ("data-path", "a.b") in found.attributes
    assert ("data-factor", "1000.0") in found.attributes
    assert found.attributes.count(("class", "n")) == 3


@pytest.mark.parametrize("good", [True, False])
def test_the_verdict_has_its_colour_and_chapters_their_links(good):
    found = Parsed(page(Words("warn", "warn"), is_good=good).html)
    assert (("class", "verdict good") in found.attributes) == good
    assert {("href", "#one"), ("id", "one"), ("class", "warn")} <= set(found.attributes)
    assert found.of("a") == found.of("h2") == ["One"]


def test_a_page_is_written_with_its_numbers_and_its_pictures(tmp_path):
    shown = page(Picture(SVG, "Tip of run <1>"), Words("between"), Picture(PNG, "What is left over"))
    file = write(shown, {"a": 1.5}, tmp_path / "new" / "report")
    found = Parsed(file.read_text(encoding="utf-8"))
    addresses = [value for key, value in found.attributes if key == "src"]
    assert addresses == ["data:image/svg+xml;base64,PHN2Zy8+", "data:image/png;base64,iVBORw=="]
    assert json.loads((file.parent / "report.json").read_text()) == {"a": 1.5}
    pictures = {path.name: path.read_bytes() for path in (file.parent / "pictures").iterdir()}
    assert pictures == {"tip_of_run_1.svg": SVG.data, "what_is_left_over.png": PNG.data}
