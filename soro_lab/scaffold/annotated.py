"""A value with the comment that it gets in a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

# Of numbers that no estimate gives.
GUESS = "guess: soro identify finds it"


@dataclass(frozen=True)
class Noted:
    """A value and where it comes from.

    Attributes
    ----------
    value : object
        Number, text, or a tuple of them.
    note : str
        Unit and origin, for the comment.
    """

    value: Any
    note: str


def given(value: Any, unit: str = "") -> Noted:
    """Return a value that the user has given."""
    return Noted(value, f"{unit}, given" if unit else "given")


def rounded(value: float, digits: int = 4) -> float:
    """Return an estimate with as many significant digits as it deserves."""
    return float(f"{value:.{digits}g}")
