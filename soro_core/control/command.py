"""State, status and output of the controller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soro_core.adaptation.learned import Learned
from soro_core.adaptation.regulators import ObserverState
from soro_core.arrays import Array
from soro_core.control.bumpless import BumplessTransfer
from soro_core.control.control_monitor import ControlMonitorState
from soro_core.control.force.force_state import ForceLoopState
from soro_core.control.laws.limit_cycle import LimitCycleState
from soro_core.control.laws.protocol import Terms
from soro_core.control.motions.learned_elongation import ElongationChoice
from soro_core.control.probing.procedure import ProbeState
from soro_core.control.reference.active_reference import ActiveReference
from soro_core.control.reference.trajectory import Hold, Point
from soro_core.control.reference.underactuation import UnderactuatedState
from soro_core.frozen import quick
from soro_core.model import SoftArm


@dataclass(frozen=True)
class ControllerState:
    """State of the controller between two ticks.

    Attributes
    ----------
    law : object
        State of the law.
    setpoint_pa, model_pa : ndarray (n_u,)
        Last command, and the pressures that the lag model predicts from the commands [Pa gauge].
    wish_pa : ndarray (n_u,)
        Last allocation [Pa gauge], the start of the next search.
    creep : ndarray (n_internal,)
        Creep and hysteresis states along the estimated motion.
    shape : UnderactuatedState
        Of the unactuated coordinates.
    saturated : ndarray of bool (n_u,)
        Chambers at a bound at the last tick.
    limit_cycle : LimitCycleState
        Swings of the loop, and the part of the feedback that is in force.
    force : ForceLoopState
        Of what moves the reference by the force at the tip.
    regulators : ObserverState or None
        State of the regulators' observer; None where the law has none.
    watch : ControlMonitorState
        What the user must know.
    following : ActiveReference or None
        The reference in force; None before the first tick.
    transfer : BumplessTransfer
        To the law of now from the one before a change of its keys.
    point : Point or None
        The reference at the last tick; None before the first tick.
    probe : ProbeState or None
        The probe before the law begins; None where there is none, or it is over. One that has refused stays.
    probed : str
        What the probe has found.
    elongation : ElongationChoice or None
        Choice of a circle's elongation by what is learned; None until a chamber has lacked pressure.
    """

    law: Any
    setpoint_pa: Array
    model_pa: Array
    wish_pa: Array
    creep: Array
    shape: UnderactuatedState
    saturated: NDArray[np.bool_]
    limit_cycle: LimitCycleState
    force: ForceLoopState
    regulators: ObserverState | None = None
    watch: ControlMonitorState = field(default_factory=ControlMonitorState)
    following: ActiveReference | None = None
    transfer: BumplessTransfer = field(default_factory=BumplessTransfer)
    point: Point | None = None
    probe: ProbeState | None = None
    probed: str = ""
    elongation: ElongationChoice | None = None


@quick
@dataclass(frozen=True)
class ControllerStatus:
    """Whether the law gave the command.

    Attributes
    ----------
    ok : bool
        Whether the law gave the command.
    message : str
        Why the last command is held; empty where it is not.
    note : str
        What the user must know of a command that is given.
    """

    ok: bool
    message: str
    note: str = ""


@quick
@dataclass(frozen=True)
class Command:
    """Output of one tick.

    Attributes
    ----------
    setpoint_pa : ndarray (n_u,)
        Set points [Pa gauge], finite and within the bounds.
    desired_force, applied_force : ndarray (n_q,)
        Generalised force that the law asks for; generalised force of the measured pressures.
    named : callable
        Gives what the law has learnt, by name; `estimates` calls it.
    deviations : callable
        Gives their deviations, of laws that have them; finding them takes long.
    learned : Learned or None
        The learned model for the filter.
    reference : Point
        q_d, qd_d, qdd_d.
    tip_reference : ndarray (4, 4)
        Pose of the tip in q_d by the controller's own kinematics.
    saturated : ndarray of bool (n_u,)
        Chambers whose allocated pressure or set point lies at a bound.
    terms : mapping of str to ndarray (n_q,), or None
        The terms of the desired force by name; None if the command is held.
    status : ControllerStatus
        Whether the law gave the command.
    configured_tip : ndarray (4, 4) or None
        Pose of the tip on the configured circle; None until another elongation has been chosen for it.
    """

    setpoint_pa: Array
    desired_force: Array
    applied_force: Array
    named: Callable[[], dict[str, float]]
    deviations: Callable[[], dict[str, float]]
    learned: Learned | None
    reference: Point
    tip_reference: Array
    saturated: NDArray[np.bool_]
    terms: Terms | None
    status: ControllerStatus
    configured_tip: Array | None = None

    @property
    def estimates(self) -> dict[str, float]:
        """What the law has learnt, by name."""
        return self.named()


def held_command(
    arm: SoftArm,
    state: ControllerState,
    named: Callable[[], dict[str, float]],
    learned: Learned | None,
    failure: str,
) -> Command:
    """Return the command that holds the last set points.

    Parameters
    ----------
    arm : SoftArm
        Model.
    state : ControllerState
        State after the last tick.
    named : callable
        Gives the estimates by name.
    learned : Learned or None
        The learned model.
    failure : str
        Why the law gives no command.

    Returns
    -------
    Command
    """
    point = state.point if state.point is not None else Hold(np.zeros(arm.n_q)).sample(0.0)
    return Command(
        setpoint_pa=state.setpoint_pa,
        desired_force=np.zeros(arm.n_q),
        applied_force=np.zeros(arm.n_q),
        named=named,
        deviations=dict,
        learned=learned,
        reference=point,
        tip_reference=arm.pose(point.q, arm.robot.length),
        saturated=np.zeros(arm.n_u, dtype=bool),
        terms=None,
        status=ControllerStatus(False, failure),
    )
