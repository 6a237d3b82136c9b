"""Feed-forward inverse of the regulators' first-order lag, with their bounds inside.

A regulator answers tau p' = c - p to its command c. To make p follow a wish w with the faster time constant
tau_f the command is c = m + (tau / tau_f) (w - m), m the pressure that the same model predicts. Without
bounds this is the lead filter (tau s + 1) / (tau_f s + 1). Cutting c to the bounds before the model sees it
is the anti-wind-up. It is an open-loop inverse: it adds no feedback and so takes no stability margin, but
noise of the wish is amplified by tau / tau_f, and a dead time or a wrong tau is not corrected.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]


def compensate(
    wish_pa: Array, model_pa: Array, tau_s: float, filter_s: float, minimum_pa: Array, maximum_pa: Array
) -> Array:
    """Return the command (n_u,) [Pa] that makes the pressures follow `wish_pa`."""
    lead = max(tau_s / filter_s, 1.0)
    command = model_pa + lead * (wish_pa - model_pa) if tau_s > 0.0 else wish_pa
    return np.minimum(np.maximum(command, minimum_pa), maximum_pa)


def advance(model_pa: Array, command_pa: Array, tau_s: float, dt: float) -> Array:
    """Return the predicted pressures (n_u,) [Pa] after `dt` with the command held (exact)."""
    if tau_s <= 0.0:
        return command_pa
    return np.asarray(command_pa + (model_pa - command_pa) * math.exp(-dt / tau_s))
