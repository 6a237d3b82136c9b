"""Parameters of a proportional valve, apart from the kernels so that a configuration loads without numba."""

from __future__ import annotations

from pydantic import Field, model_validator

from soro_core.config import Strict


class ValveModel(Strict):
    """One kind of proportional valve, the same for every chamber, and the air behind it."""

    fill_m3_s_pa: float = Field(1e-9, ge=0, le=1e-3, description="sonic conductance C from the supply")
    vent_m3_s_pa: float = Field(1e-9, ge=0, le=1e-3, description="sonic conductance C to the exhaust")
    leak_m3_s_pa: float = Field(
        0.0, ge=0, le=1e-3, description="sonic conductance C of a leak to the outside"
    )
    critical_ratio: float = Field(0.35, ge=0, lt=0.99, description="critical pressure ratio b")
    supply_pa: float = Field(150e3, ge=0, le=5e6, description="gauge pressure of the supply")
    exhaust_pa: float = Field(
        0.0, ge=-101e3, le=0, description="gauge pressure of the exhaust; below 0 a vacuum"
    )
    band_pa: float = Field(2e3, gt=0, le=1e6, description="deviation from the set point that opens it fully")
    vent_band_pa: float = Field(0.0, ge=0, le=1e6, description="the same above the set point; 0 for band_pa")
    polytropic: float = Field(1.0, ge=1, le=1.4, description="exponent n of the gas; 1 isothermal")
    temperature_k: float = Field(293.15, gt=100, le=1000, description="temperature of the air outside")

    @model_validator(mode="after")
    def _ordered(self) -> ValveModel:
        if not self.exhaust_pa < self.supply_pa:
            raise ValueError("exhaust_pa must be below supply_pa")
        return self
