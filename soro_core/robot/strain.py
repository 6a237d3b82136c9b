"""Which strains a link carries, and with which shape functions along it; frozen and checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from soro_core.config import Floats, Strict
from soro_core.robot.bases import BASES, Basis, listed, names

Strain: TypeAlias = Literal["torsion", "bending_x", "bending_y", "elongation", "shear_x", "shear_y"]
STRAINS: tuple[Strain, ...] = ("torsion", "bending_x", "bending_y", "elongation", "shear_x", "shear_y")
DEFAULT_STRAINS: tuple[str, ...] = ("elongation", "bending_x", "bending_y")
MAX_ORDER = 12
MIN_SAMPLES = 4  # a cubic needs four
# Modes count as dependent below this ratio of their smallest and largest singular values, each scaled to 1:
# the inertia has its square, which must stay above round-off.
_INDEPENDENT = 1e-6


class StrainField(Strict):
    """Shape of one strain along the link: a sum of shape functions, each with one coordinate.

    The shape functions are 1 (`constant`), the polynomials P_k (`legendre`) or T_k (`chebyshev`) of
    2 sigma / L - 1 for k = 0 ... `order`, or modes given by samples (`pod`). None of them is scaled, so that
    a coordinate has the unit of its strain (of a mode: that unit over the mode's).
    """

    basis: str = Field("constant", description="one of `soro_core.robot.bases.BASES`")
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

    @field_validator("basis", mode="before")
    @classmethod
    def _known(cls, value: Any) -> str:
        if not isinstance(value, str) or value not in BASES:
            raise ValueError(listed(map(repr, BASES)))
        return value

    @field_validator("order")
    @classmethod
    def _order(cls, value: int | None, info: ValidationInfo) -> int | None:
        wanted = _takes(info, "order")
        if wanted and value is None:
            raise ValueError(f"a polynomial degree from 0 to {MAX_ORDER} for basis {info.data['basis']}")
        _refuse(value, info)
        return value

    @field_validator("modes", "samples", "file")
    @classmethod
    def _where_taken(cls, value: Any, info: ValidationInfo) -> Any:
        _refuse(value, info)
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
        if _takes(info, "samples") and info.data.get("samples", ()) is None:
            raise ValueError(
                "samples of the modes, or a file of them in a robot file or a dictionary for robot_from_dict"
            )
        return value

    @property
    def shape_functions(self) -> Basis:
        """The entry of the registry."""
        return BASES[self.basis]

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.shape_functions.size(self)

    @property
    def varies(self) -> bool:
        """Whether the strain can vary along the link."""
        return self.shape_functions.varies

    @property
    def is_uniform(self) -> bool:
        """Whether the one shape function is 1."""
        return self.shape_functions.is_uniform(self)


def _takes(info: ValidationInfo, key: str) -> bool | None:
    """Whether the basis takes the key; None where the basis itself is refused."""
    basis = info.data.get("basis")
    return None if basis is None else key in BASES[basis].keys


def _refuse(value: Any, info: ValidationInfo) -> None:
    """Refuse a value of a key that the basis does not take."""
    key = str(info.field_name)
    if value is not None and _takes(info, key) is False:
        those = listed(names(lambda basis: key in basis.keys), "and")
        raise ValueError(f"no {key} with basis {info.data['basis']}, only with {those}")


def coordinate_names(strains: Mapping[str, StrainField]) -> tuple[str, ...]:
    """Names of the coordinates in order: ``bending_x`` of a constant field, else ``bending_x_0``, ..."""
    return tuple(
        f"{name}_{k}" if field.varies else name for name, field in strains.items() for k in range(field.size)
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
