"""What makes one implicit stepper differ from another: a table of numbers.

Feeds kernels: the cache of soro_core._jit depends on this file too.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

# Largest error left in q by Newton's iteration, of its scale (1 for strains, 1 / L for curvatures). What is
# left has a sign: at 1e-11, ten thousands of steps of the midpoint rule add it up to a drift of the energy.
TOLERANCE = 1e-13
# The same for the linearly-implicit ones: one iteration, and another only where it moved q this far.
TRUST = 1e-2
_d = 1.0 - math.sqrt(2.0) / 2.0
_w = math.sqrt(2.0) / 4.0
# What is too fast for the step is damped by linear theory alone, and that holds for small motion: a stiff arm
# let go from a loop gained energy a hundredfold without this limit (1 for strains, 1 / L for curvatures).
FAR = 0.3
# Stages of TR-BDF2 (see `tr_bdf2`), which stands in for a step of another method too.
DAMPED = (
    [2.0 * _d, 2.0 * _d, 2.0 * _d, 0.0, _d * _d, 0.0, _d, 0.0, _d * _d, _d],
    [1.0, 1.0 - 2.0 * _d, _w + _d, _w, _d * _w, _d * _w, _w, _w, _d * _d, _d],
)


class Scheme(NamedTuple):
    """Coefficients of an implicit one-step method with one or two stages.

    A stage at the fraction `place` of the step h holds the equation of motion for the state

        v = v0 + h (v_a0 a0 + v_a a' + c_v x),
        q = q0 + h (q_v0 v0 + q_v v') + h^2 (q_a0 a0 + q_a a' + c_q x)

    with its acceleration x, the acceleration a0 at the start of the step, and v', a' of the stage before.
    The new state lies on the straight line from the start through the last stage, which may be in the middle.
    """

    stages: Array
    """place, span, q_v0, q_v, q_a0, q_a, v_a0, v_a, c_q, c_v of each stage, (n, 10); `span` is the fraction
    of the step since the stage before."""
    own: int
    """Number of stages of the method; those behind, if any, make a damped step in its place."""
    start: bool
    """Whether a0 is used; else it is only a first guess, and that of the middle of the step before."""
    resolved: float
    """Steps with a larger h^2 |x| / 4, of the scale of q, are done damped: it is how far the acceleration
    alone carries the arm in half a step."""
    far: float
    """Furthest that one step may move the arm, as the root of the summed squares of its coordinates by their
    scales; further is done in parts."""
    tolerance: float
    """Largest error left in q, of its scale."""
    linear: bool
    """One Newton iteration a stage; two in the first where fewer than two steps before give a first guess."""


class Dissipative(Scheme):
    """A scheme whose steps gain no energy (see `balance`): a type of its own, so that others compile none."""


def scheme(
    *stages: list[float],
    start: bool = True,
    resolved: float = math.inf,
    linear: bool = False,
    dissipative: bool = False,
) -> Scheme:
    """Return a scheme; all have the same types, so that the kernel is compiled once for those of a class.

    Parameters
    ----------
    *stages : list of 10 float
        As in `Scheme.stages`.
    start, resolved, linear
        As in `Scheme`; the tolerance is `TRUST` where linear, else `TOLERANCE`.
    dissipative : bool
        Whether it is a `Dissipative` one.
    """
    kind = Dissipative if dissipative else Scheme
    return kind(
        np.array([*stages, *(DAMPED if resolved < math.inf else ())], dtype=np.float64),
        len(stages),
        start,
        float(resolved),
        FAR,
        TRUST if linear else TOLERANCE,
        linear,
    )
