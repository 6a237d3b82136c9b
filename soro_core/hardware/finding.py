"""What an examination of hardware finds: one line each, with what to do about it."""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias

Level: TypeAlias = Literal["ok", "warn", "fail"]


class Finding(NamedTuple):
    """One thing that was looked at.

    Attributes
    ----------
    name : str
        What was looked at.
    level : str
        ``ok``, ``warn`` (works, but read it) or ``fail``.
    found : str
        What was found, in one line.
    do : str
        What to do; empty when nothing is.
    """

    name: str
    level: Level
    found: str
    do: str = ""
