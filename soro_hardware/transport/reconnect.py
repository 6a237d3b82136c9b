"""Times at which to open a lost bus again: with a growing pause, and at most three times after bus-off."""

from __future__ import annotations

from collections import deque

FIRST_S, LONGEST_S = 0.5, 10.0
MOST_TRIES, WINDOW_S = 3, 60.0


class Reconnect:
    """Times of attempts to open a bus; the caller states the present time.

    After a lost connection the pause doubles from 0.5 s to 10 s. After bus-off it is 0.5 s, with at most
    three openings per minute: repeated bus-off has its cause in the wiring, and more attempts only disturb
    other nodes.
    """

    def __init__(self) -> None:
        self._pause_s = FIRST_S
        self._due_s: float | None = None
        self._bus_offs: deque[float] = deque(maxlen=MOST_TRIES)

    @property
    def is_lost(self) -> bool:
        """Whether the bus is lost and has not been opened again."""
        return self._due_s is not None

    def broken(self, now_s: float) -> None:
        """Record that the connection was lost, or could not be opened."""
        self._due_s = now_s + self._pause_s
        self._pause_s = min(2 * self._pause_s, LONGEST_S)

    def bus_off(self, now_s: float) -> None:
        """Record bus-off."""
        self._due_s = now_s + FIRST_S
        self._bus_offs.append(now_s)

    def wait_s(self, now_s: float, keep: int = 0) -> float:
        """Return the time until the next attempt [s]; `keep` attempts of each minute stay reserved."""
        if self._due_s is None:
            return 0.0
        wait = self._due_s - now_s
        counted = list(self._bus_offs)[keep - MOST_TRIES :]
        if len(counted) == MOST_TRIES - keep:
            wait = max(wait, counted[0] + WINDOW_S - now_s)
        return max(wait, 0.0)

    def opened(self) -> None:
        """Record that the bus is open again."""
        self._due_s = None

    def healthy(self) -> None:
        """Reset the pause to its shortest value, after the configuration of the devices."""
        self._pause_s = FIRST_S
