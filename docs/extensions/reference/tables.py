"""Tables of Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

# Signs that mean something in a cell.
_ESCAPED = {"|": r"\|", "<": "&lt;", "*": r"\*", "_": r"\_", "\n": " ", "`": ""}


def plain(text: object) -> str:
    """Return a text as a cell that shows it as it is."""
    return "".join(_ESCAPED.get(sign, sign) for sign in str(text))


def code(text: object) -> str:
    """Return a text as a cell in the letters of code; nothing stays nothing."""
    found = str(text).replace("|", r"\|")
    return f"`{found}`" if found else ""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; no rows, no table.

    Parameters
    ----------
    head : sequence of str
        Names of the columns.
    rows : iterable of sequence of str
        Cells.
    """
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([f"| {' | '.join(head)} |", "| --- " * len(head) + "|", *lines, "", ""]) if lines else ""
