"""Keys of the adaptation of `law: adaptive`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field, model_validator

from soro_core.config import Floats, Strict, Strings

ADAPTABLE = (
    "a1",
    "a2",
    "a4",
    "a5",
    "damping_stretch",
    "damping_curvature",
    "tip_mass",
    "link_mass",
    "chamber_gain",
)


class Adaptation(Strict):
    """Adapted parameters, their gains and bounds: lists of equal length.

    Gain and bounds of the mass at the tip alone come from the model where they are not stated.
    """

    parameters: Strings = Field(
        ("tip_mass",), description=f"adapted parameters, any of {', '.join(ADAPTABLE)}"
    )
    gain: Floats | None = Field(
        None, description="diagonal of Gamma, one a parameter; default for tip_mass: from the model"
    )
    lower: Floats | None = Field(
        None, description="lower bounds, in the parameter's unit; default for tip_mass: 0"
    )
    upper: Floats | None = Field(
        None, description="upper bounds, in the parameter's unit; default for tip_mass: from the model"
    )
    margin_stretch_n_m: float = Field(10.0, gt=0, le=1e6, description="least a1 - a2")
    margin_bend_n_m_rad: float = Field(1e-4, gt=0, le=1e3, description="least a4 - a5")
    dead_zone_stretch_per_s: float = Field(0.0, ge=0, le=10, description="|s| below which the estimates hold")
    dead_zone_curvature_per_m_s: float = Field(
        0.0, ge=0, le=1e3, description="|s| below which the estimates hold"
    )
    leakage_per_s: float = Field(
        0.0, ge=0, le=10, description="sigma modification: pull to the robot's values"
    )
    hold_saturated: bool = Field(
        True,
        description="hold estimates whose change would enlarge the residual force of saturated pressures",
    )

    @model_validator(mode="before")
    @classmethod
    def _of_none(cls, value: Any) -> Any:
        # Nothing adapted: a parameter file cannot tell an empty list from one that is not stated.
        if isinstance(value, Mapping) and not value.get("parameters", ("tip_mass",)):
            return {**value, **{key: [] for key in ("gain", "lower", "upper") if value.get(key) is None}}
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Adaptation:
        n = len(self.parameters)
        for name in ("gain", "lower", "upper"):
            values = getattr(self, name)
            if values is None and self.parameters != ("tip_mass",):
                raise ValueError(f"{name} must be stated: the model gives that of tip_mass alone")
            if values is not None and len(values) != n:
                raise ValueError(f"{name} must have as many values as parameters ({n})")
        for parameter in self.parameters:
            if parameter not in ADAPTABLE:
                raise ValueError(f"parameters: {parameter!r} is none of {', '.join(ADAPTABLE)}")
        if len(set(self.parameters)) != n:
            raise ValueError("parameters: a name stands twice")
        for i, name in enumerate(self.parameters):
            gain, lower, upper = (None if x is None else x[i] for x in (self.gain, self.lower, self.upper))
            if gain is not None and gain < 0.0:
                raise ValueError(f"gain of {name} must not be negative")
            if lower is not None and upper is not None and not lower < upper:
                raise ValueError(f"lower bound of {name} must be below its upper bound")
            if lower is not None and name.endswith("mass") and lower < 0.0:
                raise ValueError(f"lower bound of {name} must not be negative")
            if lower is not None and name == "chamber_gain" and lower <= 0.0:
                raise ValueError(
                    "lower bound of chamber_gain must be above 0: the estimate must stay invertible"
                )
        return self


class CompleteAdaptation(Adaptation):
    """Adapted parameters with a value for each key."""

    gain: Floats
    lower: Floats
    upper: Floats
