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


def _unit(value: tuple[float, ...]) -> tuple[float, ...]:
    if abs(math.hypot(*value) - 1.0) > 1e-6:
        raise ValueError(f"a unit quaternion (norm 1, here {math.hypot(*value):.6g})")
    return value


Vector2 = Annotated[Floats, _count(2)]
Vector3 = Annotated[Floats, _count(3)]
# x, y, z, w
Quaternion = Annotated[Floats, _count(4), AfterValidator(_unit)]
