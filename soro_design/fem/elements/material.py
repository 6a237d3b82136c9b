"""Materials of soft parts, from a file to the row of numbers that the kernels read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from soro_core.arrays import Array
from soro_core.config import Strict, find_config, parse, read_yaml
from soro_core.errors import ConfigError, ModelError
from soro_design.fem.elements.response import HYPERELASTIC, SVK, response


class FatigueTest(Strict):
    """A published test: how often specimens of a material bear a stretch."""

    stretch: Annotated[float, Field(gt=1.0, description="greatest principal stretch of each cycle")]
    cycles: Annotated[float, Field(gt=0.0, description="until they fail, or until the test ended")]
    source: Annotated[str, Field(min_length=1, description="where this is published")]


class Strength(Strict):
    """What a material bears, once and often."""

    break_stretch: Annotated[float, Field(gt=1.0, description="1 + elongation at break, of one pull")]
    source: Annotated[str, Field(min_length=1, description="where that is published")]
    fatigue: Annotated[
        tuple[FatigueTest, ...], Field(strict=False, description="published tests; default: none")
    ] = ()


class Hyperelastic(Strict):
    """Neo-Hooke, Mooney-Rivlin and Yeoh in one, docs/design.md (1).

    W = c1 x + c2 x^2 + c3 x^3 + c01 (J^(-4/3) I2 - 3) + K/2 (J - 1)^2, x = J^(-2/3) I1 - 3.

    Parameters
    ----------
    kind : str
        hyperelastic.
    name : str
        Of the material.
    source : str
        Where the numbers come from.
    c1_pa, c2_pa, c3_pa, c01_pa : float
        Constants [Pa]; c2 alone may be negative.
    poisson_ratio : float
        Of small strains, which gives the bulk modulus K; for rubber .49 or more.
    stretch_range : tuple of float
        Least and greatest principal stretch for which stability is asked where c2 is negative.
    density_kg_per_m3 : float
        Mass per undeformed volume, for gravity.
    strength : Strength, optional
        What it bears, for reports.
    """

    kind: Literal["hyperelastic"]
    name: str = ""
    source: Annotated[str, Field(min_length=1)]
    c1_pa: Annotated[float, Field(ge=0.0)] = 0.0
    c2_pa: float = 0.0
    c3_pa: Annotated[float, Field(ge=0.0)] = 0.0
    c01_pa: Annotated[float, Field(ge=0.0)] = 0.0
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)]
    stretch_range: Annotated[tuple[float, float], Field(strict=False)] = (0.5, 2.0)
    density_kg_per_m3: Annotated[float, Field(gt=0.0)] = 1000.0
    strength: Strength | None = None

    @property
    def shear_modulus_pa(self) -> float:
        """Of small strains."""
        return 2.0 * (self.c1_pa + self.c01_pa)

    @property
    def bulk_modulus_pa(self) -> float:
        """Of small strains: 2 mu (1 + nu) / (3 (1 - 2 nu))."""
        nu = self.poisson_ratio
        return 2.0 * self.shear_modulus_pa * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))

    @property
    def law(self) -> Array:
        """The numbers that kernels read."""
        constants = (self.c1_pa, self.c2_pa, self.c3_pa, self.c01_pa)
        return np.array([HYPERELASTIC, *constants, self.bulk_modulus_pa])


class SaintVenant(Strict):
    """St. Venant-Kirchhoff, docs/design.md (3): for large rotations at small strains.

    Parameters
    ----------
    kind : str
        st_venant_kirchhoff.
    name : str
        Of the material.
    source : str
        Where the numbers come from.
    youngs_modulus_pa : float
        Of small strains [Pa].
    poisson_ratio : float
        Of small strains.
    density_kg_per_m3 : float
        Mass per undeformed volume, for gravity.
    strength : Strength, optional
        What it bears, for reports.
    """

    kind: Literal["st_venant_kirchhoff"]
    name: str = ""
    source: Annotated[str, Field(min_length=1)]
    youngs_modulus_pa: Annotated[float, Field(gt=0.0)]
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)]
    density_kg_per_m3: Annotated[float, Field(gt=0.0)] = 1000.0
    strength: Strength | None = None

    @property
    def shear_modulus_pa(self) -> float:
        """Of small strains."""
        return self.youngs_modulus_pa / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def law(self) -> Array:
        """The numbers that kernels read."""
        mu, nu = self.shear_modulus_pa, self.poisson_ratio
        return np.array([SVK, 2.0 * mu * nu / (1.0 - 2.0 * nu), mu, 0.0, 0.0, 0.0])


Material = Hyperelastic | SaintVenant
_KINDS: dict[str, type[Hyperelastic] | type[SaintVenant]] = {
    "hyperelastic": Hyperelastic,
    "st_venant_kirchhoff": SaintVenant,
}


def load_material(name_or_path: str | Path) -> Material:
    """Read a material file, or a shipped material by its name (config/materials).

    Raises
    ------
    ConfigError
        One line with file, key, what was found and what is allowed; also where the material is not stable.
    """
    path = find_config(name_or_path, "materials")
    return material_from_dict({"name": path.stem, **read_yaml(path)}, str(path))


def material_from_dict(data: Mapping[str, Any], where: str = "material") -> Material:
    """Make a material from a dictionary with the keys of a material file; errors as in `load_material`."""
    kind = data.get("kind")
    model = _KINDS.get(kind) if isinstance(kind, str) else None
    if model is None:
        raise ConfigError(where, "kind", kind, " or ".join(_KINDS))
    material = parse(data, model, where)
    if isinstance(material, SaintVenant):
        return material
    if material.shear_modulus_pa <= 0.0:
        raise ConfigError(where, "c1_pa", material.c1_pa, "c1_pa + c01_pa > 0")
    low, high = material.stretch_range
    if not 0.0 < low < 1.0 < high:
        raise ConfigError(where, "stretch_range", material.stretch_range, "[below 1, above 1], both > 0")
    if material.c2_pa < 0.0:
        unstable = first_unstable(material, low, high)
        if unstable is not None:
            allowed = (
                f"a stable law; at stretches {unstable[0]:.3g}, {unstable[1]:.3g} stress falls with strain"
            )
            raise ConfigError(where, "stretch_range", material.stretch_range, allowed)
    return material


def nominal_stress(material: Material, stretch: float) -> float:
    """Return the uniaxial nominal stress [Pa] at a stretch that keeps the volume."""
    if not stretch > 0.0:
        raise ModelError(f"stretch {stretch}; allowed: > 0", "stretch")
    across = stretch**-0.5
    P, _ = _stress(material, np.array([stretch, across, across]))
    # The pressure that frees the sides of stress.
    return float(P[0, 0] - P[1, 1] * across / stretch)


def first_unstable(material: Material, low: float, high: float) -> tuple[float, float] | None:
    """Return two principal stretches at which Drucker's condition fails, docs/design.md (4), or None.

    Parameters
    ----------
    material : Hyperelastic or SaintVenant
        The material, taken at constant volume.
    low, high : float
        Range of all three principal stretches.
    """
    # In each direction, evenly spaced in their logarithm.
    tried = np.exp(np.linspace(np.log(low), np.log(high), 41))
    # Near the undeformed state first.
    pairs = [(a, b) for a in tried for b in tried if a >= b and low <= 1.0 / (a * b) <= high]
    for a, b in sorted(pairs, key=lambda pair: np.log(pair[0]) ** 2 + np.log(pair[1]) ** 2):
        if drucker_modulus(material, a, b) <= 0.0:
            return float(a), float(b)
    return None


def drucker_modulus(material: Material, a: float, b: float) -> float:
    """Return the least slope of stress over logarithmic strain [Pa] at constant volume, docs/design.md (4).

    Parameters
    ----------
    material : Hyperelastic or SaintVenant
        The material, taken at constant volume.
    a, b : float
        Two principal stretches; the third is 1 / (a b).
    """
    stretches = np.array([a, b, 1.0 / (a * b)])
    P, A = _stress(material, stretches)
    by_log = A[np.ix_([0, 4, 8], [0, 4, 8])] * np.outer(stretches, stretches) + np.diag(
        np.diag(P) * stretches
    )
    free = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]])
    return float(np.linalg.eigvalsh(free.T @ by_log @ free)[0])


def _stress(material: Material, stretches: Array) -> tuple[Array, Array]:
    P, A = np.empty((3, 3)), np.empty((9, 9))
    response(material.law, np.diag(stretches), P, A)
    return P, A
