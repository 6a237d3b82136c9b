"""Whether an arm becomes empty after a vent: a chamber that keeps its pressure is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.safety.limits import Limits
from soro_core.safety.monitor_state import chamber

# Time for which chambers stay empty until the arm rests, and its recording ends [s]: the three-bellow arm
# under 20 g then moves by less than 2 mm/s, after half of it by up to 17 mm/s.
REST_S = 2.0
# A chamber that was named is empty only below this part of the limit, so that noise does not name it again.
EMPTY_AGAIN = 0.8


@dataclass(frozen=True)
class VentCheck:
    """State of a vent; arrays have one entry a chamber.

    Attributes
    ----------
    full, named : ndarray (n,) of bool
        Chambers whose last reading showed pressure, and those of them that have been named.
    start_ns : int or None
        Time of the first exchange after the vent.
    not_vented : str or None
        Which chambers have kept their pressure for too long; None again when all of them are empty.
    """

    full: Flags
    named: Flags
    start_ns: int | None = None
    not_vented: str | None = None


def initial_check(n: int) -> VentCheck:
    """Return the state of `n` chambers that have not been vented."""
    none = np.zeros(n, dtype=np.bool_)
    return VentCheck(none, none)


def watch_vent(
    limits: Limits, state: VentCheck, names: Sequence[str], reading_pa: Array, fresh: Flags, now_ns: int
) -> VentCheck:
    """Judge the readings of one exchange during a vent.

    Parameters
    ----------
    limits : Limits
        Pressure and time limits of a vent.
    state : VentCheck
        State before the exchange.
    names : sequence of str
        Names of the chambers.
    reading_pa : ndarray (n,)
        Measured pressures [Pa gauge].
    fresh : ndarray (n,) of bool
        Whether each reading was sampled in this exchange; for the others the last one counts.
    now_ns : int
        Time of the limiter's clock [ns].
    """
    start_ns = now_ns if state.start_ns is None else state.start_ns
    # No pressure is below a vacuum: an open wire, like a reading that is not a number, is no reading.
    live = fresh & (reading_pa >= limits.monitors.open_circuit_pa)
    top_pa = limits.vented_pa * (1.0 if state.not_vented is None else EMPTY_AGAIN)
    full = np.where(live, np.abs(reading_pa) >= top_pa, state.full)
    if not full.any():
        return VentCheck(full, full, start_ns)
    took_s, named, text = (now_ns - start_ns) * 1e-9, state.named, state.not_vented
    if took_s >= limits.vent_limit_s and np.any(full & ~named):
        kept = ", ".join(
            f"{chamber(names, int(n))} still at {reading_pa[n] / 1e3:.1f} kPa" for n in np.flatnonzero(full)
        )
        named, text = named | full, f"{kept} {took_s:.1f} s after the vent: open the dump valve"
    return VentCheck(full, named, start_ns, text)


def empty_since(limits: Limits, since_ns: int | None, reading_pa: Array, now_ns: int) -> int | None:
    """Return the time since which every chamber is empty [ns]; None while one has pressure, or no reading.

    Parameters
    ----------
    limits : Limits
    since_ns : int or None
        What it was before this reading.
    reading_pa : ndarray (n,)
        Measured pressures [Pa gauge].
    now_ns : int
        Their time [ns].
    """
    if not np.all(np.abs(reading_pa) < limits.vented_pa):  # false for NaN
        return None
    return now_ns if since_ns is None else since_ns
