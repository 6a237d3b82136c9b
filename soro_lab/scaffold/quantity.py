"""Numbers with units on a command line, ``80mm``, ``80mm,60mm``, and with where they come from."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from soro_core.errors import ConfigError

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


_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\D.*|)")


@dataclass(frozen=True)
class Quantity:
    """A kind of number with its units.

    Attributes
    ----------
    name : str
        What it is, for errors.
    units : mapping of str to float
        Factor of each unit to the first one, which a number alone is in.
    lowest, highest : float
        Bounds in the first unit. They are wide, but tell a number in another unit from one that is meant.
    example : str
        How it is written.
    """

    name: str
    units: Mapping[str, float]
    lowest: float
    highest: float
    example: str

    @property
    def unit(self) -> str:
        """The unit of a number alone."""
        return next(iter(self.units))

    def read(self, text: str, option: str) -> tuple[float, ...]:
        """Return the numbers of a text, separated by commas, in the first unit.

        A number without a unit has that of the last number of the text.

        Raises
        ------
        ConfigError
            With the option, the text and what is allowed.
        """
        found = [_NUMBER.fullmatch(part.strip()) for part in text.split(",")]
        if None in found:
            raise self._refused(option, text)
        pairs = [(float(match[1]), match[2].strip()) for match in found if match is not None]
        last = pairs[-1][1]
        numbers = []
        for number, own in pairs:
            unit = own or last or self.unit
            if unit not in self.units:
                raise self._refused(option, text)
            # Round-off of the factor away: 80 mm are 0.08 m.
            numbers.append(float(f"{number * self.units[unit]:.12g}"))
        if not all(math.isfinite(x) and self.lowest <= x <= self.highest for x in numbers):
            raise self._refused(option, text)
        return tuple(numbers)

    def _refused(self, option: str, text: str) -> ConfigError:
        units = ", ".join(self.units) or "no unit"
        low, high = (f"{x:g} {self.unit}".strip() for x in (self.lowest, self.highest))
        allowed = (
            f"{self.name} from {low} to {high}, like {self.example} (units: {units}; alone: {self.unit})"
        )
        return ConfigError("soro new", option, text, allowed)


LENGTH = Quantity("a length", {"m": 1.0, "mm": 1e-3, "cm": 1e-2}, 1e-3, 10.0, "80mm")
MASS = Quantity("a mass", {"kg": 1.0, "g": 1e-3}, 1e-5, 100.0, "30g")
PRESSURE = Quantity(
    "gauge pressures",
    {"Pa": 1.0, "kPa": 1e3, "bar": 1e5, "mbar": 1e2, "psi": 6894.757},
    -101e3,
    9e5,
    "0,90kPa",
)
AXIAL = Quantity("a stiffness", {"N/m": 1.0, "N/mm": 1e3}, 1e-2, 1e8, "500")
BENDING = Quantity("a stiffness", {"Nm/rad": 1.0, "Nmm/rad": 1e-3}, 1e-7, 1e5, "5Nmm/rad")
COUNT = Quantity("numbers", {"": 1.0}, 0.0, 12.0, "3")
