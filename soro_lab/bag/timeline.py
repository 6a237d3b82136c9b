"""Recorded time against the time of a clock: rate, pause and seek."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Timeline:
    """Which recorded time is due when; each change gives a new one.

    Attributes
    ----------
    position_ns : int
        Recorded time at `since_ns` [ns].
    since_ns : int
        Time of the clock [ns]; before it nothing moves.
    rate : float
        Recorded time per time of the clock; 0: everything is due at once.
    paused : bool
    """

    position_ns: int
    since_ns: int
    rate: float = 1.0
    paused: bool = False

    def at(self, now_ns: int) -> int:
        """Return the recorded time [ns] at a time of the clock [ns]."""
        if self.paused:
            return self.position_ns
        return self.position_ns + round(self.rate * max(0, now_ns - self.since_ns))

    def wait_s(self, stamp_ns: int, now_ns: int) -> float | None:
        """Return the time until a recorded time is due [s], 0 at least; None while paused."""
        if self.paused:
            return None
        if self.rate == 0.0:
            return 0.0
        return max(0.0, (self.since_ns - now_ns + (stamp_ns - self.position_ns) / self.rate) * 1e-9)

    def reached(self, stamp_ns: int) -> Timeline:
        """Note a recorded time that is played; at rate 0 nothing else says how far it is."""
        return replace(self, position_ns=stamp_ns) if self.rate == 0.0 else self

    def at_rate(self, rate: float, now_ns: int) -> Timeline:
        """Return the one of another rate from now on."""
        return replace(self, position_ns=self.at(now_ns), since_ns=now_ns, rate=rate)

    def pause(self, now_ns: int) -> Timeline:
        """Return the one that stands still from now on."""
        return replace(self, position_ns=self.at(now_ns), since_ns=now_ns, paused=True)

    def resume(self, now_ns: int) -> Timeline:
        """Return the one that goes on from now on; one that runs stays."""
        return replace(self, since_ns=now_ns, paused=False) if self.paused else self

    def seek(self, position_ns: int, now_ns: int) -> Timeline:
        """Return the one that is at another recorded time [ns] now."""
        return replace(self, position_ns=position_ns, since_ns=now_ns)
