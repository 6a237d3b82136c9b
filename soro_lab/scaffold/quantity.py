"""Kinds of numbers of a new arm, and numbers with where they come from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from soro_core.files.units import Quantity
from soro_core.robot.link import HEAVIEST, LONGEST

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


# Bounds are wide, but tell a number in another unit from one that is meant.
LENGTH = Quantity("m", 1e-3, LONGEST, "80mm")
MASS = Quantity("kg", 1e-5, HEAVIEST, "30g")
PRESSURE = Quantity("Pa", -101e3, 9e5, "0,90kPa")
AXIAL = Quantity("N/m", 1e-2, 1e8, "500")
BENDING = Quantity("Nm/rad", 1e-7, 1e5, "5Nmm/rad")
COUNT = Quantity("", 0.0, 12.0, "3")
