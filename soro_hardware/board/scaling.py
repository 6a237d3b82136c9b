"""Conversion between voltage and pressure by a table, as in data sheets of analog regulators."""

from __future__ import annotations

from bisect import bisect_right
from functools import cached_property
from itertools import pairwise
from typing import Annotated

from pydantic import Field, field_validator

from soro_core.config import Strict

Point = Annotated[tuple[float, float], Field(strict=False)]
Table = Annotated[tuple[Point, ...], Field(strict=False, min_length=2, max_length=64)]


class Scale(Strict):
    """Scale of one kind of regulator: tables of voltage and pressure, with linear interpolation."""

    output: Table = Field(description="set point: [volts, Pa gauge] ..., volts and pressure strictly rising")
    input: Table = Field(description="reading: [volts, Pa gauge] ..., volts and pressure strictly rising")

    @field_validator("output", "input")
    @classmethod
    def _monotone(cls, table: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for (v0, p0), (v1, p1) in pairwise(table):
            if not (v1 > v0 and p1 > p0):
                raise ValueError("volts and pressures that rise from point to point")
        if table[0][0] < 0.0 or table[-1][0] > 10.0:
            raise ValueError("volts from 0 to 10")
        return table

    @field_validator("output")
    @classmethod
    def _can_vent(cls, table: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        if not table[0][1] <= 0.0 < table[-1][1]:
            raise ValueError("a table that 0 Pa lies in, so that the port can vent")
        return table

    def to_volts(self, pressure_pa: float) -> float:
        """Return the voltage [V] of a set point [Pa gauge], clipped to the table."""
        limited = min(max(pressure_pa, self.output[0][1]), self.output[-1][1])
        return interpolate(self._volts_of_output, limited)

    def asked_pa(self, volts: float) -> float:
        """Return the set point [Pa gauge] of a voltage [V]."""
        return interpolate(self.output, volts)

    def read_pa(self, volts: float) -> float:
        """Return the pressure [Pa gauge] of a sensor voltage [V], extrapolated beyond the table."""
        return interpolate(self.input, volts)

    def sensor_volts(self, pressure_pa: float) -> float:
        """Return the sensor voltage [V] of a pressure [Pa gauge], for emulated boards."""
        return interpolate(self._volts_of_input, pressure_pa)

    @cached_property
    def _volts_of_output(self) -> list[tuple[float, float]]:
        return [(p, v) for v, p in self.output]

    @cached_property
    def _volts_of_input(self) -> list[tuple[float, float]]:
        return [(p, v) for v, p in self.input]


def interpolate(table: list[tuple[float, float]] | tuple[tuple[float, float], ...], x: float) -> float:
    """Return the value of a piecewise linear function, extrapolated beyond its ends."""
    i = min(max(bisect_right(table, x, key=lambda point: point[0]), 1), len(table) - 1)
    (x0, y0), (x1, y1) = table[i - 1], table[i]
    return y0 + (y1 - y0) * (x - x0) / (x1 - x0)
