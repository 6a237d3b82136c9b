"""Findings of a check of the hardware, one line each, with advice."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Literal, NamedTuple, TypeAlias

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
    findings : iterable of Finding
    close : callable
        Called at the end.
    """
    try:
        yield from findings
    except HardwareError as error:
        yield Finding(name, "fail", str(error), advice)
    finally:
        close()
