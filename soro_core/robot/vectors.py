"""Tuples of a fixed number of floats, as they stand in files."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

from soro_core.config import Floats


def _count(n: int) -> AfterValidator:
    def check(value: tuple[float, ...]) -> tuple[float, ...]:
        if len(value) != n:
            raise ValueError(f"{n} numbers")
        return value

    return AfterValidator(check)


Vector2 = Annotated[Floats, _count(2)]
Vector3 = Annotated[Floats, _count(3)]
Vector4 = Annotated[Floats, _count(4)]
