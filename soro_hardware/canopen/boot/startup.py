"""Start-up of one node over SDO, up to NMT start: checks, watchdogs, limits and PDOs.

Steps without objects in the mapping or the EDS are omitted: an analog coupler has neither limits nor states.
"""

from __future__ import annotations

import functools
import logging

from soro_hardware.canopen import cia408
from soro_hardware.canopen.boot import watchdogs
from soro_hardware.canopen.boot.valve_states import to_init
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.device import Device, Object, Pdo, Scaling
from soro_hardware.canopen.frames import COB_DISABLED
from soro_hardware.canopen.mapping import PDO_NUMBERS, FixedScaling, Linear
from soro_hardware.canopen.sdo_client import SdoAbortError, SdoClient
from soro_hardware.canopen.sdo_frames import SdoAbort

_EVERY_SYNC, _BY_DEVICE = 1, 255
_INHIBIT_MS = 2  # limits the bus load of a status that changes often


def map_pdo(sdo: SdoClient, pdo: Pdo, node: int, event_ms: int) -> None:
    """Disable, clear, write, count, enable (CiA 301); every value is read back.

    Parameters
    ----------
    sdo : SdoClient
        Client of the node.
    pdo : Pdo
        PDO with its objects.
    node : int
        Node id.
    event_ms : int
        Longest time [ms] between two messages of a PDO that the device sends by itself.
    """
    sdo.step = f"mapping {pdo.mapping:04X}"
    communication, mapping, cob_id = pdo.communication, pdo.mapping, pdo.cob_id(node)
    count = len(pdo.layout.objects)
    if pdo.fixed:
        entries = [(0, count), *enumerate((mapped.entry for mapped in pdo.layout.objects), start=1)]
        for sub, wanted in entries:
            found = sdo.read(mapping, sub)
            if found != wanted:
                raise sdo.error(
                    f"the device's fixed map has {mapping:04X}:{sub} = 0x{found:X}, not 0x{wanted:X}"
                )
    sdo.write(communication, 1, cob_id | COB_DISABLED, 4)
    if not pdo.fixed:
        sdo.write(mapping, 0, 0, 1)
        for number, mapped in enumerate(pdo.layout.objects, start=1):
            sdo.write_checked(mapping, number, mapped.entry, 4)
        sdo.write_checked(mapping, 0, count, 1)
    sdo.write_checked(communication, 2, _BY_DEVICE if pdo.event else _EVERY_SYNC, 1)
    if pdo.event:
        inhibit_ms = _INHIBIT_MS if pdo.on_change else event_ms
        sdo.write_checked(communication, 3, 10 * inhibit_ms, 2)  # in units of 0.1 ms
        sdo.write_checked(communication, 5, event_ms, 2)
    sdo.write(communication, 1, cob_id, 4)
    found = sdo.read(communication, 1)
    if found & (COB_DISABLED | 0x7FF) != cob_id:  # bit 30 (no RTR) may be set by the device
        raise sdo.error(f"wrote {communication:04X}:1 = 0x{cob_id:X}, the device has 0x{found:X}")


def disable_other_pdos(sdo: SdoClient, device: Device) -> None:
    """Disable the TPDOs that the driver does not read."""
    sdo.step = "other PDOs"
    used = {pdo.number for pdo in device.tpdos}
    for number in range(1, PDO_NUMBERS + 1):
        if number in used:
            continue
        communication = cia408.TPDO_COMMUNICATION + number - 1
        try:
            cob_id = sdo.read(communication, 1)
        except SdoAbortError as error:
            if error.abort != SdoAbort.NO_OBJECT:
                raise
            return
        if not cob_id & COB_DISABLED:
            sdo.write(communication, 1, cob_id | COB_DISABLED, 4)


_BOOT_POLL_S = 0.1


def warn_of_unwatched(device: Device) -> None:
    """Warn, once for each kind of device, if it has no watchdog."""
    if not device.has_watchdog:
        _warn_of(device.mapping.device)


@functools.cache
def _warn_of(kind: str) -> None:
    logging.getLogger(__name__).warning(
        "canopen: %s: the EDS names no watchdog, so nothing vents these devices when the driver dies: "
        "a normally open dump valve is needed",
        kind,
    )


def wait_for_boot(sdo: SdoClient, timeout_s: float) -> None:
    """Poll object 1000 until the node answers; raises `SdoError` after `timeout_s` [s]."""
    sdo.step = "boot"
    expired = sdo.timer(timeout_s)
    while not sdo.answers(cia408.DEVICE_TYPE, min(_BOOT_POLL_S, timeout_s)):
        if expired():
            text = f"no answer for {timeout_s:g} s; is it powered, on this bus, at this bit rate?"
            raise sdo.error(text, "silent")


def configure_node(
    sdo: SdoClient, node: int, channels: tuple[int, ...], platform: CanopenPlatform, device: Device
) -> tuple[Scaling, ...]:
    """Configure a node between boot and NMT start.

    Parameters
    ----------
    sdo : SdoClient
    node : int
        Node id.
    channels : tuple of int
        Channels in use.
    platform : CanopenPlatform
        Range and times.
    device : Device
        Kind of device.

    Raises
    ------
    HardwareError
        If a step fails; the message states device, step and object.
    """
    check_identity(sdo, platform, device)
    for channel in range(device.mapping.channels):
        to_init(sdo, device, channel, platform.canopen.activation_timeout_s)
    watchdogs.set_times(sdo, platform, device)
    scalings = tuple(read_scaling(sdo, platform, device, channel) for channel in channels)
    for channel, scaling in zip(channels, scalings, strict=True):
        _set_limits(sdo, device, channel, scaling)
    for pdo in (*device.rpdos, *device.tpdos):
        map_pdo(sdo, pdo, node, round(platform.canopen.status_s * 1e3))
    disable_other_pdos(sdo, device)
    return scalings


def check_identity(sdo: SdoClient, platform: CanopenPlatform, device: Device) -> tuple[int, int, int]:
    """Return device type, vendor and product, checked against mapping and platform.

    Parameters
    ----------
    sdo, platform, device : SdoClient, CanopenPlatform, Device
        As in `configure_node`.
    """
    sdo.step = "device type"
    device_type = sdo.read(cia408.DEVICE_TYPE)
    wanted_profile = device.mapping.profile
    if wanted_profile is not None and device_type & 0xFFFF != wanted_profile:
        raise sdo.error(f"the device has profile {device_type & 0xFFFF}, not {wanted_profile}")
    sdo.step = "identity"
    wanted = (platform.canopen.vendor_id, platform.canopen.product_code)
    identity = []
    for sub, value, name in zip((1, 2), wanted, ("vendor", "product"), strict=True):
        identity.append(sdo.read(cia408.IDENTITY, sub))
        if value is not None and identity[-1] != value:
            raise sdo.error(f"{name} 0x{identity[-1]:X}, the platform asks for 0x{value:X}")
    return device_type, identity[0], identity[1]


def read_scaling(sdo: SdoClient, platform: CanopenPlatform, device: Device, channel: int) -> Scaling:
    """Return the scales of a channel, from the device or from the mapping.

    Parameters
    ----------
    sdo, platform, device : SdoClient, CanopenPlatform, Device
        As in `configure_node`.
    channel : int
        Number of the valve in the node.
    """
    sdo.step = "units"
    fixed = device.mapping.scaling
    if isinstance(fixed, FixedScaling):
        setpoint, actual = fixed.setpoint, fixed.reading
    else:
        setpoint, actual = (
            _unit(sdo, platform, device.require(kind, channel)) for kind in ("setpoint", "reading")
        )
    entry = device.require("setpoint", channel)
    low, high = cia408.counts_within(
        platform.range.minimum_pa,
        platform.range.maximum_pa,
        setpoint.pa_per_count,
        setpoint.zero_count,
        cia408.limits_of(entry.bits, entry.is_signed),
    )
    reached_pa = (high - setpoint.zero_count) * setpoint.pa_per_count
    if reached_pa < 0.5 * platform.range.maximum_pa or not low <= setpoint.zero_count <= high:
        raise sdo.error(
            f"one count is {setpoint.pa_per_count:g} Pa: the range ends at {reached_pa:g} Pa "
            f"in {entry.bits} bits"
        )
    return Scaling(
        setpoint.pa_per_count, actual.pa_per_count, low, high, setpoint.zero_count, actual.zero_count
    )


def _unit(sdo: SdoClient, platform: CanopenPlatform, measured: Object) -> Linear:
    unit, prefix = sdo.read(measured.index, 2), sdo.read(measured.index, 3, is_signed=True)
    try:
        pa_per_count = cia408.pascal_per_count(unit, prefix, platform.canopen.full_scale_pa)
    except ValueError as error:
        raise sdo.error(str(error)) from None
    return Linear(pa_per_count=pa_per_count)


def _set_limits(sdo: SdoClient, device: Device, channel: int, scaling: Scaling) -> None:
    # A valve without a state machine follows its set point from NMT start, before the first RPDO.
    wakes = () if device.has_states else (("setpoint", scaling.setpoint_zero, "set point 0"),)
    for kind, value, step in (
        *wakes,
        ("upper_limit", scaling.high, "limits"),
        ("lower_limit", scaling.low, "limits"),
        ("hold_setpoint", scaling.setpoint_zero, "hold set point"),
    ):
        sdo.step = step
        found = device.find(kind, channel)
        if found is not None:
            sdo.write_checked(found.index, found.sub, value, found.size, found.is_signed)
    sdo.step = "mode"
    for setting in device.mapping.settings:
        found = device.object(device.mapping.of_channel(setting, channel))
        if sdo.read(found.index, found.sub, found.is_signed) != setting.value:
            sdo.write_checked(found.index, found.sub, setting.value, found.size, found.is_signed)
