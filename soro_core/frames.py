"""Names of frames: of what the nodes publish, and of what they expect."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from soro_core.config import Strict, Strings

_Name = Annotated[str, Field(pattern=r"^[^/\s]\S*$")]
_NameOrNone = Annotated[str, Field(pattern=r"^([^/\s]\S*)?$")]


class Frames(Strict):
    """Names of the frames of one arm.

    A message without a frame counts as one in the frame that is expected there.
    """

    world: _Name = Field("world", description="the world: of every published pose and of arm/reference/tip")
    base: _Name = Field("base", description="the base of the arm: of arm/reference/path without a frame")
    tip: _Name = Field("tip", description="the tip of the arm, on /tf")
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
        if len({self.world, self.base, self.tip}) < 3:
            raise ValueError("names of world, base and tip that differ")
        return self

    @property
    def of_poses(self) -> str:
        """Frame that measured poses must state."""
        return self.pose or self.world

    def of_imu(self, number: int) -> str:
        """Frame that samples of an IMU must state; empty for any."""
        return self.imu[number] if number < len(self.imu) else ""
