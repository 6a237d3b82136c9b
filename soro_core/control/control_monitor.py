"""Detect bad input, saturated pressures and a fallen arm while the arm is controlled."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array, all_finite
from soro_core.frozen import replaced

# A chamber with this pressure deficit [Pa] for this time [s] is named.
DEFICIT_PA, DEFICIT_S = 2e3, 0.5
# A tip this far from its reference, of the length, for this time [s]: the arm has fallen over.
FALLEN_PART, FALLEN_S = 0.5, 1.0
# Time after the start of the reference [s] from which it is judged: a loaded arm gets up before.
UPRIGHT_S = 2.0
# Time for which an event is shown [s].
_SHOWN_S = 5.0


@dataclass(frozen=True)
class ControlMonitorState:
    """State of the monitor.

    Attributes
    ----------
    run_s, away_s, deficit_s : float
        Time under control; time with the tip far away; time with a pressure deficit [s].
    fallen : bool
        Whether the arm has fallen over; it stays so until the controller starts anew.
    saturated : str
        Chambers with a pressure deficit.
    event_text, event_s : str, float
        Last event of the law, and the time since then [s].
    refused : int
        Ticks with coordinates or pressures that were not finite.
    """

    run_s: float = 0.0
    away_s: float = 0.0
    deficit_s: float = 0.0
    fallen: bool = False
    saturated: str = ""
    event_text: str = ""
    event_s: float = 0.0
    refused: int = 0

    @property
    def note(self) -> str:
        """What the user must know, or an empty string."""
        fallen = "the arm has fallen over: vented until the controller starts anew" if self.fallen else ""
        return "; ".join(text for text in (fallen, self.saturated, self.event_text) if text)


def update_monitor(
    state: ControlMonitorState,
    away: float,
    missing_pa: Array,
    names: Sequence[str],
    event: str,
    start_s: float,
    dt: float,
) -> ControlMonitorState:
    """Return the state after a tick.

    Parameters
    ----------
    state : ControlMonitorState
        After the last tick.
    away : float
        Distance of the tip from its reference, part of the arm's length.
    missing_pa : ndarray (n_u,)
        Pressure beyond its bound that the desired force needs of each chamber, negative below [Pa].
    names : sequence of str
        Of the chambers.
    event : str
        What the law says of this tick.
    start_s : float
        Duration of the start of the reference [s].
    dt : float
        Time since the last tick [s].
    """
    run_s = state.run_s + dt
    upright = run_s > start_s + UPRIGHT_S
    # An arm that swings on the ground comes near its reference again and again.
    away_s = state.away_s + dt if upright and away > FALLEN_PART else max(state.away_s - 0.5 * dt, 0.0)
    short = np.abs(missing_pa) > DEFICIT_PA
    deficit_s = state.deficit_s + dt if any(short.tolist()) else 0.0
    saturated = ""
    if deficit_s > DEFICIT_S:
        # A text that changes with each tick would be a message each tick.
        saturated = state.saturated or f"pressure saturated: {deficit_text(names, missing_pa)}"
    event_text, event_s = (event, 0.0) if event else (state.event_text, state.event_s + dt)
    return replaced(
        state,
        run_s=run_s,
        away_s=away_s,
        deficit_s=deficit_s,
        fallen=state.fallen or away_s > FALLEN_S,
        saturated=saturated,
        event_text=event_text if event_s < _SHOWN_S else "",
        event_s=event_s,
    )


def input_error(q: Array, qd: Array, t: float, dt: float, n: int) -> str:
    """Return why the input of a tick is refused, or an empty string.

    Parameters
    ----------
    q, qd : ndarray (n,)
        Coordinates and their rates.
    t, dt : float
        Time and time since the last tick [s].
    n : int
        Number of coordinates of the arm.

    Returns
    -------
    str
    """
    if np.shape(q) != (n,) or np.shape(qd) != (n,):
        return f"state of shape {np.shape(q)}, {np.shape(qd)} instead of ({n},)"
    if not (all_finite(q) and all_finite(qd)):
        return "state is not finite"
    if not (math.isfinite(t) and math.isfinite(dt) and dt > 0.0):
        return f"time {t} s with step {dt} s"
    return ""


def deficit_text(names: Sequence[str], missing_pa: Array) -> str:
    """Return which chambers need pressures beyond their range; empty if none does.

    Parameters
    ----------
    names : sequence of str
        Of the chambers.
    missing_pa : ndarray (n_u,)
        Pressure beyond its bound, negative below [Pa].
    """
    return ", ".join(
        f"{name} needs {1e-3 * abs(missing):.0f} kPa {'more than' if missing > 0.0 else 'below'} its limit"
        for name, missing in zip(names, missing_pa.tolist(), strict=True)
        if abs(missing) > DEFICIT_PA
    )
