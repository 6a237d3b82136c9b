"""What drives an arm: chambers and tendons, where they lie and how they act; frozen, checked, SI units."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, ValidationInfo, field_validator

from soro_core.config import Strict


class Muscle(Strict):
    """A braided pneumatic muscle (McKibben): pressure shortens it, (58) of docs/model_terms.md."""

    radius_m: float = Field(gt=0, description="outer radius at rest, where the strain of its line is 0 [m]")
    braid_angle_rad: float = Field(
        ge=0.05, le=0.95, description="between its fibres and its line, at rest; at 0.955 it cannot pull"
    )

    @property
    def braid(self) -> float:
        """3 cos^2 of the braid angle."""
        return 3.0 * math.cos(self.braid_angle_rad) ** 2

    @property
    def section_m2(self) -> float:
        """Section at rest [m^2]."""
        return math.pi * self.radius_m**2

    @property
    def area_m2(self) -> float:
        """Force at rest per pressure [m^2], below 0: it pulls."""
        return -self.section_m2 * (self.braid - 1.0) / math.sin(self.braid_angle_rad) ** 2


class Chamber(Strict):
    """One pressure chamber: by area and offset, as a muscle with its offset, or by its two gains."""

    angle_rad: float = Field(
        ge=-4 * math.pi, le=4 * math.pi, description="about the tangent, from the local x axis"
    )
    muscle: Muscle | None = Field(None, description="what pulls in place of a chamber that pushes")
    area_m2: float | None = Field(None, gt=0, description="effective area [m^2]")
    offset_m: float | None = Field(
        None, ge=0, description="distance from the backbone [m]", validate_default=True
    )
    alpha_eps: float | None = Field(
        None, ge=0, description="generalised force on elongation per pressure [m^3]"
    )
    alpha_kappa: float | None = Field(
        None, ge=0, description="generalised force on curvature per pressure [m^4]", validate_default=True
    )

    volume_m3: float | None = Field(
        None,
        gt=0,
        description="of its air, tubes included, at q = 0 [m^3]; default: effective area times length",
    )
    area_slope: float = Field(
        0.0, ge=-50, le=50, description="the area grows as exp(area_slope * strain of the chamber's fibre)"
    )
    area_saturation: float = Field(
        0.0,
        ge=0,
        le=0.99,
        description="1 over the largest factor by which the area grows; 0: the exponential has no bound",
    )
    dead_band_pa: float = Field(
        0.0, ge=0, description="pressure [Pa] that the chamber takes before any of it acts on the arm"
    )
    swell_per_pa: float = Field(
        0.0,
        ge=0,
        le=1e-4,
        description="the area grows as 1 / (1 - swell_per_pa * pressure beyond the dead band) [1/Pa]",
    )

    @field_validator("area_m2")
    @classmethod
    def _pushes(cls, value: float | None, info: ValidationInfo) -> float | None:
        if value is not None and info.data.get("muscle") is not None:
            raise ValueError("left out where muscle is given")
        return value

    @field_validator("offset_m")
    @classmethod
    def _geometry(cls, value: float | None, info: ValidationInfo) -> float | None:
        if "area_m2" not in info.data or "muscle" not in info.data:
            return value  # the key at fault has its own message
        if (value is None) != (info.data["area_m2"] is None and info.data["muscle"] is None):
            raise ValueError("area_m2 or muscle together with offset_m, or both left out")
        return value

    @field_validator("alpha_kappa")
    @classmethod
    def _one_of_two(cls, value: float | None, info: ValidationInfo) -> float | None:
        if not {"muscle", "area_m2", "alpha_eps"} <= info.data.keys():
            return value  # the key at fault has its own message
        given = info.data["alpha_eps"] is not None
        if (value is not None) != given:
            raise ValueError("alpha_eps together with alpha_kappa, or both left out")
        if given == (info.data["area_m2"] is not None or info.data["muscle"] is not None):
            raise ValueError(
                "exactly one of area_m2 with offset_m, muscle with offset_m, or alpha_eps with alpha_kappa"
            )
        return value

    @field_validator("area_slope")
    @classmethod
    def _slope(cls, value: float, info: ValidationInfo) -> float:
        if value != 0.0 and info.data.get("alpha_eps") == 0.0:
            raise ValueError("0 where alpha_eps is 0: the strain of the fibre is not known then")
        if value != 0.0 and info.data.get("muscle") is not None:
            raise ValueError("0 of a muscle: its braid says how its pull changes")
        return value

    @field_validator("area_saturation")
    @classmethod
    def _saturation(cls, value: float, info: ValidationInfo) -> float:
        if value != 0.0 and info.data.get("area_slope") == 0.0:
            raise ValueError("0 where area_slope is 0: the area does not grow then")
        return value

    @property
    def burst_pa(self) -> float:
        """Gauge pressure at which the area has no bound any more [Pa]; infinite where none swells it."""
        return self.dead_band_pa + 1.0 / self.swell_per_pa if self.swell_per_pa else float("inf")

    def gains(self, length: float, whole: float) -> tuple[float, float]:
        """Generalised force per pressure on elongation [m^3] and curvature [m^4] of a link along it.

        Both are negative of a muscle.

        Parameters
        ----------
        length, whole : float
            Of that link, and of all links that the chamber runs along [m].
        """
        area = self.area_m2 if self.muscle is None else self.muscle.area_m2
        if area is not None and self.offset_m is not None:
            return area * length, area * length * self.offset_m
        assert self.alpha_eps is not None
        assert self.alpha_kappa is not None
        return self.alpha_eps * length / whole, self.alpha_kappa * length / whole


class Tendon(Strict):
    """One tendon without friction, pulled at the base of its first link and fixed at the end of its last."""

    angle_rad: float = Field(
        ge=-4 * math.pi, le=4 * math.pi, description="about the tangent, from the local x axis, at its base"
    )
    offset_m: float = Field(ge=0, description="distance from the backbone [m]")
    turns: float = Field(
        0.0, ge=-100, le=100, description="about the backbone on its way, from x to y; 0: straight"
    )
    links: Annotated[tuple[int, ...], Field(strict=False)] = Field(
        (), description="first and last link that it runs along, counted from 0; default: all"
    )
    max_tension_n: float = Field(100.0, gt=0, description="largest tension [N]; the smallest is 0")

    @field_validator("links")
    @classmethod
    def _order(cls, value: tuple[int, ...]) -> tuple[int, ...]:
        if value and not (len(value) == 2 and 0 <= value[0] <= value[1]):
            raise ValueError("[first, last] with 0 <= first <= last")
        return value
