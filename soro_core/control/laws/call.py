"""One call of a law: what it may not return becomes an error of the model, which holds the set points."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.control.laws.guard import LawError, is_from_outside
from soro_core.control.laws.protocol import ArmBelief, Law, Preview, Terms
from soro_core.errors import SoroError


def call_law(
    law: Law[Any], name: str, state: Any, belief: ArmBelief, reference: Preview, dt: float
) -> tuple[Any, Array, Terms]:
    """Return state, desired force and terms of a law.

    Parameters
    ----------
    law : Law
    name : str
        Its name, for errors.
    state : object
        Its state after the last tick.
    belief : ArmBelief
    reference : Preview
    dt : float
        Time since the last tick [s].

    Raises
    ------
    LawError
        If the law raises any error, or gives a force of a wrong shape.
    """
    try:
        inner, desired, terms = law.step(state, belief, reference, dt)
        desired = np.asarray(desired, dtype=np.float64)
    except (SoroError, np.linalg.LinAlgError):
        raise
    except Exception as error:  # what it returns is no triple, or its force no array
        raise LawError(name, f"{type(error).__name__}: {error}") from error
    if desired.shape != belief.q.shape:
        raise LawError(name, f"its force has the shape {desired.shape}; allowed is {belief.q.shape}")
    return inner, desired, terms


def try_law(law: Law[Any], tick: Callable[[], object], q: Array) -> None:
    """Call what the loop and the plan of a motion call of a law from outside, before anything moves.

    Parameters
    ----------
    law : Law
    tick : callable
        A tick of the loop.
    q : ndarray (n_q,)
        Coordinates.

    Raises
    ------
    LawError
        If the law fails in one of them.
    """
    if not is_from_outside(type(law)):
        return
    state, rest = law.initial_state(), np.zeros_like(q)
    with contextlib.suppress(np.linalg.LinAlgError):
        law.reference_force(state, q, rest, rest)
    for ask in (law.estimates, law.deviations, law.learned, law.note, law.counts):
        ask(state)
    try:
        tick()
    except LawError:
        raise
    except (SoroError, np.linalg.LinAlgError):  # of the model at these coordinates
        return
