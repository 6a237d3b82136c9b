"""The file of a study: which keys of a scene and of its robot vary, and how; the values of each run."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from soro_core.config import Strict
from soro_core.errors import ConfigError
from soro_core.files.units import as_number, unit_of
from soro_core.robot import Robot

MOST_RUNS = 1_000_000
_Pair = Annotated[tuple[float, float] | None, Field(strict=False)]
_Values = Annotated[tuple[Any, ...] | None, Field(strict=False, min_length=1)]
_STEP = re.compile(r"\.?([A-Za-z_]\w*)|\[(\d+)\]")


class Variation(Strict):
    """How one key varies: one of these, of `scale` as factors."""

    uniform: _Pair = Field(None, description="evenly between two numbers")
    normal: _Pair = Field(None, description="mean and standard deviation")
    lognormal: _Pair = Field(None, description="median, and standard deviation of the logarithm")
    integers: Annotated[tuple[int, int] | None, Field(strict=False)] = Field(
        None, description="whole numbers from the first to the last"
    )
    choice: _Values = Field(None, description="one of these values, each as likely")
    grid: _Values = Field(None, description="each of these values, with each combination of other grids")
    scale: Variation | None = Field(
        None, description="the value that is there, times one of the above, or between two numbers"
    )

    @model_validator(mode="before")
    @classmethod
    def _scale_between(cls, value: Any) -> Any:
        if isinstance(value, Mapping) and isinstance(between := value.get("scale"), list | tuple):
            return {**value, "scale": {"uniform": between}}
        return value

    @model_validator(mode="after")
    def _one(self) -> Variation:
        given = [(name, value) for name, value in self if value is not None]
        if len(given) != 1:
            raise ValueError("one of " + ", ".join(type(self).model_fields) + ", with its values")
        ((name, value),) = given
        if name in ("uniform", "integers") and value[0] > value[1]:
            raise ValueError(f"{name}: the lower end first")
        if name in ("normal", "lognormal") and (value[1] < 0.0 or (name == "lognormal" and value[0] <= 0.0)):
            raise ValueError(f"{name}: a standard deviation of 0 or more, and a median above 0")
        if name == "scale" and not all(is_number(factor) for factor in value.listed):
            raise ValueError("scale: two numbers, or uniform, normal, lognormal, choice or grid of numbers")
        return self

    @property
    def listed(self) -> tuple[Any, ...]:
        """Values that are listed, or that bound and centre what is drawn."""
        if self.scale is not None:
            return self.scale.listed
        middle = self.normal or self.lognormal
        return middle[:1] if middle else self.uniform or self.integers or self.choice or self.grid or ()

    @property
    def centre(self) -> Any:
        """The middle of what is drawn evenly, else the first value of `listed`."""
        one = self.scale or self
        return sum(one.uniform) / 2 if one.uniform is not None else self.listed[0]

    @property
    def on_grid(self) -> tuple[Any, ...]:
        """Values of a grid; () of what is drawn."""
        return self.grid or (self.scale.on_grid if self.scale is not None else ())

    def drawn(self, rng: np.random.Generator, count: int) -> list[Any]:
        """Return values that are drawn; the first ones do not depend on the count."""
        if self.scale is not None:
            return self.scale.drawn(rng, count)
        if self.choice is not None:
            return [self.choice[k] for k in rng.integers(len(self.choice), size=count)]
        if self.integers is not None:
            return list(rng.integers(*self.integers, size=count, endpoint=True).tolist())
        if self.uniform is not None:
            low, high = self.uniform
            return list(rng.uniform(low, high, size=count).tolist())
        z, (middle, deviation) = rng.standard_normal(count), self.normal or self.lognormal or (0.0, 0.0)
        values = middle + deviation * z if self.normal else middle * np.exp(deviation * z)
        return list(values.tolist())


class StudyFile(Strict):
    """The keys of FILE: each combination of the grids once for each of `samples` draws of the others."""

    samples: int = Field(1, ge=1, le=MOST_RUNS, description="draws of what is not on a grid")
    seed: int = Field(1, ge=0, description="seed of the draws")
    vary: dict[str, Variation] = Field(
        min_length=1,
        description="keys of the scene; robot.PATH: of its robot, as the controller has it too; plant.PATH: "
        "of the true arm alone",
    )

    @field_validator("vary", mode="before")
    @classmethod
    def _in_units(cls, value: Any) -> Any:
        """Return texts like 10g as numbers in the units of the keys; factors of a scale have none."""
        if not isinstance(value, Mapping):
            return value
        return {key: _as_numbers(one, key) if isinstance(one, Mapping) else one for key, one in value.items()}

    @model_validator(mode="after")
    def _few(self) -> StudyFile:
        if self.runs > MOST_RUNS:
            raise ValueError(f"{MOST_RUNS} runs or fewer, not {self.runs}")
        return self

    @property
    def runs(self) -> int:
        """Number of runs."""
        return self.samples * math.prod(len(one.on_grid) or 1 for one in self.vary.values())

    @cached_property
    def _draws(self) -> dict[str, list[Any]]:
        """Values of each key that is drawn; another key does not change them."""
        return {
            key: one.drawn(np.random.default_rng([self.seed, zlib.crc32(key.encode())]), self.samples)
            for key, one in self.vary.items()
            if not one.on_grid
        }

    def values(self, run: int) -> dict[str, Any]:
        """Return the value of each key in a run, of a scale the factor; grids change first."""
        sample, place = divmod(run, self.runs // self.samples)
        found = {}
        for key, one in self.vary.items():
            if one.on_grid:
                place, at = divmod(place, len(one.on_grid))
            found[key] = one.on_grid[at] if one.on_grid else self._draws[key][sample]
        return found

    def scaled(self, key: str, value: Any, there: Any) -> Any:
        """Return a value of a key, or what is there times the value.

        Parameters
        ----------
        key : str
        value : object
            Of `values`.
        there : object
            What a scale multiplies: a number, or a list of them.
        """
        if self.vary[key].scale is None:
            return value
        numbers = list(there) if isinstance(there, list | tuple) else [there]
        if not all(is_number(one) for one in numbers):
            raise ConfigError("--vary", key, there, "a key with a number, or numbers, to scale")
        found = [one * value for one in numbers]
        return found if isinstance(there, list | tuple) else found[0]


def _as_numbers(ways: Mapping[str, Any], key: str) -> dict[str, Any]:
    names = [name for name, _ in _STEP.findall(str(key)) if name]
    if not names or not (unit := unit_of(names[-1])):
        return dict(ways)
    try:
        found = {way: value if way == "scale" else as_number(value, unit) for way, value in ways.items()}
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from None
    if isinstance(ends := found.get("integers"), list | tuple):
        found["integers"] = [int(x) if isinstance(x, float) and x.is_integer() else x for x in ends]
    return found


def is_number(value: Any) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def robot_value(robot: Robot, path: str) -> Any:
    """Return the value at a path of a robot, as ``links[0].k_b[0]``; None where there is none."""
    value: Any = robot
    for name, number in _STEP.findall(path):
        try:
            value = getattr(value, name) if name else value[int(number)]
        except (AttributeError, IndexError, TypeError):
            return None
    return value
