"""Numbers that a run has learned, kept for the next one: checked, written as YAML, read from there."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Literal

import numpy as np
from pydantic import Field, field_validator

from soro_core.adaptation.chamber_gains import LEAST_GAIN, MOST_GAIN, MOST_SLOPE
from soro_core.arrays import Array
from soro_core.config import Floats, Strict, parse, read_yaml
from soro_core.errors import ConfigError
from soro_core.robot import Robot

FILE = "learned.yaml"
# It changes with the meaning of the numbers: until version 2 the growth of an area was linear in the strain.
_VERSION: Final = 3
_HEAD = (
    "# What was learned of the arm until the end of a run: of each number its value and its deviation.\n"
    "# soro run SCENE --learn-from FILE starts from gains, area slopes, damping and stiffness\n"
    "# (NAME/by NAME); the rest belongs to the load and the motion of that run (docs/control.md, Keep what\n"
    "# was learned).\n"
)


class KeptNumbers(Strict):
    """The learned numbers of one robot, as the law `composite` names them."""

    version: Literal[3] = Field(description="version of this file")
    robot: str = Field(description="name of the robot")
    digest: str = Field(description="digest of the robot file's numbers and of how its links are divided")
    numbers: Mapping[str, Floats] = Field(description="value and deviation of each number, by name")

    @field_validator("numbers")
    @classmethod
    def _possible(cls, numbers: Mapping[str, Floats]) -> Mapping[str, Floats]:
        bounds = {"gain": (LEAST_GAIN, MOST_GAIN), "area_slope": (-MOST_SLOPE, MOST_SLOPE)}
        for name, pair in numbers.items():
            if len(pair) != 2 or pair[1] < 0.0:
                raise ValueError(f"a value and its deviation for {name}, not {list(pair)}")
            low, high = bounds.get(name.rpartition("/")[2], (-math.inf, math.inf))
            if not low <= pair[0] <= high:
                raise ValueError(f"{low:g} to {high:g} for {name}, not {pair[0]:g}")
        return numbers

    def start(self, robot: Robot, names: Sequence[str], lower: Array, upper: Array) -> Array:
        """Return the values (size,) that a learner begins with: those of the arm, and 0 for the others.

        Parameters
        ----------
        robot : Robot
            Robot of the learner, its links divided as in the model.
        names : sequence of str
            Its numbers.
        lower, upper : ndarray (size,)
            Their bounds.

        Raises
        ------
        ConfigError
            If they are of another robot, or a value is out of bounds.
        """
        self.require_robot(robot)
        if odd := sorted(set(names) ^ set(self.numbers)):
            got = "one that is not learned" if odd[0] in self.numbers else "none"
            raise ConfigError("learned", f"numbers.{odd[0]}", got, f"the {len(names)} numbers of this arm")
        values = np.array([self.numbers[name][0] * _is_of_arm(name) for name in names])
        for name, value, low, high in zip(names, values, lower, upper, strict=True):
            rounding = 1e-6 * (high - low)  # a file has fewer digits than a number at its bound
            if not low - rounding <= value <= high + rounding:
                raise ConfigError("learned", f"numbers.{name}", float(value), f"{low:g} to {high:g}")
        return np.asarray(np.clip(values, lower, upper))

    def require_robot(self, robot: Robot, where: str = "learned") -> None:
        """Refuse another robot; links are divided as the learner has them, `where` is the file of numbers.

        Raises
        ------
        ConfigError
            Naming both.
        """
        if self.robot != robot.name:
            raise ConfigError(where, "robot", self.robot, f"what was learned of {robot.name}")
        if self.digest != digest_of(robot):
            allowed = (
                f"{digest_of(robot)}, of {robot.name} and the model as they are now: learn again, or take "
                "the robot file and the model of that run"
            )
            raise ConfigError(where, "digest", self.digest, allowed)

    def to_yaml(self) -> str:
        """Return the text of the file."""
        # JSON is YAML: a name such as 1e3 stays a text.
        name = json.dumps(self.robot, ensure_ascii=False)
        head = f"version: {self.version}\nrobot: {name}\ndigest: {self.digest}\nnumbers:\n"
        numbers = (f"  {name}: [{value:.8g}, {std:.3g}]\n" for name, (value, std) in self.numbers.items())
        return _HEAD + head + "".join(numbers)


def keep(robot: Robot, values: Mapping[str, float], deviations: Mapping[str, float]) -> KeptNumbers:
    """Return learned numbers with their robot, its links divided as in the model of the learner.

    Raises
    ------
    ConfigError
        If a number is not finite, or has no deviation.
    """
    if missing := sorted(set(values) - set(deviations)):
        raise ConfigError("learned", f"numbers.{missing[0]}", "no deviation", "a deviation for each value")
    # As the file has them: a value at its bound may be beyond it by a rounding.
    numbers = {
        name: (float(f"{value:.8g}"), float(f"{deviations[name]:.3g}")) for name, value in values.items()
    }
    return KeptNumbers(version=_VERSION, robot=robot.name, digest=digest_of(robot), numbers=numbers)


def load_kept(path: Path) -> KeptNumbers:
    """Read what a run has kept, from its folder or from the file.

    Raises
    ------
    ConfigError
        If there is none, or the file is not one of this version.
    """
    if path.is_dir() and not kept_file(path).is_file():
        allowed = f"a run that ended good or poor with a law that learns: it has {FILE}"
        raise ConfigError(str(path), "", f"no {FILE}", allowed)
    file = kept_file(path)
    if not file.exists():
        raise ConfigError(str(path), "", "no such file", f"a run folder or its {FILE}")
    data = read_yaml(file)
    if "version" in data and data["version"] != _VERSION:
        allowed = (
            f"{_VERSION}, which this soro reads: numbers of another version mean other things, learn again"
        )
        raise ConfigError(str(file), "version", data["version"], allowed)
    return parse(data, KeptNumbers, where=str(file))


def kept_file(path: Path) -> Path:
    """Return the file in the folder of a run; of a file, itself."""
    return path / FILE if path.is_dir() else path


def digest_of(robot: Robot) -> str:
    """Return a digest of the numbers of a robot, whatever its name and its description.

    Keys at their defaults do not count.
    """
    text = robot.model_dump_json(exclude={"name", "description"}, exclude_defaults=True)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def _is_of_arm(name: str) -> bool:
    """Whether a number is the arm's: not of the load, and not right on the motion of its run alone."""
    of, by, own = name.partition("/by ")
    return of == own if by else name.endswith(("/gain", "/area_slope", "_damping"))
