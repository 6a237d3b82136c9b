"""The limiter of one platform with its state, for a loop that commands pressures."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from soro_core.arrays import Array, Flags
from soro_core.config import with_changes
from soro_core.pneumatics.regulator import RegulatorModel
from soro_core.safety import limiter, shares
from soro_core.safety.limits import NARROWED, Limits
from soro_core.safety.state import SafetyState, Share, initial_state


class Limiter:
    """Limits, and the state that each call of the pure functions of `soro_core.safety.limiter` advances.

    Parameters
    ----------
    limits : Limits
        Limits of commands and readings.
    names : sequence of str
        Names of the chambers in order.
    response : RegulatorModel
        Response of the platform's regulators, with which the monitors compare the readings.

    Attributes
    ----------
    state : SafetyState
        State of limiter, monitors and latch.
    columns : slice
        Numbers of its chambers: all.
    why_stopped : callable
        Returns why an emergency stop demands a vent, or None; a loop that reads one sets it. The limiter asks
        at the begin of every cycle.
    """

    def __init__(
        self, limits: Limits, names: Sequence[str], response: RegulatorModel = limiter.TYPICAL
    ) -> None:
        self.limits, self.names, self._response = limits, tuple(names), response
        self._range, self.columns = limits, slice(None)
        self.why_stopped: Callable[[], str | None] = lambda: None
        self.state = initial_state(len(self.names), self.names)

    def of_arms(self) -> dict[str, Limiter | ArmLimiter]:
        """Return what each arm commands by its name: this limiter, as "", where there is one alone."""
        return {one.arm: ArmLimiter(self, k) for k, one in enumerate(self.state.shares)} or {"": self}

    @property
    def cause(self) -> str | None:
        """Why the limiter has vented, or None."""
        return self.state.cause

    @property
    def not_vented(self) -> str | None:
        """Which chambers have kept their pressure since the vent, or None."""
        return self.state.not_vented

    def offer(self, command_pa: Array, stamp_ns: int, now_ns: int, source: str = "command") -> str | None:
        """Accept set points and return None, or the reason of a refusal; parameters as in `limiter.offer`."""
        self.state, refusal = limiter.offer(self.limits, self.state, command_pa, stamp_ns, now_ns, source)
        return refusal

    def slew(self, now_ns: int) -> Array:
        """Begin a cycle; return the set points (n,) [Pa gauge] to send, zeros if the limiter is latched."""
        if (why := self.why_stopped()) is not None:
            self.trip(why)
        self.state = limiter.slew(self._range, self.state, now_ns)
        return self.state.setpoint_pa

    def narrow(self, limits: Limits) -> None:
        """Keep set points within the range and the rates of narrower limits, from the next cycle on.

        Commands up to the limits of the start are still accepted: a controller that does not know of the
        change would be refused, and the arm vented.

        Parameters
        ----------
        limits : Limits
            From `soro_core.safety.limits.narrowed`.
        """
        self._range = with_changes(self.limits, **{name: getattr(limits, name) for name in NARROWED})

    def doubt(self, reason: str, source: str) -> None:
        """Refuse a command of a name that two publishers may use, and hold the set points."""
        self.state = limiter.doubt(self.state, reason, source)

    def judge(
        self,
        reading_pa: Array,
        fresh: bool | Flags,
        now_ns: int,
        fault: str | None = None,
        supply_pa: Array | None = None,
    ) -> None:
        """End a cycle: judge the readings of its exchange; parameters as in `limiter.judge`."""
        self.state = limiter.judge(
            self.limits, self.state, reading_pa, fresh, now_ns, fault, supply_pa, self._response
        )

    def latch(self, cause: str) -> None:
        """Latch; the next set points are zero."""
        self.state = limiter.request_vent(self.state, cause)

    def trip(self, fault: str) -> None:
        """Latch for a fault, which is also told of a limiter that is vented for another cause."""
        self.state = limiter.trip(self.state, fault)

    def begin_anew(self) -> None:
        """Count the silence of chambers anew, after a time without cycles."""
        self.state = self.state._replace(reading_ns=None, standing=None)

    def vent(self, cause: str) -> None:
        """Latch; a limiter with a bus also sends zeros at once."""
        self.latch(cause)

    def reset(self, now_ns: Callable[[], int]) -> str | None:
        """Open the latch and return None, or return the reason of a refusal."""
        if (why := self.why_stopped()) is not None:
            return why
        self.state, refusal = limiter.reset(self.limits, self.state, now_ns())
        return refusal


class ArmLimiter:
    """The chambers of one of several arms in a limiter, whose latch they share.

    Parameters
    ----------
    whole : Limiter
    number : int
        Of the arm's `Share`.

    Attributes
    ----------
    names : tuple of str
        Names of its chambers, without that of the arm.
    columns : list of int
        Their numbers in the limiter.
    """

    def __init__(self, whole: Limiter, number: int) -> None:
        self._whole, self._number = whole, number
        arm, self.columns = self._share.arm, list(self._share.columns)
        self.names = tuple(whole.names[k].removeprefix(f"{arm}/") for k in self.columns)

    @property
    def _share(self) -> Share:
        return self._whole.state.shares[self._number]

    @property
    def state(self) -> SafetyState:
        """State of the limiter, with the chambers and the command of this arm."""
        return shares.of_arm(self._whole.state, self._share)

    def offer(self, command_pa: Array, stamp_ns: int, now_ns: int, source: str = "command") -> str | None:
        """Accept set points of this arm and return None, or the reason of a refusal.

        The parameters as in `limiter.offer`.
        """
        own, refusal = limiter.offer(self._whole.limits, self.state, command_pa, stamp_ns, now_ns, source)
        self._whole.state = shares.with_command(self._whole.state, self._share, own)
        return refusal

    def doubt(self, reason: str, source: str) -> None:
        """Refuse a command of a name that two publishers may use, and hold the set points of this arm."""
        own = limiter.doubt(self.state, reason, source)
        self._whole.state = shares.with_command(self._whole.state, self._share, own)
