"""Feed-forward inverse of the regulators' first-order lag, with bounds and anti-wind-up.

A regulator responds to its command c by tau p' = c - p. To make p follow a wanted w with the faster time
constant tau_f the command is c = m + (tau / tau_f) (w - m), m the pressure that the same model predicts.
Without bounds this is the lead filter (tau s + 1) / (tau_f s + 1). Clipping c to the bounds before it enters
the model is the anti-wind-up. The inverse is open-loop: it adds no feedback and so costs no stability margin,
but it amplifies noise of w by tau / tau_f, and corrects neither a dead time nor a wrong tau.
"""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array


def compensate(
    wish_pa: Array,
    model_pa: Array,
    tau_s: float,
    filter_s: float,
    minimum_pa: Array,
    maximum_pa: Array,
    bias_pa: Array | float = 0.0,
) -> Array:
    """Return the command that makes the pressures follow `wish_pa`.

    Parameters
    ----------
    wish_pa, model_pa : ndarray (n_u,)
        Desired pressures, and pressures predicted by the lag model [Pa gauge].
    tau_s, filter_s : float
        Time constants of the regulators, 0 for none, and of the compensated response [s].
    minimum_pa, maximum_pa : ndarray (n_u,)
        Bounds of the command [Pa gauge].
    bias_pa : ndarray (n_u,) or float
        What each regulator adds to its command [Pa].

    Returns
    -------
    ndarray (n_u,)
        Command [Pa gauge].
    """
    lead = max(tau_s / filter_s, 1.0)
    command = model_pa + lead * (wish_pa - model_pa) if tau_s > 0.0 else wish_pa
    return np.minimum(np.maximum(command - bias_pa, minimum_pa), maximum_pa)
