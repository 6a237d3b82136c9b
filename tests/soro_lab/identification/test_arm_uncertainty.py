"""Deviations that are stated are those that repeated experiments show."""

import numpy as np
import pytest
from scipy.optimize import minimize

from soro_core import load_robot
from soro_lab.identification.arm.cases.parameters import ArmParameter
from soro_lab.identification.arm.search.problem import Problem
from soro_lab.identification.arm.search.solve import FitSolution
from soro_lab.identification.arm.search.uncertainty import certainty
from soro_lab.identification.recording.place import Place
from soro_lab.identification.recording.streams import Marker

SECONDS, RATE = 60, 5
T = np.arange(SECONDS * RATE) / RATE
SLOPES = np.random.default_rng(0).normal(size=(T.size * 3, 2))


class Seen:
    """A case of one marker."""

    name, block_s = "run", 1.0
    shapes = (Marker("tip", T, Place(0), np.zeros((T.size, 3))),)


def problem():
    numbers = tuple(ArmParameter(f"link0/{k}", 0.0, "m", "shift", 1.0, -50.0, 50.0) for k in "ab")
    return Problem(load_robot("tue_three_bellow"), (Seen(),), numbers, {"tip": np.ones(3)})


def found(errors):
    """The solution with residuals that are linear in two numbers, whose true values are 0."""

    def cost(x):
        return np.sum(np.sqrt(1.0 + (errors + SLOPES @ x) ** 2) - 1.0) + 0.5 * x @ x

    x = minimize(cost, np.zeros(2), method="BFGS").x
    return FitSolution({}, x, errors + SLOPES @ x, SLOPES, cost(x), True)


def independent(draw):
    return draw.normal(size=T.size * 3)


def heavy(draw):
    return draw.standard_t(2.0, size=T.size * 3)


def lasting(draw):
    """Errors in the direction of the slopes that last for a second."""
    amplitude = np.repeat(draw.normal(size=SECONDS), RATE * 3)
    return 0.5 * draw.normal(size=T.size * 3) + 0.5 * amplitude * SLOPES[:, 0]


def longer(draw):
    """The same for two seconds, as of a law that is missing."""
    amplitude = np.repeat(draw.normal(size=SECONDS // 2), 2 * RATE * 3)
    return 0.5 * draw.normal(size=T.size * 3) + 0.5 * amplitude * SLOPES[:, 0]


@pytest.mark.parametrize("errors", [independent, heavy, lasting, longer])
def test_deviations_are_those_of_repeated_experiments(figure, errors):
    draw, made = np.random.default_rng(1), problem()
    solutions = [found(errors(draw)) for _ in range(200)]
    spread = np.std([s.x for s in solutions], axis=0)
    stated = np.median([list(certainty(made, s).deviations.values()) for s in solutions], axis=0)
    figure(f"{errors.__name__}: stated over seen {stated[0] / spread[0]:.2f}, {stated[1] / spread[1]:.2f}")
    assert stated == pytest.approx(spread, rel=0.15)
