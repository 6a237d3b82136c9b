"""References that others give: trajectories and poses of the tip, checked against one arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.control.command import ControllerState
from soro_core.control.config import ControllerConfig
from soro_core.control.force.force_loop import ForceLoop
from soro_core.control.force.press import Press
from soro_core.control.force.press_checks import LARGEST_N, check_cap, check_force
from soro_core.control.laws.protocol import Law
from soro_core.control.motions.learned_elongation import ElongationChoice
from soro_core.control.motions.lookout import Lookout, keep_clear
from soro_core.control.motions.motion import Planner
from soro_core.control.motions.pressure_feasibility import pressure_supply
from soro_core.control.motions.references import key_of, tip_reference, trajectory_reference
from soro_core.control.motions.resting_shape import resting_shape
from soro_core.control.nonuniform_strain import NonuniformStrain
from soro_core.control.pressures.setpoints import SetpointMaker
from soro_core.control.reference.active_reference import ActiveReference, blended, reference_ahead
from soro_core.control.reference.reference_transition import Bounds
from soro_core.control.reference.trajectory import Circle, Hold, Reference
from soro_core.control.reference.underactuation import UnderactuatedReference
from soro_core.errors import ConfigError
from soro_core.model import SoftArm
from soro_core.planning.motion_error import MotionError
from soro_core.planning.obstacles import Obstacles
from soro_core.planning.steps import finished
from soro_core.robot import Robot
from soro_core.robot.coordinates import StrainFields

# Slices of a look within one tick, 0.3 ms each: commands that are later than 100 ms vent the arm.
_MOST_SLICES = 120
_TOO_LONG = "more than one tick can look at for obstacles"
_SHORTER = "some 50 points; or a path (soro move, arm/reference/path), which is looked at between the ticks"


class GivenReferences:
    """Makes references of one arm.

    Attributes
    ----------
    arm, robot : SoftArm, Robot
        Discretised model and its robot.
    fields : StrainFields
        Its strains.
    config : ControllerConfig
    bounds : Bounds
        Limits of references.
    limit : ndarray (n_q,)
        Largest absolute strain.
    obstacles : Obstacles or None
        What the robot file knows around the arm.
    nonuniform : NonuniformStrain or None
        The non-uniform strain of the arm without contact, where there are obstacles and it has one.
    law : Law
    underactuated : UnderactuatedReference
    configured : Reference or None
        The configured reference; None to hold the arm where it is.
    force_loop : ForceLoop
    setpoints : SetpointMaker
    """

    arm: SoftArm
    robot: Robot
    fields: StrainFields
    config: ControllerConfig
    bounds: Bounds
    limit: Array
    obstacles: Obstacles | None
    nonuniform: NonuniformStrain | None
    law: Law[Any]
    underactuated: UnderactuatedReference
    configured: Reference | None
    force_loop: ForceLoop
    setpoints: SetpointMaker
    initial_state: Callable[[], ControllerState]

    def trajectory(
        self,
        t: float,
        names: Sequence[str],
        times_s: Sequence[float],
        positions: Array | Sequence[Sequence[float]],
        velocities: Array | Sequence[Sequence[float]] | None = None,
        accelerations: Array | Sequence[Sequence[float]] | None = None,
        stamp_ns: int = 0,
        state: ControllerState | None = None,
    ) -> Reference:
        """Return a reference from a JointTrajectory that starts at `t` [s].

        Parameters
        ----------
        t : float
            Time of the start [s].
        names, times_s, positions, velocities, accelerations, stamp_ns : as in `trajectory_reference`
        state : ControllerState or None
            Its reference is where the arm begins; None: straight, with nothing learned.

        Returns
        -------
        Reference

        Raises
        ------
        ConfigError
            If names, times or numbers are wrong, a strain or a rate is beyond `bounds`, or the arm meets an
            obstacle.
        """
        found = trajectory_reference(
            self.bounds,
            self.robot.coordinate_names,
            names,
            times_s,
            positions,
            velocities,
            accelerations,
            start_s=t,
            stamp_ns=stamp_ns,
        )
        self._keep_clear(state or self.initial_state(), found)
        return found

    def tip(self, state: ControllerState, position: Array, quaternion: Array | None = None) -> Reference:
        """Return a set point that brings the tip to a pose.

        Parameters
        ----------
        state : ControllerState
            The search starts at its reference.
        position : ndarray (3,)
            Position of the tip in the world frame [m].
        quaternion : ndarray (4,), optional
            Orientation (x, y, z, w), weighted with `reference.rotation_weight_m`.

        Returns
        -------
        Reference

        Raises
        ------
        ConfigError
            If a number is not finite, the arm misses the position by more than the configured tolerance, or
            meets an obstacle on the way.
        """
        # From the reference in force, so that neighbouring poses get neighbouring coordinates.
        start = np.zeros(self.arm.n_q) if state.following is None else state.following.transition.at.q
        found = tip_reference(
            self.arm, self.fields, self.config.reference, self.limit, start, position, quaternion
        )
        self._keep_clear(state, found)
        return found

    def configured_press(self, state: ControllerState, t: float) -> Reference | None:
        """Return the configured press at time `t` [s]; None where there is none yet, or no estimate."""
        settings, force = self.config.reference, state.force
        if not any(settings.press_n) or t < settings.press_s:
            return None
        if force.press is not None:  # goes on, also without an estimate: the tip stops there
            return force.press
        return None if force.felt is None or force.refusal else self.press(state, settings.press_n)

    def rechosen_circle(
        self, state: ControllerState, t: float, dt: float
    ) -> tuple[ElongationChoice, ActiveReference | None]:
        """Return the choice of the circle's elongation by what is learned, and the reference after it.

        Parameters
        ----------
        state : ControllerState
            After the last tick.
        t, dt : float
            Time, and time since the last tick [s].
        """
        settings, following = self.config.reference, state.following
        choice = (state.elongation or ElongationChoice()).later(dt, bool(state.watch.saturated))
        if following is None or self.obstacles is not None:  # another circle may meet one
            return choice, following
        own, now = self.configured, following.wanted
        if not (isinstance(own, Circle) and isinstance(now, Circle)):
            return choice, following
        if state.watch.run_s <= settings.start_s or not choice.is_due(
            max(settings.start_s, settings.period_s)
        ):
            return choice, following
        may = settings.choose_elongation and settings.learned_elongation
        differs = self.law.differing(state.law) if may else ""
        supply = pressure_supply(self.law, state.law, state.creep, self.setpoints)
        choice, circle = choice.renewed(supply, settings, own, now, differs)
        if circle is not now:
            following = blended(following, circle, t - dt, settings.start_s)
        return choice, following

    def configured_tip(self, choice: ElongationChoice, following: ActiveReference, t: float) -> Array | None:
        """Return the pose (4, 4) of the tip on the configured circle at time `t` [s].

        Parameters
        ----------
        choice : ElongationChoice
        following : ActiveReference
            After this tick. Where it has no circle, or that one, the pose is at its reference.
        t : float
            Time [s].

        Returns
        -------
        ndarray (4, 4) or None
            None until another elongation has been chosen.
        """
        if choice.circle is None:
            return None
        if not choice.is_followed(following) or self.configured is None:
            return self.arm.pose(reference_ahead(self.bounds, following, 0.0).q, self.arm.length)
        own = self.configured.started_at(choice.circle.start_s)
        return self.arm.pose(own.sample(t).q, self.arm.length)

    def press(self, state: ControllerState, force_n: Array | Sequence[float]) -> Reference:
        """Return a reference that presses with a force; of 0 one that releases, and returns.

        Parameters
        ----------
        state : ControllerState
            The tip presses from where its reference is; one that presses goes on from where it began.
        force_n : ndarray (3,)
            Force of the arm on what it meets, in the world [N]. Its direction is the way of the tip.

        Returns
        -------
        Reference

        Raises
        ------
        ConfigError
            If a number is not finite, there is nothing to release, or no force that is estimated, the force
            is beyond the cap or what pressures can make, or the cap below the friction of the arm.
        """
        push = np.asarray(force_n, dtype=np.float64)
        if push.shape != (3,) or not np.all(np.abs(push) <= LARGEST_N):  # what is not finite is not less
            allowed = f"three finite numbers, from {-LARGEST_N:g} to {LARGEST_N:g} N"
            raise ConfigError("press", "force", push.tolist(), allowed)
        config, size, before = self.config.force, float(np.linalg.norm(push)), state.force.press
        if size == 0.0:
            if before is None:
                allowed = "a force above 0; 0 releases, and nothing is pressed"
                raise ConfigError("press", "force", "0 N", allowed)
            return Hold(before.q)
        stiffness = self.force_loop.stiffness
        check_cap(stiffness, config.cap_n, self.setpoints.pressures.play_pa)
        if config.cap_n and size > config.cap_n:
            allowed = f"at most the cap, {1e3 * config.cap_n:g} mN (force.cap_n)"
            raise ConfigError("press", "force", f"{1e3 * size:g} mN", allowed)
        if size < (least := stiffness.friction(self.setpoints.pressures.play_pa)):
            allowed = f"{1e3 * least:.1f} mN or more, the friction of the arm"
            raise ConfigError("press", "force", f"{1e3 * size:g} mN", allowed)
        felt = state.force.felt
        if felt is None or state.following is None:
            raise ConfigError(
                "press", "force", "no estimate of it", "an arm in control whose tip is measured"
            )
        q = reference_ahead(self.bounds, state.following, 0.0).q if before is None else before.q
        supply = pressure_supply(self.law, state.law, state.creep, self.setpoints)
        check_force(supply, stiffness, q, push)
        if before is not None:  # it touches something perhaps, and does not begin
            return Press(q, push / size, size, before.zero_n)
        return Press(q, push / size, size, felt.force_n.copy() if config.tare else np.zeros(3))

    def planner(self, state: ControllerState, dt: float) -> Planner:
        """Return what plans motions along paths with the estimates of now; `dt` [s] of the loop."""
        lookout = partial(self.lookout, state.law)
        supply = pressure_supply(self.law, state.law, state.creep, self.setpoints)
        own = self.arm.robot.tip_mass
        load_kg = self.law.estimates(state.law).get("tip_mass", own) - own
        return Planner(supply, self.bounds, self.config, dt, lookout, load_kg)

    def lookout(self, law_state: object, start: Array) -> Lookout | None:
        """Return what looks out for the obstacles that the robot file knows; None where it knows none.

        Parameters
        ----------
        law_state : object
            State of the law, which holds the learned load.
        start : ndarray (n_q,)
            Coordinates of the reference at the begin.
        """
        if self.obstacles is None:
            return None
        shape = resting_shape(self.arm, self.law, law_state, self.underactuated, self.nonuniform)
        return Lookout(self.obstacles, shape, start)

    def _keep_clear(self, state: ControllerState, reference: Reference) -> None:
        """Refuse a reference if the arm would meet an obstacle on the way from the one in force."""
        begin = np.zeros(self.arm.n_q)
        if state.following is not None:
            begin = reference_ahead(self.bounds, state.following, 0.0).q
        lookout = self.lookout(state.law, begin)
        if lookout is not None:
            for slices, _ in enumerate(keep_clear(lookout, begin, reference)):
                if slices >= _MOST_SLICES:
                    raise MotionError("contact", "way", _TOO_LONG, _SHORTER)

    def check_way(self, law_state: object, start: Array) -> None:
        """Refuse the configured reference if the arm would meet an obstacle; parameters as in `lookout`.

        Raises
        ------
        ConfigError
            With the key of the reference, the obstacle and the place.
        """
        # Also without a reference: its kernels are compiled here, and not in the tick that looks first.
        reference, lookout = self.configured, self.lookout(law_state, start)
        if reference is None or lookout is None:
            return
        try:
            finished(keep_clear(lookout, start, reference))
        except MotionError as error:
            key = f"reference.{key_of(reference)}"
            raise ConfigError("controller", key, error.got, error.allowed) from None
