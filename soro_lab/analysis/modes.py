"""Natural frequencies and shapes of small motions about a rest, docs/analysis.md (4) to (8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.model import SoftArm
from soro_core.robot.coordinates import strain_fields
from soro_lab.analysis.stiffness import tip_jacobian

# Frequencies this close, relative, are one: any rotation of their shapes is a mode as well.
SAME = 1e-6
# Velocity of the difference quotient for dampers of contact and of a held tip [1/s or 1/(m s)].
_STEP = 1e-6
# Imaginary part of an oscillation, relative to the size of its eigenvalue.
_OSCILLATES = 1e-9


@dataclass(frozen=True)
class LinearisedModes:
    """Modes of small motions about a rest, the slowest first.

    Attributes
    ----------
    frequency_hz : ndarray (n_q,)
        Without losses.
    damped_hz : ndarray (n_q,)
        With losses and creep; 0 of a mode that does not swing.
    damping_ratio : ndarray (n_q,)
        -Re / |.| of its eigenvalue; 1 of a mode that does not swing.
    shapes : ndarray (n_q, n_q)
        Columns, with shapes.T @ M @ shapes = 1.
    tip_share : ndarray (n_q,)
        Part of the compliance of the tip that each mode has; their sum is 1.
    strain_share : ndarray (n_q, n_fields)
        Part of each strain field in the mean square of the strains of each mode; the sum of a row is 1.
    """

    frequency_hz: Array
    damped_hz: Array
    damping_ratio: Array
    shapes: Array
    tip_share: Array
    strain_share: Array

    def dominant(self, count: int) -> list[int]:
        """Numbers of the modes with most of the compliance of the tip, the slowest first."""
        # A margin keeps the slower of two equal modes first.
        order = sorted(range(len(self.tip_share)), key=lambda k: (-round(float(self.tip_share[k]), 6), k))
        return sorted(order[:count])


def modes(arm: SoftArm, q: Array, stiffness: Array) -> LinearisedModes:
    """Return the modes about an equilibrium.

    Parameters
    ----------
    arm : SoftArm
    q : ndarray (n_q,)
        Stable equilibrium.
    stiffness : ndarray (n_q, n_q)
        `tangent_stiffness` there.

    Raises
    ------
    ModelError
        If the equilibrium is unstable.
    """
    inertia = arm.inertia_matrix(q)
    squares, shapes = eigh(stiffness, inertia)
    if squares[0] <= 0.0:
        raise ModelError(
            f"modes of {arm.robot.name} about an unstable equilibrium; allowed is a stable one", "q"
        )
    shapes = _aligned(squares, shapes, inertia)
    tip = tip_jacobian(arm, q) @ shapes
    compliance = np.sum(tip**2, axis=0) / squares
    damped_hz, ratio = _damped(arm, q, stiffness, inertia, shapes)
    return LinearisedModes(
        np.sqrt(squares) / (2.0 * np.pi),
        damped_hz,
        ratio,
        shapes,
        compliance / compliance.sum(),
        _strain_share(arm, shapes),
    )


def _aligned(squares: Array, shapes: Array, inertia: Array) -> Array:
    """Shapes, those of equal frequencies turned so that the first has all of a coordinate."""
    shapes, first, n = shapes.copy(), 0, len(squares)
    unit = np.sqrt(np.diag(inertia))
    while first < n:
        behind = first + 1
        while behind < n and squares[behind] <= (1.0 + SAME) * squares[first]:
            behind += 1
        for k in range(first, behind - 1):
            part = shapes[:, k:behind]
            size = unit * np.linalg.norm(part, axis=1)
            row = int(np.flatnonzero(size >= 0.999 * size.max())[0])
            turn = np.linalg.qr(part[row][:, None], mode="complete")[0]
            shapes[:, k:behind] = part @ turn
        first = behind
    largest = shapes[np.argmax(np.abs(shapes), axis=0), range(n)]
    return np.asarray(shapes * np.sign(largest))


def _damped(arm: SoftArm, q: Array, stiffness: Array, inertia: Array, shapes: Array) -> tuple[Array, Array]:
    """Frequency [Hz] and damping ratio of each shape, from the linearised first-order system."""
    n = arm.n_q
    values, vectors = np.linalg.eig(first_order(arm, q, stiffness, inertia))
    swings = values.imag > _OSCILLATES * np.abs(values)
    damped_hz, ratio = np.zeros(n), np.ones(n)
    if swings.any():
        found, motion = values[swings], vectors[:n, swings]
        overlap = np.abs(shapes.T @ inertia @ motion) ** 2
        overlap /= np.einsum("ak,ab,bk->k", motion.conj(), inertia, motion).real
        rows, columns = linear_sum_assignment(-overlap)
        damped_hz[rows] = found.imag[columns] / (2.0 * np.pi)
        ratio[rows] = -found.real[columns] / np.abs(found[columns])
    return damped_hz, ratio


def first_order(arm: SoftArm, q: Array, stiffness: Array, inertia: Array) -> Array:
    """Matrix of the linearised system of (q, qd, internal states) about an equilibrium.

    Parameters
    ----------
    arm : SoftArm
    q : ndarray (n_q,)
        Equilibrium.
    stiffness, inertia : ndarray (n_q, n_q)
        `tangent_stiffness` and the inertia matrix there.

    Returns
    -------
    ndarray (2 n_q + n_internal, 2 n_q + n_internal)
    """
    n, n_z = arm.n_q, arm.n_internal
    none, one, states = np.zeros(n), np.eye(n), np.eye(n_z)
    # Rates and forces of the internal states are linear where these are 0.
    force_by_z = np.reshape([arm.internal_force(q, z) for z in states], (n_z, n)).T
    rate_by_v = np.reshape([arm.internal_rate(q, v, np.zeros(n_z)) for v in one], (n, n_z)).T
    rate_by_z = np.reshape([arm.internal_rate(q, none, z) for z in states], (n_z, n_z)).T
    force = np.hstack([-stiffness, -_damping(arm, q), -force_by_z])
    return np.vstack(
        [
            np.hstack([np.zeros((n, n)), one, np.zeros((n, n_z))]),
            np.linalg.solve(inertia, force),
            np.hstack([np.zeros((n_z, n)), rate_by_v, rate_by_z]),
        ]
    )


def _damping(arm: SoftArm, q: Array) -> Array:
    """Derivative (n_q, n_q) of all losses by the rates, at rest."""
    matrix = arm.damping_matrix()
    if arm.robot.contacts is None and arm.robot.tip_constraint is None:
        return matrix
    steps = _STEP * np.eye(arm.n_q)
    slopes = [
        (arm.external_forces(q, -v).generalised - arm.external_forces(q, v).generalised) / (2.0 * _STEP)
        for v in steps
    ]
    return np.asarray(matrix + np.stack(slopes, axis=1))


def _strain_share(arm: SoftArm, shapes: Array) -> Array:
    """Mean squares of the strain fields, curvatures times the length of their link, as parts of their sum."""
    fields = strain_fields(arm.robot)
    scale = np.where(fields.stretch, 1.0, fields.length)
    scaled = shapes * scale[:, None]
    squares = scaled * (fields.weight @ scaled)
    squares = np.add.reduceat(squares * fields.length[:, None], fields.first, axis=0).T
    return np.asarray(squares / squares.sum(axis=1, keepdims=True))
