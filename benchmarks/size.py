"""How large soro is: ``python -m benchmarks.size`` counts files, lines and code lines of each package.

Code lines are those that hold a token of Python that is no comment and no docstring.
"""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from benchmarks.report import table

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("soro_core", "soro_hardware", "soro_lab", "soro_design", "soro_ros")
MOST_PARAMETERS = 6
_EMPTY = {tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
_NO_CODE = {tokenize.COMMENT, *_EMPTY}
_HEAD = ["package", "files", "lines", "code lines", "folders", "files of the fullest", "functions above six"]


class Size(NamedTuple):
    """Size of one package; `largest` is the number of Python files of its fullest folder."""

    package: str
    files: int
    lines: int
    code: int
    folders: int
    largest: int
    wide: int


def size_of(package: str, root: Path = ROOT) -> Size:
    """Count one package; templates count as lines, `wide` are functions of more than six parameters."""
    sources = sorted((root / package).rglob("*.py"))
    texts = [path.read_text(encoding="utf-8") for path in sources]
    templates = sum(len(path.read_text("utf-8").splitlines()) for path in (root / package).rglob("*.jinja"))
    folders = [path.parent for path in sources]
    return Size(
        package,
        len(sources),
        sum(len(text.splitlines()) for text in texts) + templates,
        sum(code_lines(text) for text in texts),
        len(set(folders)),
        max(folders.count(folder) for folder in set(folders)),
        sum(is_wide for text in texts for is_wide in _wide(text)),
    )


def code_lines(text: str) -> int:
    """Return the number of lines of a source that hold code."""
    documented: set[int] = set()
    for node in _docstrings(text):
        documented |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    found: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _NO_CODE:
            found |= set(range(token.start[0], token.end[0] + 1))
    return len(found - documented)


def _docstrings(text: str) -> Iterator[ast.Expr]:
    for node in ast.walk(ast.parse(text)):
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and isinstance(body[0], ast.Expr):
            value = body[0].value
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                yield body[0]


def _wide(text: str) -> Iterator[bool]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            given = node.args
            names = [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
            yield len([name for name in names if name not in ("self", "cls")]) > MOST_PARAMETERS


def main() -> None:
    """Print the table."""
    sizes = [size_of(package) for package in PACKAGES]
    total = [sum(column) for column in zip(*(size[1:] for size in sizes), strict=True)]
    total[4] = max(size.largest for size in sizes)
    print(table(_HEAD, [list(row) for row in (*sizes, ("all", *total))]))


if __name__ == "__main__":
    main()
