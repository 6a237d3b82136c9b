"""Findings of a check of the hardware, one line each, with advice; their table on the console."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Literal, NamedTuple, TypeAlias

from rich.console import Console
from rich.table import Table
from rich.text import Text

from soro_core.errors import HardwareError

Level: TypeAlias = Literal["ok", "warn", "fail"]


class Finding(NamedTuple):
    """Result of one check.

    Attributes
    ----------
    name : str
        Name of the check.
    level : str
        ``ok``, ``warn`` (it works, with a restriction) or ``fail``.
    found : str
        Result in one line.
    do : str
        Advice; empty if there is nothing to do.
    """

    name: str
    level: Level
    found: str
    do: str = ""


def grade(name: str, found: str, *grades: tuple[bool, Level, str]) -> Finding:
    """Return the finding of the first grade that applies, or ``ok``.

    Parameters
    ----------
    name, found : str
        Name and result of the check.
    *grades : tuple of (bool, str, str)
        Whether the grade applies, its level, and its advice.

    Returns
    -------
    Finding
    """
    level, do = next(((level, do) for applies, level, do in grades if applies), ("ok", ""))
    return Finding(name, level, found, do)


def run_check(
    name: str, advice: str, findings: Iterable[Finding], close: Callable[[], None] = lambda: None
) -> Iterator[Finding]:
    """Yield findings, and a failure if a check raises a `HardwareError`.

    Parameters
    ----------
    name, advice : str
        Name and advice of that failure.
    findings : iterable of Finding
        Findings of the checks.
    close : callable
        Called at the end.
    """
    try:
        yield from findings
    except HardwareError as error:
        yield Finding(name, "fail", str(error), advice)
    finally:
        close()


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
        Title.
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
