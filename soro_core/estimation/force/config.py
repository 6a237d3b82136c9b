"""Keys of the estimate of the external force."""

from __future__ import annotations

from pydantic import Field

from soro_core.config import Strict


class ForceConfig(Strict):
    """How the external force at the tip is estimated; docs/force.md."""

    enabled: bool = Field(True, description="estimate the external force at the tip")
    period_s: float = Field(0.02, gt=0, le=1, description="time between two estimates")
    pieces: int = Field(
        4, ge=1, le=16, description="pieces of each link of the model: a force at the tip bends it unevenly"
    )
    low_pass_per_s: float = Field(
        8.0, gt=0, le=1e3, description="low-pass of positions, pressures and motion [rad/s]"
    )
    gain_std: float = Field(
        0.03,
        ge=0,
        le=1,
        description="deviation of the common gain of all chambers, which free motion does not show; less "
        "once a known weight or push has shown it",
    )
    stiffness_std: float = Field(
        0.1,
        ge=0,
        le=10,
        description="deviation of the elastic force, as a part of it, where nothing is learned of the arm",
    )
