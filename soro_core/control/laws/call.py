"""One call of a law: what it may not return becomes an error of the model, which holds the set points."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from soro_core.arrays import Array, all_finite
from soro_core.control.laws.guard import LawError
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
        If the law raises any error, or gives a force or, from outside, terms of a wrong shape or not finite.
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
    if not all_finite(desired):
        raise LawError(name, "its force is not finite")
    if law.is_from_outside:
        terms = _checked_terms(name, terms, belief.q.shape)
    return inner, desired, terms


def _checked_terms(name: str, terms: Any, shape: tuple[int, ...]) -> Terms:
    allowed = f"allowed are arrays of the shape {shape} by name"
    if not isinstance(terms, Mapping):
        raise LawError(name, f"its terms are of the type {type(terms).__name__}; {allowed}")
    found: dict[str, Array] = {}
    for term, value in terms.items():
        try:
            found[term] = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise LawError(
                name, f"its term {term!r} is of the type {type(value).__name__}; {allowed}"
            ) from None
        if not isinstance(term, str) or found[term].shape != shape:
            raise LawError(name, f"its term {term!r} has the shape {found[term].shape}; {allowed}")
        if not np.isfinite(found[term]).all():
            raise LawError(name, f"its term {term!r} is not finite")
    return found


def _check_numbers(name: str, method: str, found: Any) -> None:
    if not isinstance(found, Mapping):
        raise LawError(
            name, f"its {method} are of the type {type(found).__name__}; allowed are numbers by name"
        )
    for key, value in found.items():
        if not isinstance(key, str) or np.shape(value) or np.asarray(value).dtype.kind not in "fiu":
            raise LawError(name, f"its {method} have {key!r}: {value!r}; allowed are numbers by name")


def try_law(law: Law[Any], tick: Callable[[], tuple[object, Any]], q: Array) -> None:
    """Call what the loop and the plan of a motion call of a law from outside, before anything moves.

    Parameters
    ----------
    law : Law
    tick : callable
        A tick of the loop; returns the state after it and its `Command`.
    q : ndarray (n_q,)
        Coordinates.

    Raises
    ------
    LawError
        If the law fails in one of them, or the tick has no command.
    """
    if not law.is_from_outside:
        return
    state, rest = law.initial_state(), np.zeros_like(q)
    with contextlib.suppress(np.linalg.LinAlgError):
        law.reference_force(state, q, rest, rest)
    name = law.setting.config.law
    law.learned(state)
    if not isinstance(note := law.note(state), str):
        raise LawError(name, f"its note is {note!r}; allowed is text")
    for ask in (law.estimates, law.deviations, law.counts):
        _check_numbers(name, ask.__name__, ask(state))
    try:
        command = tick()[1]
    except LawError:
        raise
    except (SoroError, np.linalg.LinAlgError):  # of the model at these coordinates
        return
    except Exception as error:  # of what its other methods return
        raise LawError(name, f"{type(error).__name__}: {error}") from error
    if not command.status.ok:
        raise LawError(name, command.status.message)
    _check_numbers(name, "estimates", command.estimates)
    _check_numbers(name, "deviations", command.deviations())
