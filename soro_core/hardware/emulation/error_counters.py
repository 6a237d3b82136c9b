"""Error counters of a CAN controller and the states that follow (ISO 11898-1, fault confinement)."""

from __future__ import annotations

from dataclasses import dataclass

WARNING, PASSIVE, OFF = 96, 128, 256


@dataclass
class ErrorCounters:
    """Transmit and receive error counter of one controller."""

    transmit: int = 0
    receive: int = 0

    @property
    def state(self) -> str:
        """``active``, ``warning``, ``passive`` or ``bus_off``."""
        if self.transmit >= OFF:
            return "bus_off"
        worst = max(self.transmit, self.receive)
        return "passive" if worst >= PASSIVE else "warning" if worst >= WARNING else "active"

    @property
    def is_off(self) -> bool:
        """Whether the controller neither sends nor receives."""
        return self.transmit >= OFF

    def sent(self, spoilt: bool = False) -> None:
        """Count a frame of this controller."""
        if not self.is_off:
            self.transmit = self.transmit + 8 if spoilt else max(self.transmit - 1, 0)

    def unacknowledged(self) -> None:
        """Count a frame that nobody has acknowledged: that alone leads to passive, never off the bus."""
        if self.transmit < PASSIVE:
            self.transmit = min(self.transmit + 8, PASSIVE)

    def received(self, spoilt: bool = False) -> None:
        """Count a frame of another controller."""
        if spoilt:
            self.receive = min(self.receive + 1, 255)
        elif self.receive > 0:
            self.receive = min(self.receive, PASSIVE) - 1

    def reset(self) -> None:
        """Start anew, as after bus-off."""
        self.transmit = self.receive = 0
