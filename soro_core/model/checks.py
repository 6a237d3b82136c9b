"""Shapes and values that callers hand to the model."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soro_core.errors import ModelError
from soro_core.model import dynamics, entries
from soro_core.robot import Robot

Array: TypeAlias = NDArray[np.float64]

REASONS = {
    dynamics.NOT_FINITE: "a coordinate or velocity is not finite",
    dynamics.COLLAPSED: "an elongation is -1 or less: a link would be compressed to nothing",
    dynamics.SINGULAR: "the inertia matrix is not positive definite at this state",
    dynamics.NOT_CONVERGED: "Newton's iteration did not converge",
    dynamics.BAD_INPUT: "a pressure or wrench is not finite",
}


def shaped(values: ArrayLike, shape: tuple[int, ...], name: str, whose: str) -> Array:
    """Return a copy of the values as an array of that shape.

    A copy, so that kernels never see a read-only or strided array (each would be compiled for anew).

    Raises
    ------
    ModelError
        If they are no numbers, or of another shape.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        count = " x ".join(str(n) for n in shape)
        raise ModelError(f"{name}: got {values!r}, allowed are {count} numbers") from None
    if array.shape != shape:
        raise ModelError(f"{name} has shape {array.shape}, allowed is {shape} for {whose}")
    return array


def finite(array: Array, name: str) -> Array:
    """Return the array (one axis), all of it finite.

    Raises
    ------
    ModelError
        If it is not.
    """
    if not entries.finite(array):
        raise ModelError(f"{name} is not finite: {array}")
    return array


def flat_wrench(robot: Robot, wrench: ArrayLike | None) -> Array:
    """Numbers of all wrenches as the kernels want them: that at the tip, then one for each place.

    Raises
    ------
    ModelError
        If the shape is not (6,) or, with `wrench_places`, (n_wrenches, 6).
    """
    n = len(robot.wrench_places)
    flat = np.zeros(6 * (1 + n))
    if wrench is not None:
        flat[6 if n else 0 :] = shaped(wrench, (n, 6) if n else (6,), "wrench", robot.name).ravel()
    return flat


def refuse_unsupported(robot: Robot, method: str) -> None:
    """Refuse what the method `mde` does not have.

    Raises
    ------
    ModelError
        One line that names the key.
    """
    for key in ("point_masses", "wrench_places", "contacts", "tip_constraint"):
        if method == "mde" and getattr(robot, key):
            raise ModelError(f"{robot.name}: method 'mde' has no {key}; allowed is method 'exact'")
