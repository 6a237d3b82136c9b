"""Keys of the force at the tip."""

from __future__ import annotations

from pydantic import Field

from soro_core.config import Strict


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
    rate_per_s: float = Field(
        1.5, gt=0, le=100, description="rate at which an error of the force ends"
    )
    cap_n: float = Field(
        0.0, ge=0, le=1e3, description="largest force at the tip, whatever the reference asks; 0 for no bound"
    )
    tare: bool = Field(
        False, description="a press that begins counts the estimated force of that moment as none"
    )
