"""Passivity-based adaptive law (theory.md section 6; Slotine and Li) [C22, 3.1].

With e = q - q_d, qd_r = qd_d - Lambda e, s = qd - qd_r the force is

    f = M qdd_r + C qd_r + G + f_e + R qd_r + (creep and hysteresis) - K_p e - K_d s

and the estimates follow pi' = -Gamma Y' s, projected. With H p = f exactly, continuous time and the right
model structure, V = s' M s / 2 + e' K_p e / 2 + (pi - pi*)' Gamma^-1 (pi - pi*) / 2 falls at the rate
s' (K_d + R) s + e' K_p Lambda e. With sampling, the regulators' lag, saturation or a plant of another
structure there is no such proof: those cases are measured (tests/loop).

Desired compensation (Sadegh and Horowitz, 1990) takes the model's forces and Y at the reference instead. The
law above cancels the arm's own stiffness and puts K_p in its place; through 30 ms of lag and dead time that
takes away more stability than a small K_p gives back. At the reference nothing is cancelled: the error sees
the arm's own stiffness and damping and the feedback on top. The proof then needs these to outweigh the slope
of the model's forces in q, and holds near the reference only; Y carries no noise of the state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.control.parameters import ParameterSet
from soro_core.control.trajectory import Point

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class FeedbackGains:
    """K_p and K_d, (n_q, n_q), symmetric and coupling the coefficients of one strain of one link at most; and
    the diagonal of Lambda, (n_q,), one value a strain of a link: K_p Lambda must not be indefinite."""

    k_p: Array
    k_d: Array
    rate: Array


@dataclass(frozen=True)
class Terms:
    """The parts of the wished force, (n_q,) each, and what they were made from.

    `model` uses the robot file's parameters, `learnt` is what the estimates add to it, `internal` stands for
    creep and hysteresis; `wished` is their sum with the feedback. `regressor` is Y, (n_q, m).
    """

    error: Array
    s: Array
    model: Array
    learnt: Array
    internal: Array
    proportional: Array
    derivative: Array
    wished: Array
    regressor: Array


def law(
    parameters: ParameterSet,
    gains: FeedbackGains,
    estimate: Array,
    internal_force: Array,
    q: Array,
    qd: Array,
    reference: Point,
    at_reference: bool = False,
) -> Terms:
    """Return the wished generalised force and its terms.

    Parameters
    ----------
    estimate : ndarray (m,)
        Of the adapted parameters.
    internal_force : ndarray (n_q,)
        Creep and hysteresis, on the left-hand side of the dynamics.
    q, qd : ndarray (n_q,)
        State.
    at_reference : bool
        Take the model's forces and the regressor at (q_d, qd_d, qdd_d) instead of (q, qd, qd_r, qdd_r).
    """
    error = q - reference.q
    rate = reference.qd - gains.rate * error
    acceleration = reference.qdd - gains.rate * (qd - reference.qd)
    s = qd - rate
    if at_reference:
        model, regressor = parameters.model_force(reference.q, reference.qd, reference.qd, reference.qdd)
    else:
        model, regressor = parameters.model_force(q, qd, rate, acceleration)
    learnt = regressor @ (estimate - parameters.nominal)
    proportional, derivative = -(gains.k_p @ error), -(gains.k_d @ s)
    wished = model + learnt + internal_force + proportional + derivative
    return Terms(error, s, model, learnt, internal_force, proportional, derivative, wished, regressor)


def adapt(
    parameters: ParameterSet,
    estimate: Array,
    regressor: Array,
    s: Array,
    dt: float,
    dead_zone: Array | float = 0.0,
    leakage: float = 0.0,
    shortfall: Array | None = None,
) -> Array:
    """Return the estimates after `dt`: pi' = -Gamma Y' s - leakage (pi - pi_0), projected.

    Parameters
    ----------
    dead_zone : ndarray (n_q,) or float
        Components of s below it do not teach: noise would otherwise drive the estimates (robustness for a
        bound on the error instead of convergence to zero).
    shortfall : ndarray (n_q,) or None
        Wished minus made force. Estimates that would lengthen it hold: they would be wound up by an error
        that the pressures, not the parameters, cause.
    """
    heard = np.sign(s) * np.maximum(np.abs(s) - dead_zone, 0.0)
    rate = -parameters.polytope.gain * (regressor.T @ heard) - leakage * (estimate - parameters.nominal)
    if shortfall is not None:
        # The wish changes with estimate i along column i of Y.
        longer = (regressor.T @ shortfall) * rate > 0.0
        rate = np.where(longer, 0.0, rate)
    moved = estimate + dt * rate
    return parameters.polytope.project(np.where(np.isfinite(moved), moved, estimate))
