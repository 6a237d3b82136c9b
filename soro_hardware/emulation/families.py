"""Emulated devices of a platform of any family."""

from __future__ import annotations

from soro_hardware.emulation.devices import EmulatedDevices
from soro_hardware.families import find_family
from soro_hardware.platform import PlatformBase


def emulate(platform: PlatformBase, lockstep: bool, seed: int) -> EmulatedDevices:
    """Make the emulated devices of a platform; parameters as in `EmulatedDevices`."""
    family = find_family(platform.family)
    devices: EmulatedDevices = family.find(family.emulator)(platform, lockstep, seed)
    return devices
