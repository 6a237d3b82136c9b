"""The set point of one device on its way to the caller's: in counts, within a range, with a slew."""

from __future__ import annotations

_LONGEST_PAUSE_S = 0.1  # longest time for which a set point moves in one message


class SlewedSetpoint:
    """Set point in the counts of a device.

    It follows the caller's set point by at most `slew_pa_s`: from exchange to exchange, so that a step is
    spread over several messages, and from message to message, so that it does not jump after a pause of the
    line. Zero after a fault and a vent are not limited.

    Parameters
    ----------
    resolution_pa : float
        Pressure of one count [Pa].
    low, high : int
        Smallest and largest set point in counts.
    slew_pa_s : float
        Largest rate of the set point [Pa/s].

    Attributes
    ----------
    jumps : bool
        Whether the next set point is 0 without slew.
    sent_counts : int
        Last sent set point.
    """

    def __init__(self, resolution_pa: float, low: int, high: int, slew_pa_s: float) -> None:
        self.resolution_pa, self.low, self.high = resolution_pa, low, high
        self._slew_pa_s = slew_pa_s
        self.restart(0)

    def restart(self, now_ns: int) -> None:
        """Start again from 0."""
        self._reference_pa = 0.0
        self.jumps = False
        self.sent_counts = 0
        self._sent_ns = now_ns

    @property
    def sent_pa(self) -> float:
        """Last sent set point [Pa gauge]."""
        return self.sent_counts * self.resolution_pa

    @property
    def is_zero(self) -> bool:
        """Whether 0 is wanted."""
        return self.jumps or self._reference_pa == self.sent_counts == 0

    def jump_to_zero(self) -> None:
        """Want 0 without slew."""
        self._reference_pa, self.jumps = 0.0, True

    def follow(self, target_pa: float, dt: float) -> None:
        """Follow the caller's set point [Pa gauge] for `dt` [s]."""
        self._reference_pa = self._towards(self._reference_pa, target_pa, dt)

    def wanted_counts(self, now_ns: int) -> int:
        """Return the set point to send now, in counts within the range."""
        if self.jumps:
            return 0
        wanted = self._towards(self.sent_pa, self._reference_pa, (now_ns - self._sent_ns) * 1e-9)
        return min(max(round(wanted / self.resolution_pa), self.low), self.high)

    def sent(self, counts: int, now_ns: int) -> None:
        """Record a set point that is sent."""
        self.sent_counts, self._sent_ns = counts, now_ns

    def text(self, counts: int) -> str:
        """Return a set point for messages."""
        return f"{counts * self.resolution_pa:.0f} Pa"

    def _towards(self, from_pa: float, to_pa: float, dt: float) -> float:
        change = self._slew_pa_s * min(dt, _LONGEST_PAUSE_S)
        return min(max(to_pa, from_pa - change), from_pa + change)
