"""The limiter of one arm with its state: what a loop holds that gives chambers pressure."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from soro_core.pneumatics.regulator import RegulatorModel
from soro_core.safety import limiter
from soro_core.safety.limits import Limits
from soro_core.safety.remembered import Array, Flags


class Limiter:
    """Limits, and the state that goes on with each call of the pure functions of `soro_core.safety.limiter`.

    Parameters
    ----------
    limits : Limits
        Of commands and readings.
    names : sequence of str
        Chambers in order.
    response : RegulatorModel
        How the regulators follow their set points: what the monitors compare the readings with.

    Attributes
    ----------
    state : SafetyState
        Of limiter, monitors and latch.
    """

    def __init__(
        self, limits: Limits, names: Sequence[str], response: RegulatorModel = limiter.TYPICAL
    ) -> None:
        self.limits, self.names, self._response = limits, tuple(names), response
        self.state = limiter.initial_state(len(self.names), self.names)

    @property
    def cause(self) -> str | None:
        """Why the limiter has vented, or None."""
        return self.state.cause

    @property
    def not_vented(self) -> str | None:
        """Which chambers have kept their pressure since the vent, or None."""
        return self.state.not_vented

    def offer(self, command_pa: Array, stamp_ns: int, now_ns: int, source: str = "command") -> str | None:
        """Take set points (n,) [Pa gauge] for the next cycle; the refusal, or None."""
        self.state, refusal = limiter.offer(self.limits, self.state, command_pa, stamp_ns, now_ns, source)
        return refusal

    def judge(
        self,
        reading_pa: Array,
        fresh: bool | Flags,
        now_ns: int,
        fault: str | None = None,
        supply_pa: Array | None = None,
    ) -> None:
        """Judge the readings of an exchange, and set the next set points."""
        self.state = limiter.cycle(
            self.limits, self.state, reading_pa, fresh, now_ns, fault, supply_pa, self._response
        )

    def latch(self, cause: str) -> None:
        """Latch; the next set points are zero."""
        self.state = limiter.request_vent(self.state, cause)

    def vent(self, cause: str) -> None:
        """Latch, and send zeros at once where there is a bus."""
        self.latch(cause)

    def reset(self, now_ns: Callable[[], int]) -> str | None:
        """Leave the latch; the refusal, or None."""
        self.state, refusal = limiter.reset(self.limits, self.state, now_ns())
        return refusal
