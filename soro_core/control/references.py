"""The configured reference of a robot, and what is configured of its strains spread over its coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.control.config import ControllerConfig, ReferenceConfig
from soro_core.control.kinematics import elongation_for_pressure, inverse_kinematics
from soro_core.control.trajectory import Circle, Hold, Reference
from soro_core.errors import ConfigError
from soro_core.model import SoftArm
from soro_core.robot.coordinates import StrainFields

Array: TypeAlias = NDArray[np.float64]


def per_coordinate(fields: StrainFields, values: Sequence[float], key: str) -> tuple[Array, bool]:
    """Spread values over the coordinates (n_q,), and say whether they were given a strain of a link.

    Allowed are one value a strain of a link (repeated for every link and for the coefficients of the strain),
    one a coordinate, or one a coordinate of a link. Where two of these readings fit, the first counts.

    Raises
    ------
    ConfigError
        If the number of values fits none.
    """
    n, links, given = len(fields.index), fields.links[-1] + 1, len(values)
    array = np.array(values, dtype=np.float64)
    if given * links == len(fields.strains):
        return np.tile(array, links)[fields.index], True
    if given == n:
        return array, False
    if given * links == n:
        return np.tile(array, links), False
    counts = sorted({len(fields.strains) // links, n // links, n})
    allowed = f"{' or '.join(map(str, counts))} values: one a strain of a link, or one a coordinate"
    raise ConfigError("controller", key, list(values), allowed)


def gain_matrix(fields: StrainFields, values: Sequence[float], key: str) -> Array:
    """Return K_p or K_d (n_q, n_q): values of strains times W, values of coordinates as the diagonal."""
    spread, of_strains = per_coordinate(fields, values, key)
    return spread[:, None] * fields.weight if of_strains else np.diag(spread)


def strain_limits(fields: StrainFields, config: ReferenceConfig) -> Array:
    """Return the largest absolute strain that a reference may have, by coordinate (n_q,)."""
    return np.where(fields.stretch, config.stretch_limit, config.bend_limit_rad / fields.length)


def check_limits(fields: StrainFields, names: Sequence[str], limit: Array, q: Array) -> None:
    """Refuse coordinates whose strains are beyond `limit` (n_q,) somewhere along a link.

    Raises
    ------
    ConfigError
        Naming the first coordinate of the strain.
    """
    peaks = fields.peaks(q)
    for at in np.flatnonzero(peaks > limit)[:1]:
        field, most = fields.index[at], float(limit[at])
        key, got = f"positions of {names[at]}", float(q[at])
        if np.count_nonzero(fields.index == field) > 1:
            key, got = f"largest {fields.strains[field]} along link{fields.links[field]}", float(peaks[at])
        raise ConfigError("trajectory", key, got, f"{-most:g} to {most:g}")


def configured_reference(
    arm: SoftArm, fields: StrainFields, config: ControllerConfig, q: Array, t: float
) -> Reference:
    """Return the reference that the configuration asks for, from time `t` on, the arm being in `q`.

    Circles, and set points given a strain, are uniform along each link: their coefficients are
    `StrainFields.uniform`.
    """
    settings = config.reference
    if settings.kind == "hold":
        return Hold(q)
    if settings.kind == "set_point":
        values, of_strains = per_coordinate(fields, settings.set_point, "reference.set_point")
        return Hold(values * fields.uniform if of_strains else values)
    across, along, stretch = (
        fields.of(strain) * fields.uniform for strain in ("bending_x", "bending_y", "elongation")
    )
    if not (across.any() and along.any()):
        raise ConfigError(
            "controller", "reference.kind", "circle", "set_point or hold for an arm without two bendings"
        )
    elongation = settings.elongation
    if settings.choose_elongation:
        low = np.full(arm.n_u, config.pressures.minimum_pa)
        high = np.full(arm.n_u, config.pressures.maximum_pa)
        bent = settings.curvature_per_m * across
        elongation = elongation_for_pressure(arm, fields, bent, stretch, settings.mean_pressure_pa, low, high)
    return Circle(elongation * stretch, across, along, settings.curvature_per_m, settings.period_s, t)


def tip_reference(
    arm: SoftArm,
    fields: StrainFields,
    config: ReferenceConfig,
    limit: Array,
    start: Array,
    position: Array,
    quaternion: Array | None = None,
) -> Reference:
    """Return a set point that brings the tip to a position [m] (and orientation, as far as its weight says).

    The search starts at the coordinates `start` (n_q,) and stays within `limit` (n_q,).

    Raises
    ------
    ConfigError
        If a number is not finite or the arm cannot come within the configured tolerance.
    """
    where = np.asarray(position, dtype=np.float64)
    turn = None if quaternion is None else np.asarray(quaternion, dtype=np.float64)
    if where.shape != (3,) or not np.all(np.isfinite(where)):
        raise ConfigError("tip reference", "position", position, "three finite numbers [m]")
    if turn is not None and (turn.shape != (4,) or not abs(float(turn @ turn) - 1.0) < 0.02):
        raise ConfigError("tip reference", "orientation", quaternion, "a unit quaternion x, y, z, w")
    found = inverse_kinematics(arm, fields, where, turn, start, limit, config.rotation_weight_m)
    if found.position_error_m > config.tip_tolerance_m:
        got = f"{where.tolist()}, missed by {1e3 * found.position_error_m:.1f} mm"
        raise ConfigError("tip reference", "position", got, "a point that the tip can reach")
    return Hold(found.q)
