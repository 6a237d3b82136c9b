"""Number of bytes of a set point and a reading on a serial line, and the resulting update rate."""

from __future__ import annotations

BITS_PER_BYTE = 10  # start, 8 data, stop

# An ITV: longest question and answer of SET and of MON.
ITV_BYTES = len(b"SET 1023\r\n1023\r\nMON\r\n1023\r\n")

_IDLE_BYTES = 3.5  # idle line before an Alicat acts on a command
# An Alicat: with `S` in one answer, with `LS` in two.
S_BYTES = len(b"AS00.00\rA +000.00 +000.00\r") + _IDLE_BYTES
LS_BYTES = len(b"ALS 00.00\rA +000.00 +000.00 14 KPAG\rA\rA +000.00 +000.00\r") + 2 * _IDLE_BYTES


def update_hz(baud: int, bytes_a_round: float) -> float:
    """Return the rate [Hz] of rounds in which every chamber of a line is served."""
    return baud / (BITS_PER_BYTE * bytes_a_round)
