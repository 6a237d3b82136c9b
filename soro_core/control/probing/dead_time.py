"""The dead time of the valves, from commands and readings of the probe."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from soro_core.arrays import Array, Integers
from soro_core.control.probing.findings import FAIL, ProbeFinding

# Named above this factor of the declared time, and above it by this time: a tick more between programs [s].
_FACTOR, _BESIDE_S = 1.5, 0.006
# Dead times and lags that are tried [s].
_TRIED_S = np.arange(0.0, 0.4, 0.0025)
_LAGS_S = np.geomspace(0.005, 1.0, 12)
# The best fit within the allowed dead time must be so much worse for a longer one to be named.
_WORSE = 1.5
# Readings this long before and after a set point begins to fall [s].
_BEFORE_S, _AFTER_S = 0.03, 0.7
_LEAST_SAMPLES = 10


def judge_dead_time(
    names: Sequence[str],
    t_s: Array,
    command_pa: Array,
    reading_pa: Array,
    declared_s: float,
    between: Callable[[], None] = lambda: None,
) -> list[ProbeFinding]:
    """Return a finding if set points act later than declared: a longer lag is none.

    Parameters
    ----------
    names : sequence of str
        Chambers.
    t_s : ndarray (n,)
        Times of the samples [s].
    command_pa, reading_pa : ndarray (n, n_u)
        Set points that answered the samples, and measured pressures [Pa gauge].
    declared_s : float
        Declared time until a set point acts, transport included [s].
    between : callable
        Called after each chamber.
    """
    found = []
    for k, name in enumerate(names):
        between()
        dead_s = _dead_time_s(t_s, command_pa[:, k], reading_pa[:, k], declared_s)
        if dead_s is not None:
            found.append((dead_s, name))
    if not found:
        return []
    dead_s, name = max(found)
    which = name if len(found) == 1 else f"{len(found)} chambers, {name} last:"
    text = f"{which} set points act after {1e3 * dead_s:.0f} ms, declared: {1e3 * declared_s:.0f} ms"
    step = "state the dead time in the platform file (delay_s), or shorten the way of commands and readings"
    return [ProbeFinding(FAIL, text, step, ("a slow bus", "a long line", "a device that filters readings"))]


def _dead_time_s(t_s: Array, command_pa: Array, reading_pa: Array, declared_s: float) -> float | None:
    """Return the dead time [s] of one chamber; None where it is as declared, or cannot be told."""
    falls = np.flatnonzero(np.diff(command_pa) < 0.0)
    if not falls.size:
        return None
    begin = t_s[falls[0]]
    near = np.flatnonzero((t_s >= begin - _BEFORE_S) & (t_s <= begin + _AFTER_S))
    if near.size < _LEAST_SAMPLES:
        return None
    misfits = _misfits(t_s, command_pa, near, reading_pa[near])
    allowed = _FACTOR * declared_s + _BESIDE_S >= _TRIED_S
    best = int(np.argmin(misfits))
    late = not allowed[best] and misfits[allowed].min() > _WORSE * misfits[best]
    return float(_TRIED_S[best]) if late else None


def _misfits(t_s: Array, command_pa: Array, near: Integers, values: Array) -> Array:
    """Return the sum of squares that the best first-order lag leaves of readings, for each dead time."""
    # The lag first: the delay moves its answer. Before the first sample the set point was held.
    times, command = t_s[near], command_pa[near]
    early = times[0] - _TRIED_S[-1]
    rows = [np.full(_LAGS_S.size, command[0])]
    for k in range(1, times.size):
        share = np.exp(-(times[k] - times[k - 1]) / _LAGS_S)
        rows.append(share * rows[-1] + (1.0 - share) * command[k - 1])
    lagged = np.column_stack([rows[0], *rows])
    at = np.append(early, times)
    wanted = values - values.mean()
    found = []
    for answer in lagged:
        moved = np.interp(times[None, :] - _TRIED_S[:, None], at, answer)
        moved -= moved.mean(axis=1, keepdims=True)
        gain = moved @ wanted / np.maximum(np.sum(moved**2, axis=1), 1e-9)
        found.append(np.sum((wanted - gain[:, None] * moved) ** 2, axis=1))
    return np.asarray(np.min(found, axis=0))
