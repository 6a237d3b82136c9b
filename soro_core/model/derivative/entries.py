"""Entry points of the derivatives from Python: short compiled functions on an arm and a room in boxes."""

from __future__ import annotations

from soro_core._box import Box, view
from soro_core._jit import entry, kernel
from soro_core.arrays import Array
from soro_core.model.derivative import equation
from soro_core.model.derivative.work import derivative_workspace


@kernel
def make_derivative_box(box: Box) -> Box:
    """Return the workspace for the arm in `box`."""
    return Box(derivative_workspace(view(box).tables))


@entry
def acceleration_derivatives(
    box: Box,
    room: Box,
    pressure: Array,
    wrench: Array,
    q: Array,
    qd: Array,
    a: Array,
    by_q: Array,
    by_qd: Array,
    by_p: Array,
) -> int:
    """Fill the derivatives of the acceleration `a` that the forward dynamics give there; gives a code.

    by_q, by_qd (n_q, n_q), by_p (n_q, n_u).
    """
    d = view(room)
    equation.equation_derivatives(view(box).tables, d, pressure, wrench, q, qd, a)
    return equation.acceleration_derivatives(d, by_q, by_qd, by_p)
