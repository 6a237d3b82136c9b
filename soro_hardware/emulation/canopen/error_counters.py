"""Error counters of a CAN controller and its error state (ISO 11898-1, fault confinement)."""

from __future__ import annotations

from dataclasses import dataclass

WARNING, PASSIVE, OFF = 96, 128, 256


@dataclass
class ErrorCounters:
    """Transmit and receive error counters of one controller."""

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
        """Whether the controller is in bus-off: it neither sends nor receives."""
        return self.transmit >= OFF

    def sent(self, spoilt: bool = False) -> None:
        """Count a frame of this controller; `spoilt` means that it was destroyed on the bus."""
        if not self.is_off:
            self.transmit = self.transmit + 8 if spoilt else max(self.transmit - 1, 0)

    def unacknowledged(self) -> None:
        """Count a frame without acknowledgement, which leads to error passive, never to bus-off."""
        if self.transmit < PASSIVE:
            self.transmit = min(self.transmit + 8, PASSIVE)

    def received(self, spoilt: bool = False) -> None:
        """Count a frame of another controller; `spoilt` as in `sent`."""
        if spoilt:
            self.receive = min(self.receive + 1, 255)
        elif self.receive > 0:
            self.receive = min(self.receive, PASSIVE) - 1

    def reset(self) -> None:
        """Reset the counters, as after bus-off."""
        self.transmit = self.receive = 0
