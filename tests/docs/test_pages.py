"""The pages: every link of one has its file and its heading, and the index names every page."""

import re
import subprocess
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE = re.compile(r"^```.*?^```|`[^`\n]*`", re.DOTALL | re.MULTILINE)


def pages() -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", "*.md"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    ).stdout.split("\0")
    found = [ROOT / name for name in listed if name] or sorted(ROOT.glob("**/*.md"))
    return [page for page in found if page.is_file() and ".venv" not in str(page.relative_to(ROOT))]


def anchors(page: Path) -> set[str]:
    """The anchors that GitHub gives the headings of a page."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#{1,6} (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-") for heading in headings}


def broken(page: Path) -> list[str]:
    wrong = []
    for target in LINK.findall(CODE.sub("", page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if not file.exists() or (anchor and file.suffix == ".md" and anchor not in anchors(file)):
            wrong.append(target)
    return wrong


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    assert broken(page) == []


def test_a_link_that_leads_nowhere_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# One\n[a](#one) [b](#two) [c](gone.md) [d](page.md#one) [e](https://x.y/z) `[f](code.md)`\n"
    )
    assert broken(page) == ["#two", "gone.md"]


def test_the_index_names_every_page_once():
    index = ROOT / "docs" / "README.md"
    named = [(index.parent / target).resolve() for target in LINK.findall(index.read_text(encoding="utf-8"))]
    assert len(named) == len(set(named))
    assert set((ROOT / "docs").glob("*.md")) - {index} <= set(named)


ADR = ROOT / "docs" / "adr"
DECISIONS = sorted(ADR.glob("0*.md"))
STATUS = re.compile(r"\A# (\d{4}) (.+)\n\nStatus: ((?:accepted|superseded).*)\. Date: (\d{4}-\d\d-\d\d)\.\n")


@pytest.mark.parametrize("page", DECISIONS, ids=lambda page: page.stem)
def test_a_decision_has_title_status_and_date_as_the_list_of_decisions(page):
    head = STATUS.match(page.read_text(encoding="utf-8"))
    assert head, "# NUMBER TITLE, then: Status: accepted. Date: YEAR-MONTH-DAY."
    number, title, status, date = head.groups()
    assert page.name.startswith(f"{number}-")
    assert title.count(" ") >= 3, "a title states the decision or the fact"
    row = f"| [{number}]({page.name}) | {title} | {status} | {date} |"
    assert row in (ADR / "README.md").read_text(encoding="utf-8").splitlines()


def test_a_superseded_decision_and_its_successor_name_each_other():
    for page in DECISIONS:
        status = STATUS.match(page.read_text(encoding="utf-8"))[3]
        if "superseded" in status:
            (successor,) = LINK.findall(status)
            assert page.name in (ADR / successor).read_text(encoding="utf-8"), f"{successor}: {page.name}"


# Words of our own for what the field has a term for; links keep the names of files.
RETIRED = re.compile(r"\b(?:wished|undriven|unevenly|uneven bend|what acts of)\b", re.IGNORECASE)


@pytest.mark.process
def test_pages_use_the_terms_of_the_field():
    for page in (page for page in pages() if ROOT / "docs" in page.parents):
        text = LINK.sub("", CODE.sub("", page.read_text(encoding="utf-8")))
        assert RETIRED.findall(text) == [], page.name


@pytest.mark.process
def test_pictures_of_the_pages_are_used_and_small():
    used = {
        name
        for page in pages()
        for name in re.findall(r"images/([\w./]+)\)", page.read_text(encoding="utf-8"))
    }
    folder = ROOT / "docs" / "images"
    for picture in (path for path in folder.rglob("*") if path.is_file()):
        assert str(picture.relative_to(folder)) in used
        assert picture.stat().st_size < 1.5e6, picture.name


def test_the_pages_together_stay_short_enough_to_be_read():
    """Who adds words takes as many away."""
    read = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in read) <= 52_000


def test_the_changelog_of_a_release_is_one_screen():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    # The table of moved import paths is for looking up.
    lines = [line for line in text.splitlines() if line and not line.startswith("  |")]
    assert all(len(line) <= 140 for line in lines)
    for release in re.split("^## ", "\n".join(lines), flags=re.MULTILINE):
        assert len(release.splitlines()) < 80, release.partition("\n")[0]


def test_the_citation_can_be_read():
    about = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors", "references"} <= about.keys()
    assert about["cff-version"] == "1.2.0"


def test_the_gallery_shows_every_scene_and_leads_to_its_file():
    text = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    scenes = sorted((ROOT / "config" / "scenes").glob("*.yaml"))
    assert re.findall(r"^## (\w+)$", text, re.MULTILINE) == [scene.stem for scene in scenes]
    for scene in scenes:
        part = text.partition(f"## {scene.stem}\n")[2].partition("\n## ")[0]
        assert f"](../config/scenes/{scene.name})" in part, "make gallery"
        assert scene.read_text(encoding="utf-8").startswith("# "), "its comment says what it shows"
        assert (ROOT / "docs" / "images" / "gallery" / f"{scene.stem}.png").stat().st_size <= 60_000
