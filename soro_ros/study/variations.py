"""The file of a study: which keys of a scene and of its robot vary, and how; the values of each run."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from soro_core.config import Strict
from soro_core.errors import ConfigError
from soro_core.robot import Robot
from soro_lab.scene import Scene

ROBOT, PLANT = "robot.", "plant."
# Most runs of a study.
MOST_RUNS = 1_000_000
_Pair = Annotated[tuple[float, float] | None, Field(strict=False)]
_Values = Annotated[tuple[Any, ...] | None, Field(strict=False, min_length=1)]
_STEP = re.compile(r"\.?([A-Za-z_]\w*)|\[(\d+)\]")


class Variation(Strict):
    """How one key varies: one of these."""

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
        if len(self.model_fields_set) != 1 or self._given[1] is None:
            raise ValueError("one of " + ", ".join(type(self).model_fields) + ", with its values")
        name, given = self._given
        if name in ("uniform", "integers") and given[0] > given[1]:
            raise ValueError(f"{name}: the lower end first")
        if name in ("normal", "lognormal") and given[1] < 0.0:
            raise ValueError(f"{name}: a standard deviation of 0 or more")
        if name == "lognormal" and given[0] <= 0.0:
            raise ValueError("lognormal: a median above 0")
        if name == "scale" and self.numbers is None:
            raise ValueError(
                "scale: two numbers, or one of uniform, normal, lognormal, choice, grid of numbers"
            )
        return self

    @property
    def _given(self) -> tuple[str, Any]:
        name = next(iter(self.model_fields_set))
        return name, getattr(self, name)

    @property
    def numbers(self) -> Variation | None:
        """The variation of the factor; None where it does not give numbers."""
        inner = self.scale
        if inner is None or inner.scale is not None:
            return None
        listed = (inner.choice or ()) + (inner.grid or ())
        return inner if all(_is_number(value) for value in listed) else None

    @property
    def listed(self) -> tuple[Any, ...]:
        """Values that are listed, or that bound and centre what is drawn."""
        name, given = self._given
        if name == "scale":
            assert self.scale is not None
            return self.scale.listed
        return tuple(given[:1] if name in ("normal", "lognormal") else given)

    @property
    def on_grid(self) -> tuple[Any, ...]:
        """Values of a grid; () of what is drawn."""
        return self.grid or (self.scale.grid if self.scale is not None else None) or ()

    def drawn(self, rng: np.random.Generator, count: int) -> list[Any]:
        """Return values that are drawn, of a scale the factors; the first ones do not depend on the count."""
        if self.scale is not None:
            return self.scale.drawn(rng, count)
        name, given = self._given
        if name == "choice":
            return [given[k] for k in rng.integers(len(given), size=count)]
        first, second = given
        if name == "integers":
            return list(rng.integers(first, second, size=count, endpoint=True).tolist())
        if name == "uniform":
            return list(rng.uniform(first, second, size=count).tolist())
        z = rng.standard_normal(count)
        return list((first + second * z if name == "normal" else first * np.exp(second * z)).tolist())


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


class StudyFile(Strict):
    """The keys of FILE: each combination of the grids once for each of `samples` draws of the others."""

    samples: int = Field(1, ge=1, le=MOST_RUNS, description="draws of what is not on a grid")
    seed: int = Field(1, ge=0, description="seed of the draws")
    vary: dict[str, Variation] = Field(
        min_length=1,
        description="keys of the scene; robot.PATH: of its robot, as the controller has it too; plant.PATH: "
        "of the true arm alone",
    )

    @model_validator(mode="after")
    def _few(self) -> StudyFile:
        if self.runs > MOST_RUNS:
            raise ValueError(f"{MOST_RUNS} runs or fewer, not {self.runs}")
        return self

    @property
    def grids(self) -> dict[str, tuple[Any, ...]]:
        """Values of each key on a grid."""
        return {key: one.on_grid for key, one in self.vary.items() if one.on_grid}

    @property
    def runs(self) -> int:
        """Number of runs."""
        return self.samples * math.prod(len(values) for values in self.grids.values())

    @cached_property
    def _draws(self) -> dict[str, list[Any]]:
        """Values of each key that is drawn; another key does not change them."""
        return {
            key: one.drawn(np.random.default_rng([self.seed, zlib.crc32(key.encode())]), self.samples)
            for key, one in self.vary.items()
            if not one.on_grid
        }

    def values(self, run: int) -> dict[str, Any]:
        """Return the value of each key in a run, of a scale the factor.

        Grids change from run to run, so that each combination meets the same draws.
        """
        sample, place = divmod(run, self.runs // self.samples)
        found = {key: values[sample] for key, values in self._draws.items()}
        for key, values in self.grids.items():
            place, at = divmod(place, len(values))
            found[key] = values[at]
        return {key: found[key] for key in self.vary}

    def scaled(self, key: str, value: Any, base: Callable[[str], Any]) -> Any:
        """Return a value of a key, or that which is there times the value.

        Parameters
        ----------
        key : str
        value : object
            Of `values`.
        base : callable
            Gives what is there, by key.
        """
        if self.vary[key].scale is None:
            return value
        there = base(key)
        many = isinstance(there, list | tuple)
        if not all(_is_number(one) for one in (there if many else [there])):
            raise ConfigError("--vary", key, there, "a key with a number, or numbers, to scale")
        return [one * value for one in there] if many else there * value


def scene_value(scene: Scene, key: str) -> Any:
    """Return the value of a key of a scene."""
    value: Any = scene.to_dict()
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


def robot_value(robot: Robot, path: str) -> Any:
    """Return the value at a path of a robot, as ``links[0].k_b[0]``; None where there is none."""
    value: Any = robot
    for name, number in _STEP.findall(path):
        try:
            value = getattr(value, name) if name else value[int(number)]
        except (AttributeError, IndexError, TypeError):
            return None
    return value
