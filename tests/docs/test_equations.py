"""Equations of the site: typeset by the browser itself as MathML, without a script or a network."""

import os
import re
import subprocess
import sys

import pytest

from tests.docs.test_pages import CODE, ROOT

FENCE = re.compile(r"^```math\n(.*?)^```", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"\$([^$\n]+)\$")
PAGES = sorted(page for page in (ROOT / "docs").glob("*.md") if "```math" in page.read_text(encoding="utf-8"))


def equations(page):
    """Return the blocks and the equations within sentences of a page."""
    text = page.read_text(encoding="utf-8")
    return FENCE.findall(text), INLINE.findall(CODE.sub("", text))


def build(folder, *pages, source=ROOT):
    """Build pages as `make docs` does, without what other extensions draw and generate."""
    names = [str(page.relative_to(source).with_suffix("")) for page in pages]
    settings = {
        "extensions": "myst_parser,equations",
        "include_patterns": ",".join(f"{name}.md" for name in names),
        "root_doc": names[0],
    }
    options = [word for key, value in settings.items() for word in ("-D", f"{key}={value}")]
    command = [sys.executable, "-m", "sphinx", "-q", "-E", "-c", str(ROOT / "docs"), *options]
    done = subprocess.run(
        [*command, "-d", str(folder / "doctrees"), str(source), str(folder / "html")],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "NO_COLOR": "1"},
    )
    return done, [folder / "html" / f"{name}.html" for name in names]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    done, built = build(tmp_path_factory.mktemp("site"), *PAGES)
    assert done.returncode == 0, done.stderr
    return {page: html.read_text(encoding="utf-8") for page, html in zip(PAGES, built, strict=True)}


@pytest.mark.process
def test_every_equation_is_typeset(site):
    assert {"control", "estimation", "model"} <= {page.stem for page in PAGES}
    for page, html in site.items():
        blocks, inline = equations(page)
        typeset = re.findall(r"<math\b[^>]*>", html)
        assert len([one for one in typeset if 'display="block"' in one]) == len(blocks), page.name
        assert len(typeset) == len(blocks) + len(inline), page.name


def test_numbers_of_equations_are_unique_and_shown(site):
    for page, html in site.items():
        numbers = re.findall(r"\\tag\{([^}]*)\}", "".join(equations(page)[0]))
        assert re.findall(r'id="equation-([^"]*)"', html) == numbers
        assert len(numbers) == len(set(numbers)), page.name


def test_no_page_asks_the_network(site):
    for page, html in site.items():
        asked = re.findall(r"<(?:script|link|img)\b[^>]*(?:src|href)=\"((?:https?:)?//[^\"]*)\"", html)
        assert asked == [], page.name


def test_equations_within_sentences_are_also_right_on_a_forge():
    """A forge reads a backslash before a punctuation mark as Markdown, and a bar in a table as a border."""
    wrong = {
        page.name: [one for one in equations(page)[1] if re.search(r"\\[^a-zA-Z]|\|", one)] for page in PAGES
    }
    assert {name: found for name, found in wrong.items() if found} == {}


@pytest.mark.process
def test_an_unknown_command_of_an_equation_ends_the_build(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# A page\n\n```math\n\\unheard x\n```\n")
    done, _ = build(tmp_path, page, source=tmp_path)
    assert done.returncode != 0
    assert "unheard" in done.stderr


def test_an_index_stands_beside_its_letter_also_under_an_accent(site):
    for page, html in site.items():
        assert "<munderover>" not in re.sub(r"<munderover>\s*<mo\b", "", html), page.name
