"""The published protocol of the VEAB boards: unframed float64 in both directions, over one TCP connection.

Client to server: one normalised set point for each port, ``u = (p + 100 kPa) / 200 kPa``, so 0.5 is 0 kPa.
Server to client: one voltage of 0 to 10 V for each port, ``p = (V - 5) 20 kPa/V``, sent at about 250 Hz when
every ADC has a new sample. There is no frame, request or checksum: a message is 8 bytes for each port,
little-endian.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

LOWEST_PA, SPAN_PA = -100e3, 200e3
SAFE = 0.5
_PA_PER_VOLT, _ZERO_V = 20e3, 5.0
# One count of the ADC is 5 mV, and its range ends at 10.24 V. A stream that is read from a wrong byte has
# values far outside, or values so small (1e-200) that no ADC gives them.
_LOWEST_V, _HIGHEST_V, _SMALLEST_V = -0.5, 10.5, 1e-4


def encode(pressure_pa: Sequence[float]) -> bytes:
    """Return the message with set points [Pa gauge], one for each port.

    Raises
    ------
    ValueError
        If a set point is not finite.
    """
    if not all(map(math.isfinite, pressure_pa)):
        raise ValueError(f"set points must be finite, not {list(pressure_pa)}")
    return struct.pack(f"<{len(pressure_pa)}d", *[normalised(value) for value in pressure_pa])


def normalised(pressure_pa: float) -> float:
    """Return a set point [Pa gauge] in the scale of the server, 0 to 1."""
    return min(max((pressure_pa - LOWEST_PA) / SPAN_PA, 0.0), 1.0)


def pressure_pa(volts: float) -> float:
    """Return the pressure [Pa gauge] of a voltage [V]."""
    return (volts - _ZERO_V) * _PA_PER_VOLT


def volts(pressure_pa: float) -> float:
    """Return the voltage [V] of a pressure [Pa gauge], for emulated servers."""
    return pressure_pa / _PA_PER_VOLT + _ZERO_V


class ReadingDecoder:
    """Decodes readings from the byte stream of a server with `ports` ports.

    Attributes
    ----------
    broken : str or None
        Why the stream is invalid; from then on nothing is decoded until `reset`.
    """

    def __init__(self, ports: int) -> None:
        self._layout = struct.Struct(f"<{ports}d")
        self._buffer = b""
        self.broken: str | None = None

    def feed(self, chunk: bytes) -> list[tuple[float, ...]]:
        """Process bytes; return the complete readings [Pa gauge], oldest first."""
        if self.broken is not None:
            return []
        self._buffer += chunk
        size, found = self._layout.size, list[tuple[float, ...]]()
        for start in range(0, len(self._buffer) - size + 1, size):
            values = self._layout.unpack_from(self._buffer, start)
            for port, value in enumerate(values):
                if not _possible(value):
                    self.broken, self._buffer = f"{value:.3g} V on port {port}", b""
                    return found
            found.append(tuple(map(pressure_pa, values)))
        self._buffer = self._buffer[len(found) * size :]
        return found

    def reset(self) -> None:
        """Start with a new connection."""
        self._buffer, self.broken = b"", None


def _possible(value: float) -> bool:
    if not _LOWEST_V <= value <= _HIGHEST_V:  # false for NaN
        return False
    return value == 0.0 or abs(value) >= _SMALLEST_V
