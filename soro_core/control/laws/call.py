"""One call of a law: what it may not return becomes an error of the model, which holds the set points."""

from __future__ import annotations

from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.control.laws.protocol import ArmBelief, Law, Preview, Terms
from soro_core.errors import ModelError, SoroError


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
    ModelError
        If the law raises any error, or gives a force of a wrong shape.
    """
    try:
        inner, desired, terms = law.step(state, belief, reference, dt)
        desired = np.asarray(desired, dtype=np.float64)
    except (SoroError, np.linalg.LinAlgError):
        raise
    except Exception as error:  # a law of another package must not end the loop
        raise ModelError(f"law {name}: {type(error).__name__}: {error}", "law") from error
    if desired.shape != belief.q.shape:
        raise ModelError(
            f"law {name} gives a force of shape {desired.shape}; allowed is {belief.q.shape}", "law"
        )
    return inner, desired, terms
