"""Small sections of a scene: its recorder and its verdict; keys of nodes that follow from others."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from soro_core.config import Strict
from soro_core.twin.config import TwinSection


class RecorderSection(Strict):
    """Keys of the recorder."""

    enabled: bool = Field(True, description="record a bag")
    exclude: tuple[str, ...] = Field((), strict=False, description="topics that are not recorded")


class VerdictSection(Strict):
    """Limits of a good and of a lost run without injected faults; under 5 s, of a lost one alone."""

    tip_error_part: float = Field(
        0.1,
        gt=0,
        le=1,
        description="largest tip error, RMS over the last 5 s, part of the arm's length; a reference that "
        "the best pressures leave further away is refused",
    )
    good_part: float = Field(
        0.02,
        gt=0,
        le=1,
        description="largest tip error of a good run, RMS over the last 5 s, part of the arm's length; a run "
        "between this and tip_error_part is poor",
    )
    at_bound_part: float = Field(0.5, gt=0, le=1, description="largest part of all set points at a bound")
    expected: Literal["good", "poor", "vented"] = Field(
        "good", description="how the run is meant to end (soro scenes); it does not change the verdict"
    )


def sample_keys(twin: TwinSection) -> dict[str, Any]:
    """Return the keys of the samples that a node waits for."""
    pose, imu = twin.pose, twin.imu
    return {
        "pose_locations": pose.locations,
        "imu_locations": imu.locations,
        "pose_rate_hz": pose.rate_hz if pose.enabled else 0.0,
        "pose_delay_s": pose.delay_s,
        "imu_rate_hz": imu.rate_hz if imu.enabled else 0.0,
        "imu_delay_s": imu.delay_s,
    }
