"""The way of a new arm, unattended: describe it, excite it, identify it, control it with automatic gains.

The arm itself is a twin. Its numbers are those of the description, changed by factors, and a tracker shows it
in a frame that the description does not state. Each step is the command that a user types.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from soro_core.robot import Robot, load_robot
from soro_core.robot.discretisation import with_basis
from soro_lab.identification.arm.cases.parameters import numbers_of, with_numbers

SORO = (str(Path(sys.executable).with_name("soro")),)
# Of the length of the arm: allowed error of the tip under control.
TIP_PART = 0.01
# Allowed error of a number that the data determine: this part, or so many deviations.
PART, DEVIATIONS = 0.03, 2.0


@dataclass(frozen=True)
class NewArm:
    """An arm that the suite has not seen.

    Attributes
    ----------
    name : str
    described : tuple of str
        Options of `soro new`.
    excited : tuple of str
        Options of `soro excite`.
    seed : int
        Of the factors between the description and the arm.
    identified : tuple of str
        Options of `soro identify`.
    tracked : tuple of str
        Options of `soro run`.
    values : mapping of str to float
        Numbers of the arm itself that are not drawn, by the names of `numbers_of`.
    order : int
        Legendre order of the strains of the arm itself; 0: constant.
    """

    name: str
    described: tuple[str, ...]
    excited: tuple[str, ...]
    seed: int
    identified: tuple[str, ...] = ()
    tracked: tuple[str, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)
    order: int = 0


ARMS = (
    NewArm("one_link", ("--length", "80mm", "--mass", "30g", "--pressure-range", "60kPa"), (), 1),
    NewArm(
        "two_links", ("--links", "2", "--length", "70mm", "--mass", "25g", "--mounting", "hanging"), (), 2
    ),
    NewArm("planar_bellow", ("--planar", "--length", "90mm", "--mass", "40g"), (), 3),
)
_ONE = ARMS[0].described
_CREEP = {f"link0/creep_{kind}": 0.1 for kind in "eb"} | {f"link0/creep_{kind}_tau": 0.5 for kind in "eb"}
# The arm itself has what its description lacks.
MISMATCHED = (
    NewArm("strains_vary", _ONE, (), 1, order=1),
    NewArm("creeps", _ONE, (), 1, values=_CREEP),
    NewArm("weak_chamber", _ONE, (), 1, values={"link0/chamber1/gain": 0.55}),
    NewArm("all_three", _ONE, (), 1, values={**_CREEP, "link0/chamber1/gain": 0.55}, order=1),
)


@dataclass(frozen=True)
class Number:
    """A number that was found: what it is, what it should be, and its deviation in the same unit."""

    name: str
    found: float
    true: float
    deviation: float

    @property
    def is_right(self) -> bool:
        """Whether it is within 3 % or two deviations."""
        return abs(self.found - self.true) <= max(PART * abs(self.true), DEVIATIONS * self.deviation)

    @property
    def is_in_bar(self) -> bool:
        """Whether it is within three deviations."""
        return abs(self.found - self.true) <= 3.0 * self.deviation


@dataclass(frozen=True)
class Outcome:
    """What the whole way gave.

    Attributes
    ----------
    numbers : tuple of Number
        Those that the data determine.
    open : tuple of str
        Those that they do not.
    tip_m : float
        RMS error of the tip under control [m].
    length_m : float
    output : str
        What `soro identify` printed.
    """

    numbers: tuple[Number, ...]
    open: tuple[str, ...]
    tip_m: float
    length_m: float
    output: str

    @property
    def is_right(self) -> bool:
        """Whether every number is right and the tip follows."""
        return all(n.is_right for n in self.numbers) and self.tip_m <= TIP_PART * self.length_m


def walk(arm: NewArm, folder: Path, say: Callable[[str], None], environment: Mapping[str, str]) -> Outcome:
    """Go the whole way.

    Parameters
    ----------
    arm : NewArm
    folder : Path
        Of all files.
    say : callable
        Is told what happens.
    environment : mapping
        Environment variables of the commands.
    """

    def soro(*words: str, ends: Sequence[int] = (0,)) -> str:
        say(f"{arm.name}: soro {words[0]}")
        done = subprocess.run(
            [*SORO, *words], cwd=folder, env=dict(environment), capture_output=True, text=True, check=False
        )
        if done.returncode not in ends:
            raise AssertionError(
                f"soro {' '.join(words)}: exit {done.returncode}\n{done.stdout}{done.stderr}"
            )
        return done.stdout

    soro("new", arm.name, *arm.described, "--out", ".")
    described = load_robot(folder / f"{arm.name}_robot.yaml")
    true = as_it_is(described, arm.seed, arm.values)
    plant = with_basis(true, "legendre", arm.order) if arm.order else true
    text = yaml.safe_dump(plant.model_dump(mode="json", exclude_defaults=True), sort_keys=False)
    (folder / "true.yaml").write_text(text)
    twin = ("--set", "mode=lockstep", "--set", "twin.plant=true.yaml")
    twin += ("--set", "twin.refine=1") if arm.order else ()  # such a link is not divided
    soro("excite", f"{arm.name}_scene.yaml", *twin, *arm.excited)
    bag = next((folder / "runs").iterdir())
    output = soro("identify", f"{arm.name}_robot.yaml", str(bag), "--out", "found.yaml", *arm.identified)
    found = ("--set", "robot=found.yaml", "--folder", "tracked")
    soro("run", f"{arm.name}_scene.yaml", *twin, *found, *arm.tracked)
    summary = json.loads(next((folder / "tracked").glob("*/summary.json")).read_text())
    numbers, open_ = compare(described, true, output)
    return Outcome(numbers, open_, float(summary["tip_error_last_rms_m"]), described.length, output)


def as_it_is(described: Robot, seed: int, known: Mapping[str, float]) -> Robot:
    """Return the arm itself: other stiffness, damping and gains, behind a tracker with a frame of its own."""
    draw = np.random.default_rng(seed)
    spread = {"k_e": 0.3, "k_b": 0.3, "damping_e": 0.4, "damping_b": 0.4, "gain": 0.15, "arm": 0.1}
    values = {}
    for name, number in numbers_of(described).items():
        own = name.split("/", 1)[1]
        size = 0.05 if re.fullmatch(r"chamber\d+/gain", own) else spread.get(own, 0.0)
        if size:
            values[name] = number.value * float(np.exp(draw.uniform(-size, size)))
    values.update(known)
    turn, mount = Rotation.random(random_state=seed), Rotation.random(random_state=seed + 100)
    calibration = {
        "tracker_position": draw.uniform(-1.0, 1.0, 3).tolist(),
        "tracker_quaternion": turn.as_quat().tolist(),
        "bodies": [
            {
                "at": 1.0,
                "offset_m": draw.uniform(-0.004, 0.004, 3).tolist(),
                "quaternion": mount.as_quat().tolist(),
            }
        ],
    }
    return with_numbers(described, values).replace(calibration=calibration, name=f"{described.name}_true")


def compare(described: Robot, true: Robot, output: str) -> tuple[tuple[Number, ...], tuple[str, ...]]:
    """Return the numbers of the robot that `soro identify` printed as determined, and the names of others.

    Where the data determine a ratio or a product better than the two numbers, it is one of them.
    """
    known = {name: number.value for name, number in numbers_of(true).items()} | chamber_gains(described, true)
    # A single branch of creep has either name.
    slow = {name: name.replace("/slow_", "/creep_") for name in known if "/slow_" in name}
    known |= {name: known[other] for name, other in slow.items() if not known[name.removesuffix("_tau")]}
    numbers, open_ = [], []
    for line in output.splitlines():
        row = re.match(r"(link\d\S+)\s+(\S+)\s+(\S+)( %)?\s", line)
        if row is None:
            continue
        name, value, size, percent = row.groups()
        if "not determined" in line:
            open_.append(name)
            continue
        wanted = _of(known, name)
        deviation = float(size) * (0.01 * float(value) if percent else 1.0)
        numbers.append(Number(name, float(value), wanted, deviation))
    return tuple(numbers), tuple(open_)


def _of(known: Mapping[str, float], name: str) -> float:
    """Return a number, or a ratio ``a:b`` or product ``a*b`` of two."""
    if ":" in name:
        first, second = name.split(":")
        return known[first] / known[second]
    return float(np.prod([known[each] for each in name.split("*")]))


def chamber_gains(described: Robot, true: Robot) -> dict[str, float]:
    """Factors of gains and moment arms between the description and the arm, by the names of the numbers."""
    found = {}
    for index, (one, other) in enumerate(zip(described.links, true.links, strict=True)):
        areas = [
            float(b.area_m2) / float(a.area_m2) for a, b in zip(one.chambers, other.chambers, strict=True)
        ]  # type: ignore[arg-type]
        first, last = one.chambers[0], other.chambers[0]
        found[f"link{index}/gain"] = areas[0]
        found[f"link{index}/arm"] = float(last.offset_m) / float(first.offset_m)  # type: ignore[arg-type]
        for j, area in enumerate(areas[1:], start=1):
            found[f"link{index}/chamber{j}/gain"] = area / areas[0]
    return found
