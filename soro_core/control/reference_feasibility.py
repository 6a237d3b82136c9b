"""Check, before the arm moves, that the available pressures can hold the configured reference."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_core.control.config import ReferenceConfig
from soro_core.control.controller import Controller
from soro_core.control.motions.motion_parts import PiecewiseMotion
from soro_core.control.motions.references import key_of
from soro_core.control.pressures.allocation import balanced_weight
from soro_core.control.reference.trajectory import Circle, Reference
from soro_core.errors import ConfigError, ModelError
from soro_core.model import SoftArm
from soro_core.model.equilibrium.rest_forces import RestForces
from soro_core.model.equilibrium.statics import equilibrium

# Points of a circle that are checked.
POINTS = 16
# Points of a path that are checked, for each of its parts.
PATH_POINTS = 4
# Part of the load that the pressures may miss and still count as exact.
_EXACT = 1e-3


def check_reach(controller: Controller, part: float) -> None:
    """Refuse a configured reference that the best pressures, at rest, miss by too much at the tip.

    Parameters
    ----------
    controller : Controller
        Its configured reference is checked.
    part : float
        Allowed distance of the tip from its reference, as a part of the arm's length.

    Raises
    ------
    ConfigError
        With the key of the reference, and the distance.
    """
    reference, settings = controller.configured, controller.config.reference
    if reference is None:  # hold: the arm stays where it is
        return
    key, times = key_of(reference), _checked(reference, settings)
    length = controller.robot.length
    distance = max(tip_distance(controller, reference.sample(float(t)).q) for t in times)
    if distance > part * length:
        name, most = controller.robot.name, 1e3 * part * length
        low, high = 1e-3 * controller.minimum_pa[0], 1e-3 * controller.maximum_pa[0]
        raise ConfigError(
            "controller",
            f"reference.{key}",
            getattr(settings, key),
            f"what {low:g} to {high:g} kPa can hold: the best of them leave the tip of "
            f"{name} {1e3 * distance:.0f} mm away; {part:.0%} of the length is {most:.0f} mm",
        )


def _checked(reference: Reference, settings: ReferenceConfig) -> Array:
    """Return the times [s] at which a reference is checked."""
    if isinstance(reference, Circle):
        return np.arange(POINTS) / POINTS * settings.period_s
    return reference.times(PATH_POINTS) if isinstance(reference, PiecewiseMotion) else np.zeros(1)


def tip_distance(controller: Controller, q: Array) -> float:
    """Return the distance [m] of the tip from that of `q`, at rest under the pressures that hold `q` best."""
    arm = controller.arm
    load = arm.gravity_force(q) + arm.elastic_force(q)
    if arm.robot.contacts is not None or arm.robot.tip_constraint is not None:
        load = load - arm.external_forces(q).generalised
    actuation = arm.actuation_matrix(q)
    maker = controller.setpoints
    weight = maker.force_weight[:, None] * balanced_weight(actuation, controller.fields)
    found = maker.allocate(actuation, load, maker.preferred_pa)
    residual = load - found.force
    # A strain that no chamber drives has no weight.
    driven = bool(np.any(weight, axis=1).all())
    if driven and np.linalg.norm(weight @ residual) <= _EXACT * np.linalg.norm(weight @ load):
        return 0.0
    rest = controller.fields.within(_rest(arm, q, residual, found.pressure_pa), controller.limit)
    length = controller.robot.length
    return float(np.linalg.norm(arm.pose(rest, length)[:3, 3] - arm.pose(q, length)[:3, 3]))


def _rest(arm: SoftArm, q: Array, residual: Array, pressure_pa: Array) -> Array:
    """Return the coordinates (n_q,) of rest near `q`, at which the force `residual` (n_q,) is missing."""
    try:
        return equilibrium(arm, pressure_pa, q)
    except ModelError:  # the search fails near buckling: use the linear stiffness instead
        stiffness = RestForces(arm, pressure_pa).stiffness(q, outside=0.0)
        return np.asarray(q - np.linalg.lstsq(stiffness, residual, rcond=None)[0])
