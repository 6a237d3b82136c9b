"""State of the limiter: set points, last command, monitors, latch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array, Integers
from soro_core.safety.monitor_state import MonitorState, initial_monitors
from soro_core.safety.vent_check import VentCheck, initial_check

# End of the refusal of a reset after a command that was not zero.
MUST_BE_ZERO = "the command must be zero"


class Share(NamedTuple):
    """What one of several arms behind a limiter commands: its chambers, and its last accepted command.

    Attributes
    ----------
    arm : str
        Its name, which stands before those of its chambers: ``left/link0/chamber0``.
    columns : tuple of int
        Numbers of its chambers.
    command_ns, command_stamp_ns, command_source
        As those of `SafetyState`, for this arm alone.
    """

    arm: str
    columns: tuple[int, ...]
    command_ns: int | None = None
    command_stamp_ns: int = 0
    command_source: str = ""


class SafetyState(NamedTuple):
    """State of the limiter for `n` chambers; times are nanoseconds of one clock.

    Attributes
    ----------
    setpoint_pa, command_pa : ndarray (n,)
        Set points that the exchange sends, and the last accepted command [Pa gauge].
    monitors : MonitorState
        Memory of the monitors.
    vent_check : VentCheck
        Whether the arm has become empty since the vent.
    rejected : dict of str to int
        Number of refused commands by kind.
    command_ns, command_stamp_ns : int
        Time of the last accepted command, never later than its arrival, for its age; and the time stamp of
        that command, for the order of commands.
    command_source : str
        Name of the source of that command.
    reading_ns : ndarray (n,) of int
        Time of the last fresh reading of each chamber.
    over_ns : int or None
        Time from which a pressure has been above its limit.
    cycle_ns : int or None
        Time of the last `slew`.
    cause : str or None
        Cause of the trip; None while the limiter is not latched.
    fault : str or None
        First fault that tripped the limiter, or was found while it was vented for another cause.
    standing : str or None
        Fault of the last cycle of a latched limiter; None when it is over.
    shares : tuple of Share
        Of several arms what each commands; the command of the state is then that of all, as old as the oldest
        of them. Empty for one arm.
    """

    setpoint_pa: Array
    command_pa: Array
    monitors: MonitorState
    vent_check: VentCheck
    rejected: dict[str, int]
    command_ns: int | None = None
    command_stamp_ns: int = 0
    command_source: str = ""
    reading_ns: Integers | None = None
    over_ns: int | None = None
    cycle_ns: int | None = None
    cause: str | None = None
    fault: str | None = None
    standing: str | None = None
    shares: tuple[Share, ...] = ()

    @property
    def vented(self) -> bool:
        """Whether the limiter is latched, so that the regulators must vent."""
        return self.cause is not None

    @property
    def not_vented(self) -> str | None:
        """Which chambers have kept their pressure since the vent, or None."""
        return self.vent_check.not_vented

    @property
    def kept(self) -> str | None:
        """Pressure that remains although the arm is vented, and that keeps the latch closed, or None."""
        over = "a measured pressure is still above the limit"
        return self.not_vented or (over if self.over_ns is not None else None)

    @property
    def causes(self) -> str | None:
        """Cause of the latch, and a fault that was found after a vent for another cause; or None."""
        later = None if self.fault == self.cause else self.fault
        return "; ".join(filter(None, (self.cause, later))) or None

    @property
    def complaint(self) -> str | None:
        """Causes of the latch, and the chambers that have not become empty; None if there is neither."""
        return "; ".join(filter(None, (self.causes, self.not_vented))) or None


def parts_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the arms of chambers by their names, ``left/link0/chamber0``; "" for chambers without one."""
    return tuple(dict.fromkeys(name.rpartition("/link")[0] for name in names))


def initial_state(n: int, names: Sequence[str] = ()) -> SafetyState:
    """Return the state of `n` chambers before the first command; causes use `names` if they are given."""
    monitors = initial_monitors(n, names)
    arms = [name.rpartition("/link")[0] for name in names]
    shares = tuple(
        Share(arm, tuple(k for k, other in enumerate(arms) if other == arm)) for arm in parts_of(names) if arm
    )
    return SafetyState(np.zeros(n), np.zeros(n), monitors, initial_check(n), {}, shares=shares)


def count_refusal(state: SafetyState, refusal: str) -> SafetyState:
    """Count one more refusal; the text before the colon is its kind."""
    kind = refusal.split(":", 1)[0]
    return state._replace(rejected={**state.rejected, kind: state.rejected.get(kind, 0) + 1})
