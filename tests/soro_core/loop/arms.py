"""Arms with automatic gains, and references that they can follow: all keys automatic or of the platform."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from soro_core import SoftArm, load_robot
from soro_core.config import find_config, parse
from soro_core.control import ControllerConfig, Point, Reference
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.pneumatics import RegulatorModel
from soro_core.robot import Discretisation, Robot
from tests.soro_core.loop.loop_harness import Setup

PERIOD_S = 4.0
HANGING = (1.0, 0.0, 0.0, 0.0)


class Sines(Reference):
    """A sine of `PERIOD_S` in each coordinate: middle, amplitude and phase (n_q,)."""

    def __init__(self, middle, amplitude, phase):
        self.middle, self.amplitude, self.phase = (np.array(x, float) for x in (middle, amplitude, phase))

    def sample(self, t: float) -> Point:
        w = 2.0 * np.pi / PERIOD_S
        turned = w * t + self.phase
        rate = self.amplitude * w
        return Point(
            self.middle + self.amplitude * np.sin(turned), rate * np.cos(turned), -rate * w * np.sin(turned)
        )


class Rests(Reference):
    """Resting places of an arm with fewer chambers than coordinates, under pressures that go up and down."""

    def __init__(self, arm: SoftArm, middle_pa: float, amplitude_pa: float):
        w = 2.0 * np.pi / PERIOD_S
        times = np.linspace(0.0, PERIOD_S, 81)
        rests = [equilibrium(arm, np.full(arm.n_u, middle_pa + amplitude_pa * np.sin(w * t))) for t in times]
        rests[-1] = rests[0]
        self.q = CubicSpline(times, np.array(rests), bc_type="periodic")

    def sample(self, t: float) -> Point:
        return Point(*(self.q(t, k) for k in range(3)))


@dataclass(frozen=True)
class Arm:
    """One case.

    Attributes
    ----------
    name : str
    robot : callable
        Gives the robot of the loop, and changes of the setup that depend on it.
    goal_m : float
        RMS of the tip error of the last 5 s [m].
    setup : mapping
        Other changes of the setup.
    keys : mapping
        Keys of the reference; all else is automatic.
    model : Discretisation
        Of estimator and controller.
    """

    name: str
    robot: Callable[[], tuple[Robot, dict[str, Any]]]
    goal_m: float
    setup: Mapping[str, Any] = field(default_factory=dict)
    keys: Mapping[str, Any] = field(default_factory=dict)
    model: Discretisation = field(default_factory=Discretisation)

    def ready(self, seed: int = 1, law: str = "composite", **changes: Any) -> tuple[Robot, Setup]:
        """Return robot and setup."""
        robot, own = self.robot()
        low, high = robot.pressure_range_pa
        # Range of the platform; set points may be below zero only where its regulators can.
        pressures = {"minimum_pa": low, "maximum_pa": high}
        control = {"law": law, "pressures": pressures, "reference": dict(self.keys)}
        return robot, Setup(
            **{
                "seed": seed,
                "duration_s": 16.0,
                "refine": 2,
                "regulator": RegulatorModel(minimum_pa=low, maximum_pa=high),
                "control": parse(control, ControllerConfig, self.name),
                "model": self.model,
                **own,
                **self.setup,
                **changes,
            }
        )


def shipped(name: str) -> Robot:
    return load_robot(find_config(name, "robots"))


def two_segments(poses: int) -> tuple[Robot, dict[str, Any]]:
    """The fabric arm of 270 mm with 100 g; its outer chambers bend it about one axis.

    They lengthen it as well: it moves about the length that 40 kPa in all chambers give.
    """
    robot, turn = shipped("asu_two_segment"), 0.5 * np.pi
    reference = Sines([0.23, 0, 0, 0.097, 0, 0], [0.015, 1.2, 0, 0.01, 1.2, 0], [0, 0, 0, turn, 1.0, 0])
    place = robot.links[0].length if poses == 2 else 0.0
    return robot, {"payload_kg": 0.1, "reference": reference, "second_pose_m": place}


def two_links(poses: int) -> tuple[Robot, dict[str, Any]]:
    """Two three-bellow links, hanging, with 10 g."""
    one, turn = shipped("tue_three_bellow"), 0.5 * np.pi
    robot = one.replace(links=(one.links[0], one.links[0]), name="two_links", base_quaternion=HANGING)
    reference = Sines([0.09, 0, 0, 0.06, 0, 0], [0, 3.0, 3.0, 0, 3.0, 3.0], [0, 0, turn, 0, turn, 2 * turn])
    place = one.links[0].length if poses == 2 else 0.0
    return robot, {"payload_kg": 0.01, "reference": reference, "second_pose_m": place}


def hanging() -> tuple[Robot, dict[str, Any]]:
    return shipped("tue_three_bellow").replace(base_quaternion=HANGING), {}


def standing() -> tuple[Robot, dict[str, Any]]:
    return shipped("tue_three_bellow"), {}


def six_links() -> tuple[Robot, dict[str, Any]]:
    """One chamber for 18 coordinates: the others hang. Standing it falls over, which no pressure prevents."""
    robot = shipped("six_link").replace(base_quaternion=HANGING)
    return robot, {"reference": Rests(SoftArm(robot), 0.0, 60e3), "payload_kg": 0.0}


CIRCLE = {"refine": 4, "payload_kg": 0.02}
ARMS = (
    Arm("asu_two_segment, 100 g, poses at both plates", lambda: two_segments(2), 0.15e-3),
    Arm("asu_two_segment, 100 g, pose at the tip", lambda: two_segments(1), 0.4e-3),
    Arm("two three-bellow links, 10 g, two poses", lambda: two_links(2), 0.18e-3),
    Arm("two three-bellow links, 10 g, pose at the tip", lambda: two_links(1), 3e-3),
    Arm(
        "the arm hanging, 7 1/m, 20 g",
        hanging,
        0.005 * 0.064,
        CIRCLE,
        {"curvature_per_m": 7.0, "mean_pressure_pa": 40e3},
    ),
    Arm("the arm hanging, 10 1/m, 20 g", hanging, 0.005 * 0.064, CIRCLE),
    Arm(
        "the arm standing, Legendre order 1, 20 g",
        standing,
        0.005 * 0.064,
        CIRCLE,
        model=Discretisation(basis="legendre", order=1),
    ),
    Arm("six_link, one chamber", six_links, 0.005 * 0.15),
)
BY_NAME = {arm.name: arm for arm in ARMS}
