"""docs/model.md and the docstrings that cite its equations agree; its pictures and examples are there."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]


def test_every_picture_is_there():
    text = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
    pictures = re.findall(r"\]\((images/[^)]+)\)", text)
    assert len(pictures) == 3
    assert all((ROOT / "docs" / picture).is_file() for picture in pictures)


def test_the_examples_run(capsys):
    text = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
    examples = re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    assert len(examples) == 1
    for example in examples:
        exec(compile(example, "docs/model.md", "exec"), {})
    assert capsys.readouterr().out.startswith("ok ")


def numbered(text):
    """Numbers of the equations."""
    return [int(n) for n in re.findall(r"\\tag\{(\d+)\}", text)]


def sources():
    for path in sorted((ROOT / "soro_core").rglob("*.py")):
        yield path.relative_to(ROOT), path.read_text(encoding="utf-8")


def test_equations_are_numbered_from_one_on():
    found = numbered((ROOT / "docs" / "model.md").read_text(encoding="utf-8"))
    assert len(found) > 30
    assert found == list(range(1, len(found) + 1))


def test_the_equations_that_docstrings_and_the_page_cite_are_there():
    page = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
    known, cited = set(numbered(page)), 0
    for path, text in sources():
        for run in re.findall(r"docs/model\.md((?:,? (?:to |and )?\(\d+\))+)", " ".join(text.split())):
            numbers = {int(n) for n in re.findall(r"\d+", run)}
            cited += len(numbers)
            assert numbers <= known, f"{path} cites {run}"
    assert cited > 30


def test_the_page_leads_from_an_equation_to_what_computes_it():
    """The definition (2) and the rate (10) have no docstring of their own; what computes (55) cites (54)."""
    text = " ".join(" ".join(text for _, text in sources()).split())
    found = set()
    for group in re.findall(r"model\.md[ ,]*((?:,? ?(?:to |and )?\(\d+\))+)", text):
        numbers = [int(n) for n in re.findall(r"\d+", group)]
        found |= set(range(numbers[0], numbers[-1] + 1)) if " to " in group else set(numbers)
    page = numbered((ROOT / "docs" / "model.md").read_text(encoding="utf-8"))
    assert set(page) - found == {2, 10, 55}


def test_docstrings_cite_pages_of_this_repository_only():
    for path, text in sources():
        for page in re.findall(r"[\w/.-]*\w\.md\b", text):
            assert (ROOT / page).is_file(), f"{path} cites {page}"


def test_every_paper_that_is_cited_is_in_the_references_and_the_other_way_round():
    page = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
    body, references = page.split("## References")
    listed = set(re.findall(r"^- \[([^\]]+)\]", references, re.MULTILINE))
    key = r"(?:[A-Z]+\d\d|ISO \d[\d-]*)"
    everything = body + "".join(text for _, text in sources())
    groups = re.findall(rf"\[((?:{key})(?:[,;] (?:{key}|[^\]\[]*?))*)\]", everything)
    cited = {name for group in groups for name in re.findall(key, group)}
    assert cited == listed
