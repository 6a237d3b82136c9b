"""What a recorder keeps of each topic."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from soro_ros.conversion.lost_messages import LossCounter


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
