"""Shapes and values that callers hand to the model."""

from __future__ import annotations

import logging
import math
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.errors import ModelError, short
from soro_core.model import dynamics, entries
from soro_core.robot import Robot
from soro_core.robot.link import LEAST_ELONGATION

# Beyond these the tables alone take minutes.
MOST_NODES, MOST_STEPS = 500, 100_000

REASONS = {
    dynamics.NOT_FINITE: "a coordinate or velocity is not finite",
    dynamics.COLLAPSED: f"an elongation is near -1 ({LEAST_ELONGATION}, or its link's least_elongation) or"
    " beyond: a link would be compressed to nothing",
    dynamics.SINGULAR: "the inertia matrix is not positive definite at this state",
    dynamics.NOT_CONVERGED: "Newton's iteration did not converge",
    dynamics.BAD_INPUT: "a pressure or wrench is not finite",
}
# How far an input is beyond its range before it is a mistake, as a part of the range.
_NEAR = 0.05
# What `note_range` has said.
_noted: set[tuple[str, str, bytes, bytes]] = set()
_KEYS = {dynamics.COLLAPSED: "elongation", dynamics.SINGULAR: "inertia matrix"}


def number(value: object) -> float:
    """Return the value as a float; NaN, which no range holds, for what is not one number."""
    if type(value) is float:  # in most calls; to ask an abstract class takes a microsecond
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if not isinstance(value, Real) or isinstance(value, bool):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf


def require(value: object, wanted: Any, name: str, allowed: str) -> None:
    """Refuse an object of another type.

    Parameters
    ----------
    value : object
    wanted : type or union of types
    name : str
        Name of the argument, for the message.
    allowed : str
        What is allowed, for the message.

    Raises
    ------
    ModelError
        One line.
    """
    if not isinstance(value, wanted):
        raise ModelError(f"{name}: got {short(value)}; allowed: {allowed}", name)


def listed(array: Array) -> str:
    """Return numbers on one line, however many."""
    return short([float(f"{x:.6g}") for x in array])


def fault(code: int, q: Array, qd: Array) -> ModelError:
    """Return the error of a kernel's code at a state.

    Parameters
    ----------
    code : int
        A key of `REASONS`.
    q, qd : (n_q,)
        Coordinates and velocities.
    """
    key = _KEYS.get(code) or ("qd" if np.isfinite(q).all() else "q")
    return ModelError(f"{REASONS[code]} (q = {listed(q)}, qd = {listed(qd)})", key)


def dimensions(values: ArrayLike) -> int:
    """Return the number of axes, 1 for rows of different lengths, which `shaped` refuses."""
    try:
        return np.ndim(values)
    except ValueError:
        return 1


def shaped(values: ArrayLike, shape: tuple[int, ...], name: str, whose: str) -> Array:
    """Return a copy of the values as an array of that shape.

    A copy, so that kernels get no read-only or strided array, for which they would be compiled again.

    Parameters
    ----------
    values : array_like
    shape : tuple of int
    name : str
        Name of the argument, for the message.
    whose : str
        Name of the robot, for the message.

    Raises
    ------
    ModelError
        If they are not numbers, or of another shape.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        count = " x ".join(str(n) for n in shape)
        raise ModelError(
            f"{name}: got {short(values)}, allowed are {count} numbers for {whose}", name
        ) from None
    if array.shape != shape:
        raise ModelError(f"{name} has shape {array.shape}, allowed is {shape} for {whose}", name)
    return array


def finite(array: Array, name: str) -> Array:
    """Return the array (one axis), all of it finite.

    Raises
    ------
    ModelError
        If it is not.
    """
    if not entries.finite(array):
        raise ModelError(f"{name} is not finite: {listed(array)}", name)
    return array


def flat_wrench(robot: Robot, wrench: ArrayLike | None) -> Array:
    """Return all wrenches as the kernels take them: that at the tip, then one for each place.

    Raises
    ------
    ModelError
        If the shape is not (6,), of the tip or of one place, or (n_wrenches, 6) of `wrench_places`.
    """
    n = len(robot.wrench_places)
    flat = np.zeros(6 * (1 + n))
    if wrench is not None:
        is_one = n == 0 or (n == 1 and np.shape(wrench) == (6,))
        flat[6 if n else 0 :] = shaped(wrench, (6,) if is_one else (n, 6), "wrench", robot.name).ravel()
    return flat


def refuse_push(robot: Robot, inputs: Array, name: str) -> None:
    """Refuse inputs in which a tendon would push.

    Parameters
    ----------
    robot : Robot
    inputs : ndarray (..., n_u)
        Pressures [Pa], behind them tensions [N].
    name : str
        Of the argument that has them.

    Raises
    ------
    ModelError
        One line that names the tendon.
    """
    if robot.tendons:
        least = inputs[..., -len(robot.tendons) :].reshape(-1, len(robot.tendons)).min(axis=0)
        if least.min() < 0.0:
            tendon = robot.tendon_names[int(least.argmin())]
            raise ModelError(f"{name}: got {least.min():g} N of {tendon}; allowed is 0 or more", name)


def note_range(robot: Robot, inputs: Array, where: str, which: str = "") -> bool:
    """Say whether inputs are beyond the range of their robot; log it once a process, caller and arm.

    Noise of a sensor at an end of the range is not beyond it.

    Parameters
    ----------
    robot : Robot
    inputs : ndarray (n_u,) or (n, n_u)
        Pressures [Pa], behind them tensions [N].
    where : str
        Who is given them, for the message.
    which : str
        Which run, for the message.
    """
    low, high = robot.input_range
    rows = np.atleast_2d(inputs)
    beyond = np.maximum(rows - high, low - rows).max(axis=0, initial=0.0) / (high - low)
    if not (beyond > _NEAR).any():
        return False
    arm = (where, robot.name, low.tobytes(), high.tobytes())
    if arm in _noted:
        return True
    _noted.add(arm)
    u = int(np.argmax(beyond))
    worst = rows[int(np.argmax(np.abs(rows[:, u] - 0.5 * (low[u] + high[u])))), u]
    is_chamber = u < len(robot.chamber_names)
    logging.getLogger("soro_core").warning(
        "%s: %s: %s of %s has %.4g %s%s; its %s is %g to %g %s",
        where,
        "pressure" if is_chamber else "tension",
        (*robot.chamber_names, *robot.tendon_names)[u],
        robot.name,
        worst,
        "Pa" if is_chamber else "N",
        which,
        "pressure_range_pa" if is_chamber else "range of tensions",
        low[u],
        high[u],
        "Pa gauge" if is_chamber else "N (max_tension_n)",
    )
    return True


def refuse_unsupported(robot: Robot, method: object, nodes: object, steps: object) -> None:
    """Refuse what is not a robot or a method, and what a method does not have.

    Parameters
    ----------
    robot : Robot
    method : object
        Allowed are "exact" and "mde".
    nodes, steps : object
        Allowed are whole numbers, `nodes` with "exact" and `steps` with "mde", and None.

    Raises
    ------
    ModelError
        One line that names the key.
    """
    require(robot, Robot, "robot", "a Robot, from load_robot or robot_from_dict")
    if not isinstance(method, str) or method not in ("exact", "mde"):
        raise ModelError(f"method {short(method)}: allowed are exact, mde", "method")
    for name, value, owner, least, most in (
        ("nodes", nodes, "exact", 2, MOST_NODES),
        ("steps", steps, "mde", 1, MOST_STEPS),
    ):
        if value is None:
            continue
        if not isinstance(value, Integral) or isinstance(value, bool) or not least <= int(value) <= most:
            raise ModelError(
                f"{name} {short(value)}: allowed is a whole number of {least} or more, up to {most}", name
            )
        if method != owner:
            raise ModelError(
                f"{name} {short(value)}: allowed with method {owner!r} only, not with {method!r}", name
            )
    for i, link in enumerate(robot.links):
        if method == "mde" and link.sections:
            key = f"links[{i}].sections"
            raise ModelError(f"{robot.name}: method 'mde' has no {key}; allowed is method 'exact'", key)
    for key in ("point_masses", "wrench_places", "contacts", "tip_constraint"):
        if method == "mde" and getattr(robot, key):
            raise ModelError(f"{robot.name}: method 'mde' has no {key}; allowed is method 'exact'", key)


def refuse_underivable(robot: Robot, method: str) -> None:
    """Refuse what has no derivatives.

    Raises
    ------
    ModelError
        One line that names the key.
    """
    if method != "exact":
        raise ModelError(f"{robot.name}: derivatives with method {method!r}: allowed is 'exact'", "method")
    for key in ("wrench_places", "contacts", "tip_constraint"):
        if getattr(robot, key):
            raise ModelError(f"{robot.name}: derivatives with {key}: allowed is a robot without", key)
