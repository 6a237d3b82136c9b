"""Keys of motions of the tip, of its force, and of the checks before the controller is enabled."""

from __future__ import annotations

from pydantic import Field

from soro_core.config import Strict

# Stiffness of the tip that can be asked for, as multiples of its own.
SOFTEST, STIFFEST = 0.5, 2.0


class MotionConfig(Strict):
    """Motions to references by topic, and along paths of the tip (configured, by topic, `soro move`)."""

    speed_m_s: float = Field(0.04, gt=0, le=10, description="fastest speed of the tip")
    acceleration_m_s2: float = Field(0.1, gt=0, le=1e3, description="largest acceleration of the tip")
    tolerance_m: float = Field(
        1e-4, gt=0, le=0.1, description="paths that the tip would leave by more are refused as out of reach"
    )
    slowest: float = Field(
        10.0,
        ge=1,
        le=1e3,
        description="largest factor by which the time of a motion is extended until pressures and rates fit",
    )
    rate_part: float = Field(
        0.8, gt=0, le=1, description="part of the allowed rates of set points that a motion takes"
    )
    around: bool = Field(
        False, description="to one pose the arm goes around the obstacles of the robot file, if it must"
    )
    margin_m: float = Field(
        2e-3, ge=0, le=1, description="clearance from obstacles that a way around them keeps"
    )
    around_shapes: int = Field(
        40_000, ge=100, le=10_000_000, description="shapes of the arm among which a way around is sought"
    )
    reached_m: float = Field(
        2e-3, gt=0, le=1, description="distance of the tip from the end of a motion that counts as reached"
    )
    settle_s: float = Field(
        2.0, gt=0, le=60, description="time after the end of a motion within which the tip must be there"
    )


class ForceControlConfig(Strict):
    """How the controller presses, and the largest force that it lets the tip meet."""

    approach_speed_m_s: float = Field(
        0.005, gt=0, le=1, description="speed of the tip towards what it is to press on; bounds the first hit"
    )
    approach_s: float = Field(
        10.0, gt=0, le=600, description="longest time without contact; the tip then stops where it is"
    )
    follow_speed_m_s: float = Field(
        0.03, gt=0, le=1, description="fastest that the reference moves with what the tip presses on"
    )
    rate_per_s: float = Field(1.0, gt=0, le=100, description="rate at which an error of the force ends")
    cap_n: float = Field(
        0.0, ge=0, le=1e3, description="largest force at the tip, whatever the reference asks; 0 for no bound"
    )
    tare: bool = Field(
        False, description="a press that begins counts the estimated force of that moment as none"
    )
    stiffness_factor: float | None = Field(
        None,
        ge=SOFTEST,
        le=STIFFEST,
        description="stiffness of the tip against a contact, as a multiple of its own at the reference; an "
        "arm that falls without feedback has none; default: as the law makes it",
    )


class EnableBounds(Strict):
    """What is checked before the controller is enabled, and within which bounds."""

    sample_age_s: float = Field(0.5, gt=0, le=10, description="oldest sample of readings, state and sensors")
    pressure_pa: float = Field(1e3, gt=0, le=1e5, description="largest measured pressure, of either sign")
    distance_m: float = Field(
        0.01, gt=0, le=10, description="distance of a pose from the model at rest under some load"
    )
    angle_deg: float = Field(
        10.0, gt=0, le=180, description="angle of a pose, or of gravity in an IMU, from the model at rest"
    )
