"""Which strains a link carries, and with which shape functions along it; frozen and checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from soro_core.config import Floats, Strict

Strain: TypeAlias = Literal["torsion", "bending_x", "bending_y", "elongation", "shear_x", "shear_y"]
STRAINS: tuple[Strain, ...] = ("torsion", "bending_x", "bending_y", "elongation", "shear_x", "shear_y")
DEFAULT_STRAINS: tuple[str, ...] = ("elongation", "bending_x", "bending_y")
MAX_ORDER = 12
MIN_SAMPLES = 4  # a cubic needs four
# Modes count as dependent below this ratio of their smallest and largest singular values, each scaled to 1.
_INDEPENDENT = 1e-8


class StrainField(Strict):
    """Shape of one strain along the link: a sum of shape functions, each with one coordinate.

    The shape functions are 1 (`constant`), the polynomials P_k (`legendre`) or T_k (`chebyshev`) of
    2 sigma / L - 1 for k = 0 ... `order`, or modes given by samples (`pod`). None of them is scaled, so that
    a coordinate has the unit of its strain (of a mode: that unit over the mode's).
    """

    basis: Literal["constant", "legendre", "chebyshev", "pod"] = "constant"
    order: int | None = Field(
        None,
        ge=0,
        le=MAX_ORDER,
        description="polynomial degree, of legendre and chebyshev: order + 1 coordinates",
        validate_default=True,
    )
    modes: int | None = Field(None, ge=1, description="of pod: number of modes used; default all")
    samples: Annotated[tuple[Floats, ...], Field(strict=False)] | None = Field(
        None,
        description="of pod: rows of an array (n_samples, n_modes), at equal distances from 0 to L",
    )
    file: str | None = Field(
        None,
        min_length=1,
        description="of pod: .npy, .npz or .csv with that array; kept for the record once it is read",
        validate_default=True,
    )

    @field_validator("order")
    @classmethod
    def _order(cls, value: int | None, info: ValidationInfo) -> int | None:
        basis = info.data.get("basis")
        if basis in ("legendre", "chebyshev") and value is None:
            raise ValueError(f"a polynomial degree from 0 to {MAX_ORDER} for basis {basis}")
        if basis in ("constant", "pod") and value is not None:
            raise ValueError(f"no order with basis {basis}, only with legendre and chebyshev")
        return value

    @field_validator("modes", "samples", "file")
    @classmethod
    def _only_pod(cls, value: Any, info: ValidationInfo) -> Any:
        if value is not None and info.data.get("basis", "pod") != "pod":
            raise ValueError(f"no {info.field_name} with basis {info.data['basis']}, only with pod")
        return value

    @field_validator("samples")
    @classmethod
    def _modes_of_samples(cls, value: tuple[Floats, ...] | None, info: ValidationInfo) -> Any:
        if value is not None and "modes" in info.data:
            fault = samples_fault(value, info.data["modes"])
            if fault is not None:
                raise ValueError(fault)
        return value

    @field_validator("file")
    @classmethod
    def _read(cls, value: str | None, info: ValidationInfo) -> str | None:
        if info.data.get("basis") == "pod" and info.data.get("samples", ()) is None:
            raise ValueError(
                "samples of the modes, or a file of them in a robot file or a dictionary for robot_from_dict"
            )
        return value

    @property
    def size(self) -> int:
        """Number of coordinates."""
        if self.order is not None:
            return self.order + 1
        if self.samples is not None:
            return self.modes or len(self.samples[0])
        return 1


def coordinate_names(strains: Mapping[str, StrainField]) -> tuple[str, ...]:
    """Names of the coordinates in order: ``bending_x`` of a constant field, else ``bending_x_0``, ..."""
    return tuple(
        name if field.basis == "constant" else f"{name}_{k}"
        for name, field in strains.items()
        for k in range(field.size)
    )


def samples_fault(samples: Any, modes: int | None) -> str | None:
    """Say what is allowed where `samples` are not usable mode shapes, None where they are."""
    try:
        array = np.array(samples, dtype=np.float64)
    except (TypeError, ValueError):  # rows of different lengths, or not numbers
        array = np.empty(0)
    if array.ndim != 2 or len(array) < MIN_SAMPLES or not 1 <= array.shape[1] <= len(array):
        return f"an array (n_samples, n_modes) of numbers, n_samples >= {MIN_SAMPLES} and >= n_modes >= 1"
    if not np.isfinite(array).all():
        return "finite numbers"
    if modes is not None and modes > array.shape[1]:
        return f"at least as many modes as are used ({modes})"
    array = array[:, :modes]
    largest = np.abs(array).max(axis=0)
    if largest.min() > 0:
        scaled = array / largest
        values = np.linalg.svd(scaled / np.linalg.norm(scaled, axis=0), compute_uv=False)
        if values[-1] > _INDEPENDENT * values[0]:
            return None
    return "linearly independent modes, none of them zero"
