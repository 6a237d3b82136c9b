"""Messages that were lost on the way to a reader, from the numbers that their publisher gives them.

The executor does not tell these numbers. A message that is taken directly has one, and it counts all those
before it; so a sample now and then is enough.
"""

from __future__ import annotations

_EVERY = 64


class LossCounter:
    """Counts for one topic; with several publishers, whose numbers say nothing together, it counts nothing.

    Attributes
    ----------
    lost : int
        Messages that were published since the first sample and did not arrive.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._before, self._received = 0, 0
        self._publishers: frozenset[bytes] = frozenset()
        self._offset: int | None = None

    @property
    def wants_sample(self) -> bool:
        """Whether the next message ought to be taken with its number."""
        return len(self._publishers) == 1 and (self._offset is None or self._received % _EVERY == 0)

    def is_from(self, publishers: frozenset[bytes]) -> None:
        """Note the identities of the publishers; another one begins to count anew."""
        if publishers != self._publishers:
            self._publishers, self._offset, self._before = publishers, None, self.lost

    def receive(self, number: int | None = None) -> None:
        """Note a message that arrived, with its number if that is known."""
        self._received += 1
        if number is None or len(self._publishers) != 1:
            return
        if self._offset is None:
            self._offset = number - self._received
        self.lost = max(self.lost, self._before + number - self._received - self._offset)
