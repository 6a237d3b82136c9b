"""Coefficients of the implicit steppers, parameters of one kernel.

Feeds kernels: the cache of soro_core._jit depends on this file too.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soro_core._jit import inner
from soro_core.arrays import Array

# Largest error of q after Newton's iteration, relative to its scale (1 for strains, 1 / L for curvatures).
# The error has a sign: with 1e-11, its sum over ten thousand midpoint steps is a drift of the energy.
TOLERANCE = 1e-13
# The same for linearly implicit steppers: a second iteration follows if the first one changes q by more.
TRUST = 1e-2
# Largest motion in a step, relative to the scale of q, for a stepper without error control.
RESOLVED = 0.1
# Damping of motion that is too fast for the step is proven for small motion only. Without this limit (1 for
# strains, 1 / L for curvatures) a stiff arm released from a loop gains energy a hundredfold.
FAR = 0.3


class Stage(NamedTuple):
    """Coefficients of one stage of a step of length h, docs/model.md (32), (33).

    The equation of motion holds for the acceleration x of the stage at

        q = q0 + h (q_v0 v0 + q_v v') + h^2 (q_a0 a0 + q_a a' + c_q x)
        v = v0 + h (v_a0 a0 + v_a a' + c_v x),

    with the state q0, v0 and the acceleration a0 at the start of the step, and the velocity v' and the
    acceleration a' of the stage before.
    """

    place: float
    """Time of the stage, as a fraction of the step."""
    span: float
    """Time since the stage before, or since the start, as a fraction of the step."""
    c_q: float
    c_v: float
    q_v0: float = 0.0
    q_v: float = 0.0
    q_a0: float = 0.0
    q_a: float = 0.0
    v_a0: float = 0.0
    v_a: float = 0.0


@inner
def stage_of(stages: Array, k: int) -> Stage:
    """Row k of `Scheme.stages`, by name."""
    c = stages[k]
    return Stage(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9])


class Scheme(NamedTuple):
    """An implicit one-step method with one or two stages.

    The new state lies on the straight line from the start through the last stage, which may be in the middle.
    """

    stages: Array
    """A `Stage` a row: first those of the method itself, then those of the rule that replaces it in a step
    that it does not resolve, (n, 10)."""
    own: int
    """How many stages are the method's own."""
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
    """A scheme whose steps gain no energy (see `balance`): its own type, so that others do not compile it."""


def scheme(
    *stages: Stage,
    fallback: tuple[Stage, ...] = (),
    start: bool = True,
    linear: bool = False,
    dissipative: bool = False,
) -> Scheme:
    """Return a scheme; all have the same types, so that the kernel is compiled once for each class.

    Parameters
    ----------
    *stages : Stage
        Stages of the method itself, one or two.
    fallback : tuple of Stage
        Stages for steps that the method does not resolve; default none, the method takes all steps.
    start, linear : bool
        As in `Scheme`; the tolerance is `TRUST` where linear, else `TOLERANCE`.
    dissipative : bool
        Whether it is a `Dissipative` one.
    """
    kind = Dissipative if dissipative else Scheme
    return kind(
        stages=np.array([*stages, *fallback], dtype=np.float64),
        own=len(stages),
        start=start,
        resolved=RESOLVED if fallback else math.inf,
        far=FAR,
        tolerance=TRUST if linear else TOLERANCE,
        linear=linear,
    )
