"""Bus budget: bits of one cycle, and highest rate of a bus."""

from __future__ import annotations

from collections.abc import Sequence

from soro_hardware.canopen import frames
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.device import Pdo, describe
from soro_hardware.transport.frame import Frame, frame_bits
from soro_hardware.transport.slcan_codec import encode

# Share of the bus for the cycles; heartbeats, emergencies, status words and repeated frames need the rest.
USABLE = 0.6


def cycle_bits(platform: CanopenPlatform) -> int:
    """Return the bits of SYNC and of the cyclic PDOs of all nodes, with worst-case stuffing.

    12 nodes with PDOs of 4 bytes take 2335 bits, 3 nodes with PDOs of 8 bytes 865.
    """
    device = describe(platform.canopen.mapping)
    bits = sum(frame_bits(one) for one in (*_cyclic(device.rpdos), *_cyclic(device.tpdos)))
    return len(platform.nodes) * bits + frame_bits(frames.SYNC)


def highest_rate_hz(platform: CanopenPlatform) -> float:
    """Return the rate [Hz] at which the cycle fills the bus."""
    return platform.transport.bitrate / cycle_bits(platform)


def serial_rate_hz(platform: CanopenPlatform, serial_baud: int) -> float:
    """Return the highest rate [Hz] on the serial line of an slcan adapter, with ten bits per character."""
    device = describe(platform.canopen.mapping)
    nodes = len(platform.nodes)
    sent = nodes * sum(len(encode(one)) for one in _cyclic(device.rpdos)) + len(encode(frames.SYNC))
    received = nodes * sum(len(encode(one)) for one in _cyclic(device.tpdos))
    return serial_baud / (10 * (sent + received))


def _cyclic(pdos: Sequence[Pdo]) -> list[Frame]:
    return [Frame(0x181, bytes(pdo.layout.length)) for pdo in pdos if pdo.cyclic]
