"""Names and words of the code: a public class name has one meaning, and things have the field's terms."""

import ast
from collections import defaultdict
from pathlib import Path

import pytest

from tests.docs.test_pages import RETIRED

ROOT = Path(__file__).resolve().parents[1]


def trees():
    for path in sorted(ROOT.glob("soro_*/**/*.py")):
        yield path.relative_to(ROOT), ast.parse(path.read_text(encoding="utf-8"))


@pytest.mark.slow
def test_a_public_class_name_stands_once():
    places = defaultdict(list)
    for path, tree in trees():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(str(path))
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_docstrings_and_messages_use_the_terms_of_the_field():
    texts = [
        (path, node.value)
        for path, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    assert len(texts) > 5000
    assert [(str(path), RETIRED.findall(text)) for path, text in texts if RETIRED.search(text)] == []
