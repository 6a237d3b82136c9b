"""Keys that several parts of a run share: at the top of a scene and in the parameters of nodes."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from soro_core.config import Strict
from soro_core.robot import Discretisation
from soro_core.safety import Limits

Mode: TypeAlias = Literal["real_time", "lockstep"]
Priority: TypeAlias = Annotated[
    int,
    Field(
        ge=0,
        le=99,
        description="real_time: priority (SCHED_FIFO) where the system permits it; 0 for none",
    ),
]


class ClockKeys(Strict):
    """Keys of time."""

    mode: Mode = Field(
        "real_time",
        description="real_time, or lockstep: deterministic, as fast as possible, one step a tick of /clock",
    )
    rate_hz: float = Field(200.0, gt=0, le=1000, description="ticks of the control loop a second")


class RobotKeys(Strict):
    """Key of the robot."""

    robot: str = Field("tue_three_bellow", description="robot file, or the name of a shipped one")


class LimitKeys(Strict):
    """Key of the limits of commands and readings."""

    limits: Limits = Field(Limits(), description="limits of commands and readings")


class SeedKeys(Strict):
    """Key of the noise."""

    seed: int = Field(1, ge=0, le=2**63 - 1, description="seed of all noise")


SHARED = (ClockKeys, RobotKeys, LimitKeys, SeedKeys)


class NodeKeys(ClockKeys):
    """Keys of every node of the loop."""

    autostart: bool = Field(True, description="configure and activate at start")


class ArmNodeKeys(NodeKeys, RobotKeys):
    """Keys of every node that computes the arm."""

    model: Discretisation = Field(Discretisation(), description="how the arm is computed")
