"""Stiffness and damping of a link from its material and round section, docs/model.md (16), (19), (20)."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array
from soro_core.robot.bases import gauss
from soro_core.robot.basis import (
    Profile,
    knots,
    mass_profile,
    mean_stiffness,
    on_pieces,
    radius_profile,
    section_profile,
    shape_integrals,
    stiffness_profile,
    strain_rows,
)
from soro_core.robot.description import Robot
from soro_core.robot.link import Link

# Of a link with sections: they leave 1e-6 of the factor for a cone whose radius halves.
_STEPS = 12
# Terms 1 / k! of exp: of the powers 12 to 15, 8 to 11, 4 to 7, 0 to 3.
_SERIES = np.array([1.0 / math.factorial(k) for k in range(16)]).reshape(4, 4)[::-1]


def link_stiffness(link: Link, factor: float | Array = 1.0) -> Array:
    """Stiffness matrix: integrals of stiffness phi_a phi_b over the undeformed length, for equal strains.

    Parameters
    ----------
    link : Link
    factor : float or array of shape (2,)
        Shear correction on EI: of bending_x and bending_y, or one for both (a row of `shear_factors`).

    Returns
    -------
    Array of shape (n_q, n_q)
        In units of the generalised force over the coordinate; zeros where k_e and k_b hold.
    """
    if link.material is None:
        return np.zeros((link.n_q, link.n_q))
    m, area, inertia = link.material, *_section(link)
    factor_x, factor_y = np.broadcast_to(factor, 2)
    return _integrated(
        link,
        {
            "torsion": m.shear_modulus * 2 * inertia,
            "bending_x": m.youngs_modulus * inertia * factor_x,
            "bending_y": m.youngs_modulus * inertia * factor_y,
            "elongation": m.youngs_modulus * area,
            "shear_x": m.shear_factor * m.shear_modulus * area,
            "shear_y": m.shear_factor * m.shear_modulus * area,
        },
        stiffness_profile,
    )


def link_damping(link: Link) -> Array:
    """Viscous damping matrix: that of the material, integrated as the stiffness, plus that given (diagonal).

    Returns
    -------
    Array of shape (n_q, n_q)
        In units of the generalised force over the rate of the coordinate.
    """
    given = np.diag(link.damping if link.damping is not None else np.zeros(link.n_q))
    if link.material is None:
        return given
    eta, area, inertia = link.material.viscosity, *_section(link)
    return given + _integrated(
        link,
        {
            "torsion": eta * 2 * inertia,
            "bending_x": 3 * eta * inertia,
            "bending_y": 3 * eta * inertia,
            "elongation": 3 * eta * area,
            "shear_x": eta * area,
            "shear_y": eta * area,
        },
        section_profile,
    )


def shear_factors(robot: Robot) -> Array:
    """Shear correction on EI of each link, shape (n_links, 2): of bending_x and of bending_y.

    In each of the two planes one factor for all links that bend in it and leave its shear out (shear_x of
    bending_x, shear_y of bending_y): with it, the first frequency of the chain as a cantilever without
    shear (rotary inertia kept, tip mass left out) is that of the Timoshenko beam [T21], docs/model.md (19).
    It is a property of the beam, whatever the shape functions.
    """
    planes = [
        tuple(_is_corrected(link, f"bending_{axis}", f"shear_{axis}") for link in robot.links)
        for axis in "xy"
    ]
    known = {plane: _plane_factors(robot, np.array(plane)) for plane in set(planes)}  # mostly both are alike
    return np.stack([known[plane] for plane in planes], axis=1)


def _plane_factors(robot: Robot, corrected: NDArray[np.bool_]) -> Array:
    factors = np.ones(len(robot.links))
    if not corrected.any():
        return factors
    bending = np.array([_bending_stiffness(link) for link in robot.links])
    shear = np.array([_shear_compliance(link) for link in robot.links])
    rigid = np.where(corrected, 0.0, shear)
    slices = [_slices(link) for link in robot.links]

    def determinant(omega: float, factor: float, compliance: Array) -> float:
        return _clamped_free(robot, slices, omega, np.where(corrected, factor, 1.0) * bending, compliance)

    slowest = _lower_bound(slices, bending, shear)
    target = slowest + _first_root(lambda more: determinant(slowest + more, 1.0, shear), 0.05 * slowest)
    # Softening the bare chain lowers its first frequency until it meets the target.
    softening = _first_root(lambda more: determinant(target, 1.0 / (1.0 + more), rigid), 0.02)
    factors[corrected] = 1.0 / (1.0 + softening)
    return factors


def _integrated(link: Link, per_length: dict[str, float], profile: Profile) -> Array:
    """Integrals of what is `per_length` at the link's radius."""
    values = np.array([per_length[name] for name in strain_rows(link)])
    return values[:, None] * shape_integrals(link, profile if link.sections else None)


def _is_corrected(link: Link, bending: str, shear: str) -> bool:
    if link.material is None or bending not in link.strains:
        return False
    wanted = link.material.shear_correction
    return shear not in link.strains if wanted is None else wanted


def _section(link: Link) -> tuple[float, float]:
    return math.pi * link.radius**2, math.pi * link.radius**4 / 4


def _bending_stiffness(link: Link) -> float:
    """EI of the section; of a law k_b at rest, per length: U = k_b beta^2 / 2 = (k_b L) kappa^2 L / 2."""
    if link.material is not None:
        return link.material.youngs_modulus * _section(link)[1]
    assert link.k_b is not None
    return (link.k_b[0] - link.k_b[1]) * link.length


def _shear_compliance(link: Link) -> float:
    if link.material is None:
        return 0.0
    return 1.0 / (link.material.shear_factor * link.material.shear_modulus * _section(link)[0])


def _slices(link: Link) -> Array:
    """Slices of a link that count as uniform: itself, where it has no sections; else two for each step.

    Columns: length, mass per length, radius; EI and shear compliance over those of the link.
    """
    rho = link.mass / link.length
    if not link.sections:
        return np.array([[link.length], [rho], [link.radius], [1.0], [1.0]])
    given = knots(link)
    each = math.ceil(_STEPS / (len(given) - 1))
    ends = np.interp(np.arange(each * (len(given) - 1) + 1) / each, np.arange(len(given)), given)
    x, size = on_pieces(ends, *gauss(2))
    stiffer = stiffness_profile(link, "bending_x", x)
    if link.material is None:
        stiffer /= mean_stiffness(link, "bending_x")
    softer = 1.0 / stiffness_profile(link, "shear_x", x)
    return np.array(
        [size * link.length, rho * mass_profile(link, x), radius_profile(link, x), stiffer, softer]
    )


def _clamped_free(
    robot: Robot, slices: list[Array], omega: float, bending: Array, compliance: Array
) -> float:
    """Determinant whose roots are the frequencies [rad/s] of the stepped Timoshenko beam, clamped at its
    base.

    State (deflection, rotation, moment, shear force), made dimensionless with the first link so that the
    determinant is well scaled.
    """
    length, stiffness = robot.length, bending[0]
    transfer = np.eye(4)
    known: dict[object, Array] = {}  # the parts of a refined robot are alike
    for parts, ei, soft in zip(slices, bending, compliance, strict=True):
        section = (parts.tobytes(), ei, soft)
        if section not in known:
            size, rho, radius, stiffer, softer = parts
            a = np.zeros((len(size), 4, 4))
            a[:, 0, 1] = 1.0
            a[:, 0, 3] = soft * softer * stiffness / length**2
            a[:, 1, 2] = stiffness / (ei * stiffer)
            a[:, 2, 1] = -rho * radius**2 / 4 * omega**2 * length**2 / stiffness
            a[:, 2, 3] = -1.0
            a[:, 3, 0] = -rho * omega**2 * length**4 / stiffness
            a *= (size / length)[:, None, None]
            known[section] = _exponential(a[0]) if len(a) == 1 else _along_steps(a[::2], a[1::2])
        transfer = known[section] @ transfer
    (a, b), (c, d) = transfer[2:, 2:].tolist()
    return float(a * d - b * c)


def _along_steps(first: Array, second: Array) -> Array:
    """Transfer of steps in turn, of fourth order [B09]: from the halves (n, 4, 4) at their Gauss points."""
    steps = _exponential(first + second + (second @ first - first @ second) / math.sqrt(3.0))
    return reduce(lambda inner, outer: np.asarray(outer @ inner), steps)


def _exponential(matrix: Array) -> Array:
    """Return exp of a small matrix, or of each of a stack, by its series; scipy takes BLAS milliseconds."""
    halvings = max(0, math.frexp(float(np.abs(matrix).sum(axis=-1).max()))[1] + 1)
    powers = np.empty((4, *matrix.shape))
    powers[0] = np.eye(matrix.shape[-1])
    powers[1] = matrix / 2.0**halvings  # of norm 1/2 at most: 16 terms leave 1e-20
    powers[2] = powers[1] @ powers[1]
    powers[3] = powers[2] @ powers[1]
    fourth = powers[2] @ powers[2]
    result: Array
    result, *lower = (_SERIES @ powers.reshape(4, -1)).reshape(powers.shape)
    for part in lower:  # Horner's rule in the fourth power
        result = result @ fourth + part
    for _ in range(halvings):
        result = result @ result
    return result


def _lower_bound(slices: list[Array], bending: Array, compliance: Array) -> float:
    """Dunkerley's bound [rad/s], a few per cent below the first frequency: 1 / omega^2 < int flexibility dm.

    The flexibility at x is the deflection there under a unit force there; of rotary inertia, the rotation
    under a unit moment. They grow along the arm by link (deflection, rotation and coupling of its base).
    """
    total = 0.0
    deflection = coupling = rotation = 0.0  # of the tip of the links so far: w/F, w/M = phi/F, phi/M
    uniform = [
        (size, rho, radius, ei * stiffer, soft * softer)
        for parts, ei, soft in zip(slices, bending, compliance, strict=True)
        for size, rho, radius, stiffer, softer in parts.T.tolist()
    ]
    for length, rho, radius, ei, soft in uniform:
        for x, weight in ((0.5 - 0.5 / math.sqrt(3), 0.5), (0.5 + 0.5 / math.sqrt(3), 0.5)):
            at = x * length
            w = deflection + 2 * at * coupling + at**2 * rotation + at**3 / (3 * ei) + at * soft
            total += weight * length * rho * (w + radius**2 / 4 * (rotation + at / ei))
        deflection += 2 * length * coupling + length**2 * rotation + length**3 / (3 * ei) + length * soft
        coupling += length * rotation + length**2 / (2 * ei)
        rotation += length / ei
    return 0.95 / math.sqrt(total)


def _first_root(function: Callable[[float], float], step: float) -> float:
    """First root above 0 of a function that is positive at 0, searched in steps; then regula falsi, Illinois.

    The import of scipy's root finders would take longer than all else of an arm.
    """
    low, at_low = 0.0, function(0.0)
    if at_low <= 0.0:
        return low
    while (at_high := function(low + step)) > 0.0:
        low, at_low = low + step, at_high
    high = low + step
    tolerance = 1e-13 * high
    while at_high != 0.0 and abs(high - low) > tolerance:
        new = high - at_high * (high - low) / (at_high - at_low)
        at_new = function(new)
        if at_new * at_high < 0.0:
            low, at_low = high, at_high
        else:
            at_low *= 0.5
        moved, high, at_high = abs(new - high), new, at_new
        if moved <= tolerance:
            break
    return high
