"""Watchdogs of a device over SDO: times, arming, errors."""

from __future__ import annotations

from soro_hardware.canopen import cia408
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.device import Device
from soro_hardware.canopen.sdo_client import SdoAbortError, SdoClient


def set_times(sdo: SdoClient, platform: CanopenPlatform, device: Device) -> None:
    """Set the times of the watchdogs; those that watch the host's signs of life are off until `arm`.

    Parameters
    ----------
    sdo : SdoClient
        Client of the node.
    platform : CanopenPlatform
        Times and identities.
    device : Device
        Kind of device.
    """
    times = platform.canopen
    sdo.step = "heartbeat"
    if device.has_producer:
        sdo.write_checked(cia408.PRODUCER_HEARTBEAT, 0, round(times.heartbeat_s * 1e3), 2)
    if device.has_consumer:
        sdo.write(cia408.CONSUMER_HEARTBEAT, 1, 0, 4)
    if device.is_guarded:
        sdo.step = "node guarding"
        if (cia408.PRODUCER_HEARTBEAT, 0) in device.entries:  # never both at once (CiA 301)
            sdo.write_checked(cia408.PRODUCER_HEARTBEAT, 0, 0, 2)
        sdo.write_checked(cia408.GUARD_TIME, 0, round(times.heartbeat_s * 1e3), 2)
        sdo.write(cia408.LIFE_TIME_FACTOR, 0, 0, 1)
    sdo.step = "set point deadline"
    for pdo in device.rpdos:
        if pdo.cyclic and device.has_deadline(pdo):
            sdo.write_checked(pdo.communication, 5, round(times.rpdo_deadline_s * 1e3), 2)
    sdo.step = "SYNC period"
    if times.sync_period_s is not None:
        sdo.write_checked(cia408.CYCLE_PERIOD, 0, round(times.sync_period_s * 1e6), 4)


def arm(sdo: SdoClient, platform: CanopenPlatform, device: Device) -> None:
    """Arm the watchdogs of the host's signs of life, from the next one on; parameters as in `set_times`."""
    times = platform.canopen
    sdo.step = "watch of the host"
    if device.has_consumer:
        consumer = times.master_node << 16 | round(times.heartbeat_consumer_s * 1e3)
        sdo.write_checked(cia408.CONSUMER_HEARTBEAT, 1, consumer, 4)
    if device.is_guarded:
        sdo.write_checked(cia408.LIFE_TIME_FACTOR, 0, times.life_time_factor, 1)


def disarm(sdo: SdoClient, platform: CanopenPlatform, device: Device) -> None:
    """Disarm the watchdogs before the host stops its messages; parameters as in `set_times`."""
    if device.has_consumer:
        sdo.write(cia408.CONSUMER_HEARTBEAT, 1, 0, 4)
    if device.is_guarded:
        sdo.write(cia408.LIFE_TIME_FACTOR, 0, 0, 1)
    if platform.canopen.sync_period_s is not None:
        sdo.write(cia408.CYCLE_PERIOD, 0, 0, 4)


def error_register(sdo: SdoClient) -> int:
    """Return the error register; 0 if the device does not report it."""
    sdo.step = "error register"
    try:
        return sdo.read(cia408.ERROR_REGISTER)
    except SdoAbortError:
        return 0


def has_communication_error(sdo: SdoClient) -> bool:
    """Return whether a device has a communication error, with which it does not stay OPERATIONAL."""
    return bool(error_register(sdo) & cia408.ERROR_COMMUNICATION)
