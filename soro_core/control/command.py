"""What the controller remembers between two ticks, and what it hands out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.control.adaptive import Terms
from soro_core.control.trajectory import Point, Reference

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class ControllerState:
    """What the controller remembers between two ticks.

    Attributes
    ----------
    estimate : ndarray (m,)
        Of the adapted parameters.
    setpoint_pa, model_pa : ndarray (n_u,)
        Last command, and the pressures that the lag model predicts from the commands.
    wish_pa : ndarray (n_u,)
        Last allocation: the pressures that were wished for, where the next search starts.
    internal : ndarray
        Creep and hysteresis states, integrated along the measured motion.
    source, active, point
        The reference given last (None for the configured one), the passage to it, and where it was last.
    """

    estimate: Array
    setpoint_pa: Array
    model_pa: Array
    wish_pa: Array
    internal: Array
    source: Reference | None = None
    active: Reference | None = None
    point: Point | None = None
    configured: Reference | None = None


@dataclass(frozen=True)
class ControllerStatus:
    """Whether the command follows from the law; otherwise `message` says why the last one is held."""

    ok: bool
    message: str


@dataclass(frozen=True)
class Command:
    """Result of one tick.

    Attributes
    ----------
    setpoint_pa : ndarray (n_u,)
        Set points [Pa gauge], finite and within the bounds.
    wished_force, applied_force : ndarray (n_q,)
        Generalised force of the law; force of the measured pressures, H p.
    estimates : dict
        Adapted parameters by name.
    reference : Point
        q_d, qd_d, qdd_d.
    tip_reference : ndarray (4, 4)
        Pose of the tip in q_d by the controller's own kinematics.
    saturated : ndarray of bool (n_u,)
        Chambers whose wished pressure or set point lies at a bound.
    terms : Terms or None
        The parts of the wished force; None where the command is held.
    """

    setpoint_pa: Array
    wished_force: Array
    applied_force: Array
    estimates: dict[str, float]
    reference: Point
    tip_reference: Array
    saturated: NDArray[np.bool_]
    terms: Terms | None
    status: ControllerStatus
