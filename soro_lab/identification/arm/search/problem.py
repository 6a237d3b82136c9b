"""The search for numbers: residuals of all cases, their derivatives, and what is known before any data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import SoroError
from soro_core.jobs import Executor
from soro_core.model import SoftArm
from soro_core.model.discretised import discretised
from soro_core.robot import Discretisation, Robot
from soro_lab.identification.arm.cases.case import ArmMotion, Case
from soro_lab.identification.arm.cases.parameters import ArmParameter, is_of_robot, with_numbers
from soro_lab.identification.arm.cases.predict import difference, predict_measurement
from soro_lab.identification.search import LOSSES, SearchSettings

# What the arm does where each stream of each case looks (`predict.predict_measurement`).
Shown: TypeAlias = list[list[Array]]


def modelled(robot: Robot, is_constant: bool) -> SoftArm:
    """Return the arm that is simulated.

    A link of constant curvature swings as if it were stiffer by half than one that bends as it likes (first
    bending of a cantilever: 20 against 12.4 E I / m L^3), so what its frequency tells about its stiffness is
    wrong by as much. A linear strain is right to 1 %; where hysteresis forbids it, three pieces serve.
    """
    if is_constant:
        return SoftArm(robot)
    by_pieces = any(link.hysteresis for link in robot.links)
    shape = Discretisation(links=3) if by_pieces else Discretisation(basis="legendre", order=1)
    return discretised(robot, shape)


def seen_in(
    case: Case, robot: Robot, arm: SoftArm, path: ArmMotion, values: Mapping[str, float]
) -> list[Array]:
    """Return what an arm does where each stream of a case looks, at its samples.

    Parameters
    ----------
    case : Case
    robot : Robot
        Whose links the streams count.
    arm : SoftArm
        The robot itself, or pieces of it.
    path : ArmMotion
        Its motion.
    values : mapping of str to float
        Numbers; the clock of the case is used.
    """
    return [
        predict_measurement(shape, robot, arm, q)
        for q, shape in zip(case.coordinates(path, values), case.shapes, strict=True)
    ]


@dataclass(frozen=True)
class Problem:
    """Measured cases, and the numbers that are searched.

    Attributes
    ----------
    robot : Robot
        Holds what is not searched.
    cases : tuple of Case
    numbers : tuple of ArmParameter
        Searched; `value` is the most likely value before any data, `doubt` the deviation from it. Names that
        begin with ``frame/`` belong to the measurement, those with ``run/`` to one run, others to the robot.
    expected : mapping of str to array
        Expected error of each column of a shape's difference, by its name: a row counts less beyond it.
    fixed : mapping of str to float
        Numbers of the robot that are not searched and differ from it.
    is_constant : bool
        Whether strains are simulated as constant along a link.
    executor : Executor or None
        Computes simulations beside each other; None: threads on all cores.
    """

    robot: Robot
    cases: tuple[Case, ...]
    numbers: tuple[ArmParameter, ...]
    expected: Mapping[str, Array]
    fixed: Mapping[str, float] = field(default_factory=dict)
    is_constant: bool = True
    executor: Executor | None = None

    def value(self, x: Array) -> dict[str, float]:
        """Return the numbers at `x` (n,), in deviations of the prior from its middle."""
        return {
            n.name: n.value * float(np.exp(v * n.doubt))
            if n.kind == "factor"
            else n.value + float(v) * n.doubt
            for n, v in zip(self.numbers, x, strict=True)
        }

    def position(self, values: Mapping[str, float]) -> Array:
        """Return `x` of values; the middle of the prior for a number that is not given."""
        return np.array(
            [
                (np.log(values[n.name] / n.value) if n.kind == "factor" else values[n.name] - n.value)
                / n.doubt
                if n.name in values
                else 0.0
                for n in self.numbers
            ]
        )

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Bounds of `x`."""
        low = self.position({n.name: n.lower for n in self.numbers})
        return low, self.position({n.name: n.upper for n in self.numbers})

    def arm(self, values: Mapping[str, float]) -> SoftArm:
        """Return the arm with the robot's share of the numbers."""
        return modelled(self.robot_of(values), self.is_constant)

    def robot_of(self, values: Mapping[str, float]) -> Robot:
        """Return the robot with its share of the numbers, and those that are fixed."""
        own = {name: v for name, v in values.items() if is_of_robot(name)}
        return with_numbers(self.robot, {**self.fixed, **own})

    def predict(self, values: Mapping[str, float]) -> Shown:
        """Return what the arm with given numbers does where each stream of each case looks."""
        arm = self.arm(values)
        return [seen_in(case, self.robot, arm, case.simulated(arm, values), values) for case in self.cases]

    def differences(self, does: Shown, values: Mapping[str, float]) -> list[list[Array]]:
        """Return measured minus predicted of each shape of each case.

        Parameters
        ----------
        does : list of lists of arrays
            Of `predict`.
        values : mapping of str to float
            Numbers of the frames.
        """
        return [
            [difference(shape, each, values) for shape, each in zip(case.shapes, own, strict=True)]
            for case, own in zip(self.cases, does, strict=True)
        ]

    def prediction_errors(self, values: Mapping[str, float]) -> list[list[Array]]:
        """Return measured minus predicted of each shape of each case, for given numbers."""
        return self.differences(self.predict(values), values)

    def rows(self, does: Shown, values: Mapping[str, float]) -> Array:
        """Return all differences in expected errors, one long row; parameters as in `differences`."""
        parts = [
            (d / self.expected[shape.name]).ravel()
            for case, own in zip(self.cases, self.differences(does, values), strict=True)
            for shape, d in zip(case.shapes, own, strict=True)
        ]
        return np.concatenate(parts)

    def cost(self, values: Mapping[str, float]) -> float:
        """Return half the sum of the soft losses and of the squares of the prior; inf where no arm is so."""
        try:
            rows = self.rows(self.predict(values), values)
        except SoroError:
            return np.inf
        x, loss = self.position(values), LOSSES[SearchSettings().loss][0]
        return 0.5 * float(loss(rows**2).sum() + x @ x) if np.isfinite(rows).all() else np.inf
