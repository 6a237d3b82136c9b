"""The arm of a discretised robot."""

from __future__ import annotations

from soro_core.model.soft_arm import SoftArm
from soro_core.robot import Discretisation, Robot


def discretised(robot: Robot, model: Discretisation) -> SoftArm:
    """Return the arm of `robot` under `model`; its own robot has the pieces and shape functions.

    Raises
    ------
    ConfigError
        If the robot cannot be split or expanded in that way.
    """
    return SoftArm(
        model.discretise(robot), method=model.method, nodes=model.nodes or None, steps=model.steps or None
    )
