"""Bus budget: the bits of one cycle, and the rates that a bus carries."""

from __future__ import annotations

from soro_core.hardware.canopen import frames
from soro_core.hardware.canopen.config import CanopenPlatform
from soro_core.hardware.canopen.device import Device, Pdo, describe
from soro_core.hardware.transport.frame import Frame, frame_bits
from soro_core.hardware.transport.slcan_codec import encode

# Part of the bus that cycles may take: heartbeats, emergencies, status words, repeated frames need the rest.
USABLE = 0.6


def cycle_bits(platform: CanopenPlatform) -> int:
    """Bits of the cyclic PDOs of every node and SYNC, with worst-case stuffing.

    12 nodes with PDOs of 4 bytes take 2335 bits, 3 nodes with PDOs of 8 bytes 865.
    """
    device = describe(platform.canopen.mapping)
    nodes = len(platform.nodes)
    return nodes * _cyclic_bits(device) + frame_bits(frames.SYNC)


def highest_rate_hz(platform: CanopenPlatform) -> float:
    """Rate at which the cycle fills the bus."""
    return platform.transport.bitrate / cycle_bits(platform)


def _cyclic_bits(device: Device) -> int:
    return sum(_bits(pdo) for pdo in (*device.rpdos, *device.tpdos) if pdo.cyclic)


def _bits(pdo: Pdo) -> int:
    return frame_bits(Frame(0x181, bytes(pdo.layout.length)))


def serial_rate_hz(platform: CanopenPlatform, serial_baud: int) -> float:
    """Rate that an slcan adapter's serial line allows, ten bits a character: answers come after SYNC."""
    device = describe(platform.canopen.mapping)
    nodes = len(platform.nodes)
    sent = nodes * sum(_characters(pdo) for pdo in device.rpdos if pdo.cyclic) + len(encode(frames.SYNC))
    received = nodes * sum(_characters(pdo) for pdo in device.tpdos if pdo.cyclic)
    return serial_baud / (10 * (sent + received))


def _characters(pdo: Pdo) -> int:
    return len(encode(Frame(0x181, bytes(pdo.layout.length))))
