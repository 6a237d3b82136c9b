"""References of a robot, with checks of strains and rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soro_core.arrays import Array
from soro_core.control.config import ControllerConfig, ReferenceConfig
from soro_core.control.motions.configured_path import configured_path
from soro_core.control.motions.kinematics import elongation_for_pressure, inverse_kinematics
from soro_core.control.motions.motion_parts import PiecewiseMotion
from soro_core.control.pressures.actuation import CompletePressures
from soro_core.control.reference.coordinate_values import per_coordinate
from soro_core.control.reference.reference_transition import Bounds
from soro_core.control.reference.trajectory import Circle, Hold, Reference, Waypoints
from soro_core.errors import ConfigError
from soro_core.model import SoftArm
from soro_core.robot.coordinates import StrainFields


def bounds_of(fields: StrainFields, config: ReferenceConfig, pieces: int) -> Bounds:
    """Return the limits of references and transitions.

    Parameters
    ----------
    fields : StrainFields
        Strains of the discretised robot.
    config : ReferenceConfig
        Limits of the links.
    pieces : int
        Number of pieces into which each link is discretised.

    Returns
    -------
    Bounds
    """
    strain = np.where(fields.stretch, config.stretch_limit, config.bend_limit_rad / fields.length)
    rate = np.where(
        fields.stretch, config.stretch_rate_per_s, config.bend_rate_rad_s / (pieces * fields.length)
    )
    return Bounds(fields, strain, rate, config.smoothing_s)


def _worst_beyond(fields: StrainFields, limit: Array, rows: Array) -> tuple[Array, int] | None:
    """Return the row furthest beyond the limit, and the first coordinate of that strain; or None."""
    rows, slack = np.atleast_2d(rows), limit * (1.0 + 1e-9)
    part = np.max(fields.bounds(rows) / slack, axis=1)
    for k in np.argsort(-part)[: np.count_nonzero(part > 1.0)]:
        peaks = fields.peaks(rows[k]) / slack
        if np.max(peaks) > 1.0:
            return rows[k], int(np.argmax(peaks))
    return None


def configured_reference(
    arm: SoftArm, bounds: Bounds, config: ControllerConfig, pressures: CompletePressures
) -> Reference | None:
    """Return the configured reference, a circle or a path from time 0 on; None to hold the arm where it is.

    Circles, and set points of strains, are uniform along each link: their coefficients are
    `StrainFields.uniform`.

    Parameters
    ----------
    arm : SoftArm
        Model.
    bounds : Bounds
        Limits of strain and rate.
    config : ControllerConfig
        Parameters of the controller.
    pressures : CompletePressures
        Whose range a circle keeps.

    Returns
    -------
    Reference or None

    Raises
    ------
    ConfigError
        If the strains of the arm do not allow this reference.
    """
    settings, fields = config.reference, bounds.fields
    if settings.kind == "hold":
        return None
    if settings.kind == "path":
        return configured_path(arm, bounds, config)
    if settings.kind == "set_point":
        values, of_strains = per_coordinate(fields, settings.set_point, "reference.set_point")
        return Hold(values * fields.uniform if of_strains else values)
    across, along, stretch = (
        fields.of(strain) * fields.uniform for strain in ("bending_x", "bending_y", "elongation")
    )
    if not (across.any() and along.any()):
        raise ConfigError(
            "controller",
            "reference.kind",
            "circle",
            "set_point, path or hold for an arm without two bendings",
        )
    elongation = settings.elongation
    if settings.choose_elongation:
        low = np.full(arm.n_u, pressures.minimum_pa)
        high = np.full(arm.n_u, pressures.maximum_pa)
        bent = settings.curvature_per_m * across
        elongation = elongation_for_pressure(arm, fields, bent, stretch, settings.mean_pressure_pa, low, high)
    return Circle(elongation * stretch, across, along, settings.curvature_per_m, settings.period_s, 0.0)


def key_of(reference: Reference) -> str:
    """Return the key of a configured reference in the section `reference`."""
    if isinstance(reference, Circle):
        return "curvature_per_m"
    return "path_m" if isinstance(reference, PiecewiseMotion) else "set_point"


def check_configured(bounds: Bounds, reference: Reference | None) -> None:
    """Refuse a configured reference with strains beyond their limits.

    Raises
    ------
    ConfigError
        With the key of the strain.
    """
    if isinstance(reference, Hold):
        _check_configured(bounds, "set_point", reference.q)
    elif isinstance(reference, Circle):
        bent = reference.curvature_per_m * (reference.across + reference.along)
        _check_configured(bounds, "elongation (given or chosen)", reference.centre)
        _check_configured(bounds, "curvature_per_m", bent)


def _check_configured(bounds: Bounds, key: str, q: Array) -> None:
    found = _worst_beyond(bounds.fields, bounds.strain, q)
    if found is not None:
        row, at = found
        limit = "stretch_limit" if bounds.fields.stretch[at] else "bend_limit_rad"
        allowed = f"at most {bounds.strain[at]:g} (reference.{limit})"
        raise ConfigError("controller", f"reference.{key}", float(bounds.fields.peaks(row)[at]), allowed)


def trajectory_reference(
    bounds: Bounds,
    coordinates: Sequence[str],
    names: Sequence[str],
    times_s: Sequence[float],
    positions: Array | Sequence[Sequence[float]],
    velocities: Array | Sequence[Sequence[float]] | None = None,
    accelerations: Array | Sequence[Sequence[float]] | None = None,
    start_s: float = 0.0,
    stamp_ns: int = 0,
) -> Waypoints:
    """Return waypoints that keep the bounds, at the points and between them.

    Parameters
    ----------
    bounds : Bounds
        Limits of strain and rate.
    coordinates : sequence of str
        Names of the arm's coordinates, in order.
    names : sequence of str
        Coordinate of each column: every coordinate once, in any order.
    times_s : sequence of float (n_t,)
        Increasing times [s].
    positions, velocities, accelerations : array_like (n_t, n_q)
        Coordinates and their derivatives; the last two may be None.
    start_s : float
        Time that `times_s` counts from [s].
    stamp_ns : int
        Stamp of the message [ns].

    Returns
    -------
    Waypoints

    Raises
    ------
    ConfigError
        If names, times or numbers are wrong, or a strain or a rate is too large somewhere along a link.
    """
    waypoints = Waypoints(
        coordinates,
        names,
        times_s,
        positions,
        velocities,
        accelerations,
        start_s=start_s,
        stamp_ns=stamp_ns,
        limit=lambda q: _check_strains(bounds, coordinates, q),
    )
    strains, rates = waypoints.between()
    _check_strains(bounds, coordinates, strains)
    found = _worst_beyond(bounds.fields, bounds.rate, rates)
    if found is not None:
        row, at = found
        key = "stretch_rate_per_s" if bounds.fields.stretch[at] else "bend_rate_rad_s"
        allowed = f"at most {bounds.rate[at]:g} (reference.{key}): the trajectory needs more time"
        fastest = float(bounds.fields.peaks(row)[at])
        raise ConfigError("trajectory", f"rate of {coordinates[at]}", fastest, allowed)
    return waypoints


def _check_strains(bounds: Bounds, names: Sequence[str], q: Array) -> None:
    """Refuse coordinates (n_q,) or rows of them (n, n_q) beyond the limits."""
    fields = bounds.fields
    found = _worst_beyond(fields, bounds.strain, q)
    if found is None:
        return
    row, at = found
    field, most = fields.index[at], float(bounds.strain[at])
    key, got = f"positions of {names[at]}", float(row[at])
    if np.count_nonzero(fields.index == field) > 1:
        key = f"largest {fields.strains[field]} along link{fields.links[field]}"
        got = float(fields.peaks(row)[at])
    raise ConfigError("trajectory", key, got, f"{-most:g} to {most:g}")


def tip_reference(
    arm: SoftArm,
    fields: StrainFields,
    config: ReferenceConfig,
    limit: Array,
    start: Array,
    position: Array,
    quaternion: Array | None = None,
) -> Reference:
    """Return a set point that brings the tip to a pose.

    Parameters
    ----------
    arm : SoftArm
        Kinematics.
    fields : StrainFields
        Strains of the arm's robot.
    config : ReferenceConfig
        Tolerance of the position, and weight of the orientation.
    limit : ndarray (n_q,)
        Largest absolute strain of the field of each coordinate.
    start : ndarray (n_q,)
        Start of the search.
    position : ndarray (3,)
        Position of the tip in the world frame [m].
    quaternion : ndarray (4,), optional
        Orientation (x, y, z, w).

    Returns
    -------
    Reference

    Raises
    ------
    ConfigError
        If a number is not finite, or the arm misses the position by more than the configured tolerance.
    """
    where = np.asarray(position, dtype=np.float64)
    turn = None if quaternion is None else np.asarray(quaternion, dtype=np.float64)
    if where.shape != (3,) or not np.all(np.isfinite(where)):
        raise ConfigError("tip reference", "position", where.tolist(), "three finite numbers [m]")
    if turn is not None and (turn.shape != (4,) or not abs(float(turn @ turn) - 1.0) < 0.02):
        raise ConfigError("tip reference", "orientation", turn.tolist(), "a unit quaternion x, y, z, w")
    found = inverse_kinematics(arm, where, turn, start, limit, config.rotation_weight_m, fields=fields)
    if found.position_error_m > config.tip_tolerance_m:
        got = f"{where.tolist()}, missed by {1e3 * found.position_error_m:.1f} mm"
        raise ConfigError("tip reference", "position", got, "a point that the tip can reach")
    return Hold(found.q)
