"""Bus budget: bits of one cycle, and highest rate of a bus."""

from __future__ import annotations

from soro_hardware.canopen import frames
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.device import Device, Pdo, describe
from soro_hardware.transport.frame import Frame, frame_bits
from soro_hardware.transport.slcan_codec import encode

# Share of the bus for the cycles; heartbeats, emergencies, status words and repeated frames need the rest.
USABLE = 0.6


def cycle_bits(platform: CanopenPlatform) -> int:
    """Return the bits of SYNC and of the cyclic PDOs of all nodes, with worst-case stuffing.

    12 nodes with PDOs of 4 bytes take 2335 bits, 3 nodes with PDOs of 8 bytes 865.
    """
    device = describe(platform.canopen.mapping)
    nodes = len(platform.nodes)
    return nodes * _cyclic_bits(device) + frame_bits(frames.SYNC)


def highest_rate_hz(platform: CanopenPlatform) -> float:
    """Return the rate [Hz] at which the cycle fills the bus."""
    return platform.transport.bitrate / cycle_bits(platform)


def _cyclic_bits(device: Device) -> int:
    return sum(_bits(pdo) for pdo in (*device.rpdos, *device.tpdos) if pdo.cyclic)


def _bits(pdo: Pdo) -> int:
    return frame_bits(Frame(0x181, bytes(pdo.layout.length)))


def serial_rate_hz(platform: CanopenPlatform, serial_baud: int) -> float:
    """Return the highest rate [Hz] on the serial line of an slcan adapter, with ten bits per character."""
    device = describe(platform.canopen.mapping)
    nodes = len(platform.nodes)
    sent = nodes * sum(_characters(pdo) for pdo in device.rpdos if pdo.cyclic) + len(encode(frames.SYNC))
    received = nodes * sum(_characters(pdo) for pdo in device.tpdos if pdo.cyclic)
    return serial_baud / (10 * (sent + received))


def _characters(pdo: Pdo) -> int:
    return len(encode(Frame(0x181, bytes(pdo.layout.length))))
