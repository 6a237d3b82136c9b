"""Keys that several parts of a run share: at the top of a scene and in the parameters of nodes."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, field_validator, model_validator

from soro_core.config import Floats, Strict, Strings, with_changes
from soro_core.robot import Discretisation
from soro_core.safety import Limits

_Name = Annotated[str, Field(pattern=r"^[^/\s]\S*$")]
_NameOrNone = Annotated[str, Field(pattern=r"^([^/\s]\S*)?$")]


class Frames(Strict):
    """Names of the frames of one arm.

    A message without a frame counts as one in the frame that is expected there.
    """

    world: _Name = Field("world", description="the world: of every published pose and of arm/reference/tip")
    base: _NameOrNone = Field(
        "",
        description="the base of the arm: of arm/reference/path without a frame; empty: base, behind the "
        "namespace. Frames on the arm stand beside it",
    )
    tip: _NameOrNone = Field("", description="the tip of the arm, on /tf; empty: tip, beside the base")
    pose: _NameOrNone = Field(
        "", description="frame that sensors/pose0, pose1, ... must state: that of your tracker; empty: world"
    )
    imu: Strings = Field(
        (),
        description="frames that sensors/imu0, imu1, ... must state; empty: any, because an IMU measures in "
        "its own frame, whatever its name",
    )

    @model_validator(mode="after")
    def _differ(self) -> Frames:
        if len({self.world, self.base or "base", self.tip or "tip"}) < 3:
            raise ValueError("names of world, base and tip that differ")
        return self

    def within(self, namespace: str) -> Frames:
        """Return them with names of base and tip: those that are not stated stand behind a namespace."""
        named = with_changes(self, base=self.base or f"{namespace}/base".lstrip("/"))
        return with_changes(named, tip=self.tip or named.beside("tip"))

    def beside(self, name: str) -> str:
        """Return the name of another frame of the arm, beside its base."""
        return f"{self.base.rpartition('/')[0]}/{name}".lstrip("/")

    @property
    def of_poses(self) -> str:
        """Frame that measured poses must state."""
        return self.pose or self.world

    def of_imu(self, number: int) -> str:
        """Frame that samples of an IMU must state; empty for any."""
        return self.imu[number] if number < len(self.imu) else ""

    def imu_name(self, number: int) -> str:
        """Frame of an IMU: the stated one, else one beside the base."""
        return self.of_imu(number) or self.beside(f"imu{number}")


Mode: TypeAlias = Literal["real_time", "lockstep"]
Priority: TypeAlias = Annotated[
    int,
    Field(
        ge=0,
        le=99,
        description="real_time: priority (SCHED_FIFO) where the system permits it; 0 for none",
    ),
]


class StartKeys(Strict):
    """Keys of the start of a node."""

    autostart: bool = Field(True, description="configure and activate at start")
    end_on_failed_start: bool = Field(
        False,
        description="end the process if autostart fails, as soro run has it; otherwise the node stays, and a "
        "later transition may succeed",
    )


class ClockKeys(Strict):
    """Keys of time."""

    mode: Mode = Field(
        "real_time",
        description="real_time, or lockstep: deterministic, as fast as possible, one step a tick of /clock",
    )
    rate_hz: float = Field(200.0, ge=1e-3, le=1000, description="ticks of the control loop a second")


class RobotKeys(Strict):
    """Key of the robot."""

    robot: str = Field("tue_three_bellow", description="robot file, or the name of a shipped one")


class LimitKeys(Strict):
    """Key of the limits of commands and readings."""

    limits: Limits = Field(Limits(), description="limits of commands and readings")


class SeedKeys(Strict):
    """Key of the noise."""

    seed: int = Field(1, ge=0, le=2**63 - 1, description="seed of all noise")


class FrameKeys(Strict):
    """Key of the names of frames."""

    frames: Frames = Field(Frames(), description="names of the frames of what is published and expected")


SHARED = (ClockKeys, RobotKeys, LimitKeys, SeedKeys, FrameKeys)


def check_places(values: tuple[float, ...]) -> tuple[float, ...]:
    """Return the places of sensors, parts of the arm's length.

    Raises
    ------
    ValueError
        If one is outside the arm, or two are the same: their samples could not be told apart.
    """
    if any(not 0.0 <= place <= 1.0 for place in values):
        raise ValueError("places from 0 (base) to 1 (tip)")
    if len(set(values)) != len(values):
        raise ValueError("places that differ")
    return values


class PlaceKeys(Strict):
    """Keys of the places of sensors on the arm."""

    pose_locations: Floats = Field(
        (1.0,), description="places of sensors/pose0, pose1, ..., part of the arm's length"
    )
    imu_locations: Floats = Field(
        (1.0,), description="places of sensors/imu0, imu1, ..., part of the arm's length"
    )

    @field_validator("pose_locations", "imu_locations")
    @classmethod
    def _on_the_arm(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        return check_places(values)


class NodeKeys(ClockKeys, StartKeys):
    """Keys of every node of the loop."""


class ArmNodeKeys(NodeKeys, RobotKeys, FrameKeys):
    """Keys of every node that computes the arm."""

    model: Discretisation = Field(Discretisation(), description="how the arm is computed")
