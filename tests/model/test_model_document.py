"""docs/model.md says which function computes what: every file and function that it names exists."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def rows():
    text = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
    table = text.split("## Which equation is which function")[1].split("##")[0]
    for line in table.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 3 and ".py`" in cells[1]:
            yield re.findall(r"`([^`]+)`", cells[1]), re.findall(r"`([^`]+)`", cells[2])


def test_every_function_named_is_where_the_document_says():
    found = list(rows())
    assert len(found) > 20
    for files, functions in found:
        sources = "".join((ROOT / "soro_core" / file).read_text(encoding="utf-8") for file in files)
        for function in functions:
            defined = rf"^(def {function}\(|{function} = by_type\()"
            assert re.search(defined, sources, re.MULTILINE), f"{function} in {files}"


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
