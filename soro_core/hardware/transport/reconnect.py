"""When to open a lost bus again: with a growing pause after a broken connection, seldom after bus-off."""

from __future__ import annotations

from collections import deque

FIRST_S, LONGEST_S = 0.5, 10.0
MOST_TRIES, WINDOW_S = 3, 60.0


class Reconnect:
    """Times of attempts; the clock is given from outside.

    After a break the pause doubles from 0.5 s to 10 s. After bus-off it is 0.5 s, and there are at most three
    openings a minute: a controller that goes off again and again has a fault on its wire, which more attempts
    do not mend but disturb others with.
    """

    def __init__(self) -> None:
        self._pause_s = FIRST_S
        self._due_s: float | None = None
        self._bus_offs: deque[float] = deque(maxlen=MOST_TRIES)

    @property
    def is_lost(self) -> bool:
        """Whether the bus is gone and has not been opened again."""
        return self._due_s is not None

    def broken(self, now_s: float) -> None:
        """The connection broke, or could not be opened."""
        self._due_s = now_s + self._pause_s
        self._pause_s = min(2 * self._pause_s, LONGEST_S)

    def bus_off(self, now_s: float) -> None:
        """The controller took itself off the bus."""
        self._due_s = now_s + FIRST_S
        self._bus_offs.append(now_s)

    def wait_s(self, now_s: float, keep: int = 0) -> float:
        """Time to wait before the next attempt [s]; 0 when it may be now.

        `keep` of the attempts that a minute has after bus-off are left for others.
        """
        if self._due_s is None:
            return 0.0
        wait = self._due_s - now_s
        counted = list(self._bus_offs)[keep - MOST_TRIES :]
        if len(counted) == MOST_TRIES - keep:
            wait = max(wait, counted[0] + WINDOW_S - now_s)
        return max(wait, 0.0)

    def opened(self) -> None:
        """The bus is open again."""
        self._due_s = None

    def healthy(self) -> None:
        """The devices have been configured over it: a later break starts with a short pause."""
        self._pause_s = FIRST_S
