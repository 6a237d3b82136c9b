"""What is learned while something pushes: what was known before the push, and the mass until a contact."""

from __future__ import annotations

from typing import Any

import numpy as np

from soro_core.adaptation.external_force import Stage
from soro_core.adaptation.kernel.information import LearningRule
from soro_core.adaptation.learned import Learned
from soro_core.adaptation.learning.state import LearnerState
from soro_core.arrays import Array
from soro_core.frozen import replaced

# What was known is kept for between one and two of these times [s].
PAST_S = 0.2
KEPT = ("learned", "chambers", "information", "moment", "prior")


def held(
    state: LearnerState,
    stage: Stage,
    seen: tuple[Array, Array, Array],
    rule: LearningRule,
    mass_bounds: tuple[float, float],
    dt: float,
) -> LearnerState:
    """Return what is known under a force from outside: what was before it, and its mass until a contact.

    In a contact the mass is again that of before: it was no load.

    Parameters
    ----------
    state : LearnerState
    stage : {"outside force", "contact"}
    seen : tuple of ndarray (n_q,), (n_q, size), (n_q, n_q)
        Residual, regressor, and noise of the residual.
    rule : LearningRule
    mass_bounds : tuple of float
        Of the learned mass [kg].
    dt : float
        Time since the last sample [s].
    """
    if state.stage == "free" and state.past:
        was: dict[str, Any] = dict(zip(KEPT, state.past[0][1:], strict=True))
        unpushed = was["learned"].mass_kg, was["information"], seen[1]
        state = replaced(state, past=(), unpushed=unpushed, **was)
    known = np.concatenate([state.learned.theta, state.chambers])
    mass_kg, information = known[0], state.information
    if stage == "contact" and state.stage != stage and state.unpushed is not None:
        mass_kg, information, _ = state.unpushed
    elif stage == "outside force":
        mass_kg, information = _mass_alone(state, known, seen, rule, dt)
        mass_kg = float(min(max(mass_kg, mass_bounds[0]), mass_bounds[1]))
    if mass_kg != known[0]:
        theta = state.learned.theta.copy()
        theta[0] = known[0] = mass_kg
        state = replaced(state, learned=Learned(theta))
    moment = information @ (known - state.start)
    passed_s = state.passed_s + dt
    return replaced(state, stage=stage, information=information, moment=moment, passed_s=passed_s)


def _mass_alone(
    state: LearnerState, known: Array, seen: tuple[Array, Array, Array], rule: LearningRule, dt: float
) -> tuple[float, Array]:
    """Return mass [kg] and information after a sample that is to move no other value.

    The rule is that of `kernel.information` for this one number.
    """
    residual, regressor, noise = seen
    missing, by_mass = residual - regressor @ known, regressor[:, 0]
    weighed = np.linalg.solve(noise, np.column_stack([missing, by_mass]))
    large = min(float(missing @ weighed[:, 0]) / missing.size, rule.forget_factor)
    information = state.information.copy()
    moved = dt * max(large - 1.0, 0.0) * rule.walk
    column = information[0].copy()
    information -= moved / (1.0 + moved * column[0]) * np.outer(column, column)
    part = dt * 0.5 * rule.low_pass_per_s / max(1.0, large)
    information[0, 0] += part * float(by_mass @ weighed[:, 1])
    return known[0] + part * float(by_mass @ weighed[:, 0]) / information[0, 0], information
