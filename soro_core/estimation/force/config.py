"""Keys of the estimate of the external force."""

from __future__ import annotations

from pydantic import Field

from soro_core.config import Strict


class ForceConfig(Strict):
    """How the external force at the tip is estimated; docs/force.md."""

    enabled: bool = Field(True, description="estimate the external force at the tip")
    period_s: float = Field(0.02, gt=0, le=1, description="time between two estimates")
    pieces: int = Field(
        8,
        ge=1,
        le=16,
        description="pieces of each link, which a force bends non-uniformly; at most 8 where links allow it",
    )
    low_pass_per_s: float = Field(8.0, gt=0, le=1e3, description="low-pass of the force that is told [rad/s]")
    fast_per_s: float = Field(
        25.0,
        gt=0,
        le=1e3,
        description="low-pass of positions, pressures and motion, behind which a new force is seen [rad/s]",
    )
    gain_std: float | None = Field(
        None,
        ge=0,
        le=1,
        description="deviation of the common gain of all chambers, which free motion does not show; default: "
        "calibration.gain_std of the robot where a known weight has made it less than 0.03, else 0.03",
    )
    model_std_pa: float = Field(
        100.0,
        ge=0,
        le=1e9,
        description="deviation of the model from the arm, play and bias of readings included, as a pressure "
        "in each chamber",
    )
    stiffness_std: float = Field(
        0.1,
        ge=0,
        le=10,
        description="deviation of the elastic force, as a part of it, where nothing is learned of the arm; "
        "under a force from outside that of its change since the touch",
    )
