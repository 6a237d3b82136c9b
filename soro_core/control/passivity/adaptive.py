"""Passivity-based adaptive law, docs/model.md (36) to (38) [SL87].

With e = q - q_d, qd_r = qd_d - Lambda e, s = qd - qd_r the force is

    f = M qdd_r + C qd_r + G + f_e + R qd_r + (creep and hysteresis) - K_p e - K_d s

and the estimates follow pi' = -Gamma Y' s, projected. If H p = f exactly, in continuous time and with a model
of the plant's structure, V = s' M s / 2 + e' K_p e / 2 + (pi - pi*)' Gamma^-1 (pi - pi*) / 2 decreases at the
rate s' (K_d + R) s + e' K_p Lambda e. Sampling, the lag of the regulators, saturation and a plant of another
structure are outside this proof; tests/soro_core/loop measures these cases.

Desired compensation (Sadegh and Horowitz, 1990) evaluates the model's forces and Y at the reference instead.
The law above cancels the stiffness of the arm and replaces it by K_p; with 30 ms of lag and dead time, the
cancellation costs more stability than a small K_p restores. At the reference nothing is cancelled: the
stiffness and damping of the arm act on the error, and the feedback adds to them. The proof then requires that
they outweigh the slope of the model's forces in q, and holds near the reference only; Y is free of the noise
of the state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.control.passivity.parameters import ParameterSet
from soro_core.control.reference.trajectory import Point


@dataclass(frozen=True)
class FeedbackGains:
    """Feedback gains in the coordinates of the arm.

    Attributes
    ----------
    k_p, k_d : ndarray (n_q, n_q)
        K_p and K_d, symmetric; blocks couple the coefficients of one strain of one link only.
    rate : ndarray (n_q,)
        Diagonal of Lambda [1/s], one value for all coefficients of a strain of a link, so that K_p Lambda is
        not indefinite.
    """

    k_p: Array
    k_d: Array
    rate: Array


@dataclass(frozen=True)
class Terms:
    """The desired force and its terms.

    Attributes
    ----------
    error, s : ndarray (n_q,)
        e and s of docs/model.md (36).
    model : ndarray (n_q,)
        Force of the model with the parameters of the robot file.
    learnt : ndarray (n_q,)
        Y (pi - pi_0), the correction by the estimates.
    internal : ndarray (n_q,)
        Force of creep and hysteresis.
    proportional, derivative : ndarray (n_q,)
        -K_p e and -K_d s.
    desired : ndarray (n_q,)
        Sum of the five forces above.
    regressor : ndarray (n_q, m)
        Y.
    """

    error: Array
    s: Array
    model: Array
    learnt: Array
    internal: Array
    proportional: Array
    derivative: Array
    desired: Array
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
    """Return the desired generalised force and its terms, docs/model.md (36) and (37).

    Parameters
    ----------
    parameters : ParameterSet
        Model and regressor.
    gains : FeedbackGains
        K_p, K_d and Lambda.
    estimate : ndarray (m,)
        Estimates pi of the adapted parameters, each in its own unit.
    internal_force : ndarray (n_q,)
        Force of creep and hysteresis on the left-hand side of the dynamics.
    q, qd : ndarray (n_q,)
        Coordinates and their rates.
    reference : Point
        q_d, qd_d and qdd_d.
    at_reference : bool
        Evaluate the model's forces and the regressor at (q_d, qd_d, qdd_d) instead of (q, qd, qd_r, qdd_r).

    Returns
    -------
    Terms
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
    desired = model + learnt + internal_force + proportional + derivative
    return Terms(error, s, model, learnt, internal_force, proportional, derivative, desired, regressor)


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
    """Return the estimates after `dt`, docs/model.md (38): pi' = -Gamma Y' s - leakage (pi - pi_0).

    Parameters
    ----------
    parameters : ParameterSet
        Nominal values pi_0, gains Gamma and admissible set.
    estimate : ndarray (m,)
        Estimates pi at the start of the step.
    regressor : ndarray (n_q, m)
        Y.
    s : ndarray (n_q,)
        s of (36).
    dt : float
        Time step [s].
    dead_zone : ndarray (n_q,) or float
        Components of s up to this size do not change the estimates: noise would otherwise drive them. The
        error then converges to a bound instead of zero.
    leakage : float
        Rate at which the estimates return to pi_0 [1/s].
    shortfall : ndarray (n_q,) or None
        Desired minus achievable force. Estimates whose change would enlarge it are held: saturation, not the
        parameters, causes this error, and would wind them up.

    Returns
    -------
    ndarray (m,)
        Admissible estimates; an estimate that would not be finite keeps its value.
    """
    effective = np.sign(s) * np.maximum(np.abs(s) - dead_zone, 0.0)
    rate = -parameters.polytope.gain * (regressor.T @ effective) - leakage * (estimate - parameters.nominal)
    if shortfall is not None:
        # Estimate i changes the desired force along column i of Y.
        longer = np.sign(regressor.T @ shortfall) * np.sign(rate) > 0.0
        rate = np.where(longer, 0.0, rate)
    moved = estimate + dt * rate
    return parameters.polytope.project(np.where(np.isfinite(moved), moved, estimate))
