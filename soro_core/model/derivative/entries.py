"""Entry points of the derivatives from Python: short compiled functions on an arm and a room in boxes."""

from __future__ import annotations

from soro_core._box import Box, view
from soro_core._jit import entry, kernel
from soro_core.arrays import Array
from soro_core.model.derivative import equation
from soro_core.model.derivative.work import derivative_workspace
from soro_core.model.records import Motion


@kernel
def make_derivative_box(box: Box) -> Box:
    """Return the workspace for the arm in `box`."""
    return Box(derivative_workspace(view(box).tables))


@entry
def acceleration_derivatives(
    box: Box,
    room: Box,
    motion: tuple[Array, Array, Array],
    pressure: Array,
    wrench: Array,
    by: tuple[Array, Array, Array],
) -> int:
    """Fill the derivatives of the acceleration a that the forward dynamics give there; gives a code.

    `motion`: q, qd and a, (n_q,). `by` q, qd (n_q, n_q) and pressure (n_q, n_u).
    """
    d = view(room)
    q, qd, a = motion
    equation.equation_derivatives(view(box).tables, d, pressure, wrench, Motion(q, qd, qd, a))
    return equation.acceleration_derivatives(d, by[0], by[1], by[2])
