"""Keys of a controller that change while it controls: gains, adaptation, reference, narrower pressures.

The state of the controller stays: nothing that is learned is lost, and `soro_core.control.bumpless` takes the
step out of the desired force. References change by a transition, as those of a topic do.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from soro_core.config import Strict
from soro_core.control.command import ControllerState
from soro_core.control.config import ControllerConfig
from soro_core.control.controller import Controller
from soro_core.control.gains import gains_of
from soro_core.control.laws.limit_cycle import no_limit_cycle, watch_of
from soro_core.control.laws.registry import options_of
from soro_core.control.motions.references import check_configured, configured_reference
from soro_core.control.pressures.actuation import CompletePressures, complete_pressures, with_own_range
from soro_core.control.pressures.setpoints import SetpointMaker
from soro_core.control.reference.active_reference import reference_ahead
from soro_core.control.reference.trajectory import Hold, Reference
from soro_core.control.reference_feasibility import check_reach
from soro_core.errors import NEXT_CONFIGURE, ConfigError

# Keys of the reference in force, without its limits: they do not change during a transition.
MOTION = (
    "kind",
    "curvature_per_m",
    "period_s",
    "elongation",
    "choose_elongation",
    "mean_pressure_pa",
    "set_point",
    "path_m",
    "pause_s",
)
_LIVE = {
    "": ("adapt", "force", "gains", "motion", "pressures"),
    "reference": (*MOTION, "learned_elongation", "start_s", "rotation_weight_m", "tip_tolerance_m"),
    "pressures": ("minimum_pa", "maximum_pa", "rise_pa_s", "fall_pa_s"),
}


class Retuned(NamedTuple):
    """A controller with other keys, and how it goes on from the state of the first one.

    Attributes
    ----------
    controller : Controller
    state : ControllerState
    moves : bool
        Whether its configured reference is another motion.
    reference : Reference or None
        That motion from now on; None before the first tick, or where it is the same.
    """

    controller: Controller
    state: ControllerState
    moves: bool
    reference: Reference | None


def retune(
    controller: Controller,
    state: ControllerState,
    config: ControllerConfig,
    t: float,
    reach: float = 0.0,
    pressures: CompletePressures | None = None,
) -> Retuned:
    """Return a controller with other keys; the first one and its state stay as they are.

    Parameters
    ----------
    controller, state : Controller, ControllerState
        After the last tick.
    config : ControllerConfig
        The keys from now on.
    t : float
        Time of the last tick [s].
    reach : float
        As of `soro_core.control.reference_feasibility.check_reach`, for another motion; 0 for no check.
    pressures : CompletePressures, optional
        As of `Controller`.

    Raises
    ------
    ConfigError
        For a key that cannot change now, and for values that do not fit the robot.
    """
    own = with_own_range(config.pressures, controller.robot)
    new = _with_keys(controller, config, pressures or complete_pressures(own))
    moves = _moves_otherwise(controller.config, new.config)
    if moves:
        following = state.following
        start = np.zeros(new.arm.n_q) if following is None else reference_ahead(new.bounds, following, 0.0).q
        new.check_way(state.law, start)
        if reach > 0.0:
            check_reach(new, reach)
    # How far a pushed tip gives way is of the keys and gains of before.
    after = replace(state, transfer=state.transfer.start(), force=replace(state.force, yields=None))
    if config.gains != controller.config.gains:  # other gains may swing no more
        after = replace(after, limit_cycle=no_limit_cycle(new.arm.n_q))
    return Retuned(new, after, moves, _from_now(new, state, t) if moves else None)


def _with_keys(controller: Controller, config: ControllerConfig, pressures: CompletePressures) -> Controller:
    """Return a controller with other keys, for the state of the first one."""
    _check_keys(controller, config, pressures)
    new, before, pieces = copy.copy(controller), controller.config, controller.law.setting.pieces
    new.config = config
    if pressures != controller.pressures:
        new.pressures, new.setpoints = pressures, SetpointMaker(new.robot, new.fields, pressures)
        new.minimum_pa, new.maximum_pa = new.setpoints.minimum_pa, new.setpoints.maximum_pa
    if config.gains != before.gains:
        ahead_s, factors = new.pressures.preview_s, new.law.feedback_factors
        new.gains = gains_of(new.arm, new.fields, config.gains, pieces, ahead_s, factors)
    new.force_loop = new.force_loop.retuned(new.gains.k_p, config.force)
    if _moves_otherwise(before, config):
        new.configured = configured_reference(new.arm, new.bounds, config, new.pressures)
        check_configured(new.bounds, new.configured)
    setting = replace(
        new.law.setting,
        gains=new.gains,
        config=config,
        pressures=new.pressures,
        configured=new.configured,
    )
    new.law = type(new.law)(setting, options_of(config.law, config.law_options))
    new.limit_cycles = watch_of(new.law)
    return new


def _moves_otherwise(before: ControllerConfig, config: ControllerConfig) -> bool:
    if config.reference.kind == "path" and config.motion != before.motion:  # rules its speed
        return True
    return any(getattr(before.reference, name) != getattr(config.reference, name) for name in MOTION)


def _from_now(controller: Controller, state: ControllerState, t: float) -> Reference | None:
    """Return the configured reference as one that is given at time `t` [s]; None before the first tick.

    Without one the arm is held at the reference of now.
    """
    if state.following is None or state.point is None:
        return None
    return Hold(state.point.q) if controller.configured is None else controller.configured.started_at(t)


def _check_keys(controller: Controller, config: ControllerConfig, pressures: CompletePressures) -> None:
    before = controller.config
    for key, value in (*_changed(before, config), *_changed(controller.pressures, pressures, "pressures")):
        raise ConfigError("controller", key, value, f"the present value; another one {NEXT_CONFIGURE}")
    if config.gains != before.gains and controller.law.trial_loads_kg():
        allowed = f"the present ones: law {before.law} has a trial; another value {NEXT_CONFIGURE}"
        raise ConfigError("controller", "gains", config.gains.model_dump(), allowed)


def _changed(before: Strict, after: Strict, section: str = "") -> Iterator[tuple[str, object]]:
    """Yield the changed keys that cannot change now, with their new values."""
    for name in type(before).model_fields:
        old, new = getattr(before, name), getattr(after, name)
        if old == new or name in _LIVE[section]:
            continue
        if not section and name in _LIVE:
            yield from _changed(old, new, name)
        else:
            yield f"{section}.{name}".lstrip("."), new
