"""Findings as a table on the console; a file of its own, because a board is installed without rich."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from soro_hardware.finding import Finding

_STYLES = {"ok": "green", "warn": "yellow", "fail": "bold red"}


def show(title: str, findings: Sequence[Finding]) -> None:
    """Print a table with a line for each finding, and the number of each level."""
    table = Table(title=Text(title), title_justify="left", show_lines=False)
    for heading in ("", "what", "found", "what to do"):
        table.add_column(heading, overflow="fold")
    for name, level, found, do in findings:
        table.add_row(Text(level, _STYLES[level]), Text(name), Text(found), Text(do))
    console = Console()
    console.print(table)
    counts = {level: sum(f.level == level for f in findings) for level in _STYLES}
    console.print(f"{counts['ok']} good, {counts['warn']} to read, {counts['fail']} failed")


def show_rows(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table of texts.

    Parameters
    ----------
    title : str
    head : sequence of str
        Names of the columns.
    rows : sequence of sequence of str
        Cells.
    """
    table = Table(title=Text(title), title_justify="left")
    for n, heading in enumerate(head):
        # A unit in brackets is no style, and a chamber's name is not broken.
        table.add_column(Text(heading), overflow="fold", no_wrap=n == 0)
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    Console().print(table)
