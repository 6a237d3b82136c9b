"""Tuples of a fixed number of floats, as they stand in files."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator

from soro_core.config import Floats


def _count(n: int) -> AfterValidator:
    def check(value: tuple[float, ...]) -> tuple[float, ...]:
        if len(value) != n:
            raise ValueError(f"{n} numbers")
        return value

    return AfterValidator(check)


# Of the length of a quaternion from 1: one of four decimals, and one of doubles.
_ROUNDED, _EXACT = 1e-3, 1e-12


def _unit(value: tuple[float, ...]) -> tuple[float, ...]:
    length = math.hypot(*value)
    if not abs(length - 1.0) <= _ROUNDED:
        raise ValueError(f"a unit quaternion (norm 1 within {_ROUNDED:g}, here {length:.6g})")
    return value if abs(length - 1.0) <= _EXACT else tuple(number / length for number in value)


Vector2 = Annotated[Floats, _count(2)]
Vector3 = Annotated[Floats, _count(3)]
# x, y, z, w; one of a few decimals becomes one of length 1
Quaternion = Annotated[Floats, _count(4), AfterValidator(_unit)]
