"""What a recorder keeps of each topic, and how many of its messages were lost.

The executor does not tell these numbers. A message that is taken directly has one, and it counts all those
before it; so a sample now and then is enough.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

_EVERY = 64


class LossCounter:
    """Counts for one topic; with several publishers, whose numbers say nothing together, it counts nothing.

    Attributes
    ----------
    lost : int
        Messages that were published since the first sample and did not arrive.
    publishers : frozenset of bytes
        Identities of the publishers of the topic.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._before, self._received = 0, 0
        self.publishers: frozenset[bytes] = frozenset()
        self._offset: int | None = None

    @property
    def wants_sample(self) -> bool:
        """Whether the next message ought to be taken with its number."""
        return len(self.publishers) == 1 and (self._offset is None or self._received % _EVERY == 0)

    def is_from(self, publishers: frozenset[bytes]) -> None:
        """Note the identities of the publishers; another one begins to count anew."""
        if publishers != self.publishers:
            self.publishers, self._offset, self._before = publishers, None, self.lost

    def receive(self, number: int | None = None) -> None:
        """Note a message that arrived, with its number if that is known."""
        self._received += 1
        if number is None or len(self.publishers) != 1:
            return
        if self._offset is None:
            self._offset = number - self._received
        self.lost = max(self.lost, self._before + number - self._received - self._offset)


@dataclass
class RecordedTopic:
    """A topic being recorded.

    Attributes
    ----------
    type_name : str
    kind : type
        Class of its messages.
    subscription : Subscription
    qos : tuple
        Reliability and durability that are asked for, see `essence`.
    known_to_bag : bool
    loss : LossCounter
    missed : bytes or None
        Last latched message within a pause: it still holds when the recording goes on.
    """

    type_name: str
    kind: type[Any]
    subscription: Subscription
    qos: tuple[object, object]
    known_to_bag: bool = False
    loss: LossCounter = field(default_factory=LossCounter)
    missed: bytes | None = None

    @property
    def latched(self) -> bool:
        """Whether its last message holds for those who come later."""
        return self.qos[1] is DurabilityPolicy.TRANSIENT_LOCAL


def essence(profile: QoSProfile) -> tuple[object, object]:
    """Return reliability and durability of a profile."""
    return profile.reliability, profile.durability
