"""What is kept of a force from outside between two estimates."""

from __future__ import annotations

import math
from typing import NamedTuple

from soro_core.adaptation.external_force import ExternalForce
from soro_core.arrays import Array
from soro_core.estimation.force.average import Average
from soro_core.estimation.force.before import Before, Reading
from soro_core.estimation.force.hold import TipHold
from soro_core.estimation.force.stage import StageState
from soro_core.estimation.force.tip_balance import Measured, TipBalance


class Seen(NamedTuple):
    """One position of a place of the arm, and what the arm did then.

    Attributes
    ----------
    stamp_s : float
        When [s].
    position : ndarray (3,)
        [m].
    pressure_pa : ndarray (n_u,)
        Measured pressures [Pa gauge].
    q, qd : ndarray (n_q,)
        Estimated coordinates and rates.
    internal : ndarray (n_internal,)
        Creep and hysteresis states.
    """

    stamp_s: float
    position: Array
    pressure_pa: Array
    q: Array
    qd: Array
    internal: Array


class ForceState(NamedTuple):
    """What is kept between two estimates.

    Attributes
    ----------
    due_s : float
        When the next estimate is due [s].
    last : Seen or None
        The newest position that is used; None before the first.
    place : float
        Where it was, along the whole arm [m].
    passed_s : float
        Time since the low-pass began [s].
    interval_s : float
        Mean time between two positions [s].
    scatter : float
        Mean square of one coordinate of the noise of positions, as they show it [m^2].
    step : ndarray (3,) or None
        The last velocity between two positions [m/s].
    measured : Measured or None
        All behind the low-pass; None before the first position.
    q : ndarray (n_q,) or None
        Estimated coordinates behind it.
    balance : TipBalance or None
    average, of_any : Average or None
        That of its force, as of a push; and the same as of a push or a load.
    past : tuple of `Before`
        What was known up to 0.4 s before now, or before the present force from outside, oldest first.
    speed : ndarray (3,) or None
        Velocity of the tip behind a slow low-pass [m/s].
    acceleration : float
        That of the tip [m/s^2].
    stage : StageState
    held : TipHold or None
        What holds the arm from outside, for the filter; None while it is free.
    external : ExternalForce or None
        The estimate; None before the first.
    reading : Reading or None
        What was known before the present force, read for the arm that it bends; None while it is free.
    """

    due_s: float = -math.inf
    last: Seen | None = None
    place: float = 0.0
    passed_s: float = 0.0
    interval_s: float = 0.0
    scatter: float = 0.0
    step: Array | None = None
    measured: Measured | None = None
    q: Array | None = None
    balance: TipBalance | None = None
    average: Average | None = None
    of_any: Average | None = None
    past: tuple[Before, ...] = ()
    speed: Array | None = None
    acceleration: float = 0.0
    stage: StageState = StageState()
    held: TipHold | None = None
    external: ExternalForce | None = None
    reading: Reading | None = None

    def begun_anew(self, due_s: float) -> ForceState:
        """Return the state without an estimate; what was touched, and the sensor, may be the same."""
        return ForceState(due_s=due_s, stage=self.stage, scatter=self.scatter)
