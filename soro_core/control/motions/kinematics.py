"""Coordinates of a reference: inverse kinematics of the tip, and the elongation of a circle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.control.pressures.allocation import allocate, balanced_weight
from soro_core.control.pressures.effective_pressure import effective_pressure_of
from soro_core.errors import ModelError, short
from soro_core.model import SoftArm
from soro_core.model.checks import finite, number, require, shaped
from soro_core.robot.coordinates import StrainFields, strain_fields
from soro_core.rotation import matrix_from_quaternion, rotation_log

# The search ends after _SLOW_STEPS steps in a row that each leave more than _SLOW of the squared error: near
# a solution the error falls much faster, and a pose out of reach must not delay the loop.
_SLOW, _SLOW_STEPS = 0.99, 5
# Largest elongation or shear, and largest bending or torsion of a link [rad], of a reference.
STRETCH_LIMIT, BEND_LIMIT_RAD = 0.6, 3.0


@dataclass(frozen=True)
class InverseSolution:
    """Coordinates (n_q,) found for a pose of the tip, and the remaining errors."""

    q: Array
    position_error_m: float
    rotation_error_rad: float
    iterations: int


def inverse_kinematics(
    arm: SoftArm,
    position: ArrayLike,
    orientation: ArrayLike | None = None,
    start: ArrayLike | None = None,
    limit: ArrayLike | None = None,
    rotation_weight_m: float | None = None,
    iterations: int = 100,
    fields: StrainFields | None = None,
) -> InverseSolution:
    """Find coordinates that bring the tip to a pose: damped least squares on bounded q (Levenberg-Marquardt).

    The damping weighs the mean square of the strains, so that the iterates do not depend on the basis.

    Parameters
    ----------
    arm : SoftArm
        Kinematics.
    position : (3,)
        Position of the tip in the world frame [m].
    orientation : (4,), optional
        Orientation (x, y, z, w); default: free.
    start : (n_q,), optional
        Start of the search; default straight.
    limit : (n_q,), optional
        Largest absolute strain of the field of each coordinate, > 0; default 0.6 of elongation and shear,
        3 rad a link of bending and torsion.
    rotation_weight_m : float, optional
        Metres of position error that weigh as much as one radian; default a tenth of the arm's length. At 0
        the orientation is free.
    iterations : int
        Largest number of iterations.
    fields : StrainFields, optional
        Strains of the arm's robot, if they are known already.

    Returns
    -------
    InverseSolution
        The nearest that was found, with its errors: a pose out of reach is no error.

    Raises
    ------
    ModelError
        If a shape or a number is not allowed.
    """
    require(arm, SoftArm, "arm", "a SoftArm")
    length, name = arm.length, arm.robot.name
    fields = strain_fields(arm.robot) if fields is None else fields
    position = finite(shaped(position, (3,), "position", name), "position")
    begin = np.zeros(arm.n_q) if start is None else finite(shaped(start, (arm.n_q,), "start", name), "start")
    if limit is None:
        limit = np.where(fields.stretch, STRETCH_LIMIT, BEND_LIMIT_RAD / fields.length)
    limit = finite(shaped(limit, (arm.n_q,), "limit", name), "limit")
    if not (limit > 0.0).all():
        raise ModelError(f"limit: got {short(limit.tolist())}; allowed are numbers above 0", "limit")
    if rotation_weight_m is None:
        rotation_weight_m = 0.1 * length
    if not 0.0 <= number(rotation_weight_m) < np.inf:
        got = short(rotation_weight_m)
        raise ModelError(f"rotation_weight_m: got {got}; allowed is 0 or more", "rotation_weight_m")
    wanted = None
    if orientation is not None:
        turn = finite(shaped(orientation, (4,), "orientation", name), "orientation")
        if not abs(float(turn @ turn) - 1.0) < 0.02:
            raise ModelError("orientation: allowed is a unit quaternion x, y, z, w", "orientation")
        wanted = matrix_from_quaternion(turn)
    target = wanted if rotation_weight_m > 0.0 else None

    def residual(q: Array) -> tuple[Array, Array]:
        pose, jacobian = arm.pose_and_jacobian(q, length)
        rotation = pose[:3, :3]
        rows = [np.asarray(position - pose[:3, 3])]
        slopes = [rotation @ jacobian[3:]]
        if target is not None:
            # Near the solution log(R' R_target) changes by minus the body rotation; far off, this is a
            # descent.
            turn = rotation_log(rotation.T @ target)
            rows.append(rotation_weight_m * turn)
            slopes.append(rotation_weight_m * jacobian[:3])
        return np.concatenate(rows), np.vstack(slopes) * limit

    x = fields.within(begin, limit) / limit
    error, slope = residual(x * limit)
    damping, used, slow = 1e-3, 0, 0
    for used in range(1, iterations + 1):  # noqa: B007
        square = slope.T @ slope
        scale = max(float(np.trace(np.linalg.solve(fields.weight, square))) / x.size, 1e-300)
        step = np.linalg.solve(square + damping * scale * fields.weight, slope.T @ error)
        tried = fields.within((x + step) * limit, limit) / limit
        try:
            new_error, new_slope = residual(tried * limit)
            is_nearer = float(new_error @ new_error) < float(error @ error)
        except ModelError:  # no arm is that short
            is_nearer = False
        if is_nearer:
            moved = float(np.max(np.abs(tried - x)))
            slow = slow + 1 if float(new_error @ new_error) > _SLOW * float(error @ error) else 0
            x, error, slope, damping = tried, new_error, new_slope, max(0.2 * damping, 1e-12)
            if moved < 1e-12 or slow == _SLOW_STEPS:
                break
        else:
            damping *= 5.0
            if damping > 1e9:
                break
    q = x * limit
    pose = arm.pose(q, length)
    turn_error = 0.0
    if wanted is not None:
        turn_error = float(np.linalg.norm(rotation_log(pose[:3, :3].T @ wanted)))
    return InverseSolution(q, float(np.linalg.norm(position - pose[:3, 3])), turn_error, used)


def mean_static_pressure(
    arm: SoftArm, fields: StrainFields, q: Array, minimum_pa: Array, maximum_pa: Array
) -> float:
    """Return the mean of the pressures [Pa] that hold the arm at rest in `q`, without regard to bounds.

    Parameters
    ----------
    arm : SoftArm
        Model.
    fields : StrainFields
        Strains of the arm's robot.
    q : ndarray (n_q,)
        Coordinates.
    minimum_pa, maximum_pa : ndarray (n_u,)
        Range of pressures [Pa gauge], for the scale of the search.
    """
    load = arm.gravity_force(q) + arm.elastic_force(q)
    return mean_holding_pressure(arm, fields, load, arm.actuation_matrix(q), minimum_pa, maximum_pa)


def mean_holding_pressure(
    arm: SoftArm, fields: StrainFields, load: Array, actuation: Array, minimum_pa: Array, maximum_pa: Array
) -> float:
    """Return the mean of the pressures [Pa] that hold a load (n_q,) by H (n_q, n_u).

    Other parameters as in `mean_static_pressure`.
    """
    weight = balanced_weight(actuation, fields)
    wide = 1e3 * (maximum_pa - minimum_pa)
    middle = 0.5 * (minimum_pa + maximum_pa)
    found = allocate(actuation, load, middle - wide, middle + wide, weight, 1e-12, middle, middle)
    return float(np.mean(effective_pressure_of(arm.robot).to_setpoint(found.pressure_pa)))


def elongation_for_pressure(
    arm: SoftArm,
    fields: StrainFields,
    bent: Array,
    stretch: Array,
    mean_pa: float,
    minimum_pa: Array,
    maximum_pa: Array,
) -> float:
    """Return the elongation at which a mean pressure of `mean_pa` holds the bent arm.

    Parameters
    ----------
    arm : SoftArm
        Model.
    fields : StrainFields
        Strains of the arm's robot.
    bent : ndarray (n_q,)
        Coordinates with the curvature of the reference.
    stretch : ndarray (n_q,)
        Coordinates of a uniform elongation of 1.
    mean_pa : float
        Mean pressure [Pa gauge].
    minimum_pa, maximum_pa : ndarray (n_u,)
        Range of pressures [Pa gauge].

    Returns
    -------
    float
        Elongation within [-0.3, 0.6]; the nearer end if no elongation in this range requires this pressure.
    """
    low, high = -0.3, 0.6

    def excess(elongation: float) -> float:
        q = bent + elongation * stretch
        return mean_static_pressure(arm, fields, q, minimum_pa, maximum_pa) - mean_pa

    if excess(low) >= 0.0:
        return low
    if excess(high) <= 0.0:
        return high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)
