"""Start-up of one CiA 408 node over SDO: check it, set watchdogs, limits and PDOs, bring it to HOLD at 0."""

from __future__ import annotations

from dataclasses import dataclass

from soro_core.hardware.canopen import cia408
from soro_core.hardware.canopen.cia408 import Control, State
from soro_core.hardware.canopen.frames import COB_DISABLED, RPDO_BASES, TPDO_BASES, SdoAbort
from soro_core.hardware.canopen.pdo import Mapped, PdoLayout
from soro_core.hardware.canopen.sdo_client import SdoAbortError, SdoClient
from soro_core.hardware.platform import Platform

RPDO_LAYOUT = PdoLayout((Mapped(cia408.CONTROL_WORD, 0, 16), Mapped(cia408.SETPOINT, 1, 16)))
TPDO_LAYOUT = PdoLayout((Mapped(cia408.STATUS_WORD, 0, 16), Mapped(cia408.ACTUAL, 1, 16)))
_EVERY_SYNC = 1
_BOOT_POLL_S = 0.1


@dataclass(frozen=True)
class Scaling:
    """Counts of a device: pressure per count of set point and reading, and the counts it may be sent."""

    setpoint_pa: float
    actual_pa: float
    low: int
    high: int


def wait_for_boot(sdo: SdoClient, timeout_s: float) -> None:
    """Poll object 1000 until the node answers; a boot-up message in between costs at most one poll."""
    sdo.step = "boot"
    expired = sdo.timer(timeout_s)
    while not sdo.answers(cia408.DEVICE_TYPE, min(_BOOT_POLL_S, timeout_s)):
        if expired():
            raise sdo.error(f"no answer for {timeout_s:g} s; is it powered, on this bus, at this bit rate?")


def configure_node(sdo: SdoClient, node: int, platform: Platform) -> Scaling:
    """Everything between boot and NMT start.

    Raises
    ------
    HardwareError
        One line that names device, step and object.
    """
    _identify(sdo, platform)
    to_init(sdo, platform.canopen.activation_timeout_s)
    _set_watchdogs(sdo, platform)
    scaling = _read_scaling(sdo, platform)
    _set_limits(sdo, scaling)
    _map(sdo, cia408.RPDO_COMMUNICATION, cia408.RPDO_MAPPING, RPDO_BASES[0] + node, RPDO_LAYOUT)
    _map(sdo, cia408.TPDO_COMMUNICATION, cia408.TPDO_MAPPING, TPDO_BASES[0] + node, TPDO_LAYOUT)
    _disable_other_pdos(sdo)
    return scaling


def to_hold(sdo: SdoClient, timeout_s: float) -> None:
    """Control words 0, 1, 3 after NMT start: the loop then holds object 6394, which is 0."""
    sdo.step = "state machine to hold"
    for control, state in (
        (Control.INIT, State.INIT),
        (Control.DISABLED, State.DISABLED),
        (Control.HOLD, State.HOLD),
    ):
        _command(sdo, control, state, timeout_s)


def to_init(sdo: SdoClient, timeout_s: float) -> None:
    """Bring the state machine to INIT, where parameters can be set; a fault is reset by edges of bit 3."""
    sdo.step = "state machine to init"
    if sdo.read(cia408.STATUS_WORD) & 0xF != State.INIT.bits:
        _command(sdo, Control.INIT, State.INIT, timeout_s)


def _command(sdo: SdoClient, control: Control, state: State, timeout_s: float) -> None:
    """Write a control word until the status word shows the state; a device may take a few of its cycles."""
    expired = sdo.timer(timeout_s)
    while True:
        sdo.write(cia408.CONTROL_WORD, 0, control, 2)
        status = sdo.read(cia408.STATUS_WORD)
        if status & 0xF == state.bits:
            return
        found = cia408.state_of(status)
        if expired():
            raise sdo.error(
                f"control word {control:d} does not lead to {state.value[0]}, found {found.value[0]}"
            )
        if found.is_fault and control is Control.INIT:
            sdo.write(cia408.CONTROL_WORD, 0, Control.RESET, 2)


def _identify(sdo: SdoClient, platform: Platform) -> None:
    sdo.step = "device type"
    device_type = sdo.read(cia408.DEVICE_TYPE)
    if device_type & 0xFFFF != cia408.PROFILE:
        raise sdo.error(f"the device has profile {device_type & 0xFFFF}, not {cia408.PROFILE}")
    sdo.step = "identity"
    wanted = (platform.canopen.vendor_id, platform.canopen.product_code)
    for sub, value, name in zip((1, 2), wanted, ("vendor", "product"), strict=True):
        found = sdo.read(cia408.IDENTITY, sub)
        if value is not None and found != value:
            raise sdo.error(f"{name} 0x{found:X}, the platform asks for 0x{value:X}")


def _set_watchdogs(sdo: SdoClient, platform: Platform) -> None:
    times = platform.canopen
    sdo.step = "heartbeat"
    sdo.write_checked(cia408.PRODUCER_HEARTBEAT, 0, round(times.heartbeat_s * 1e3), 2)
    consumer = times.master_node << 16 | round(times.heartbeat_consumer_s * 1e3)
    sdo.write_checked(cia408.CONSUMER_HEARTBEAT, 1, consumer, 4)
    sdo.step = "set point deadline"
    sdo.write_checked(cia408.RPDO_COMMUNICATION, 5, round(times.rpdo_deadline_s * 1e3), 2)
    sdo.step = "cycle period"
    sdo.write_checked(cia408.CYCLE_PERIOD, 0, round(1e6 / platform.cycle_hz), 4)


def _read_scaling(sdo: SdoClient, platform: Platform) -> Scaling:
    sdo.step = "units"
    scales = []
    for index in (cia408.SETPOINT, cia408.ACTUAL):
        unit, prefix = sdo.read(index, 2), sdo.read(index, 3, is_signed=True)
        try:
            scales.append(cia408.pascal_per_count(unit, prefix, platform.canopen.full_scale_pa))
        except ValueError as error:
            raise sdo.error(str(error)) from None
    low, high = cia408.counts_within(platform.range.minimum_pa, platform.range.maximum_pa, scales[0])
    if high * scales[0] < 0.5 * platform.range.maximum_pa:
        raise sdo.error(
            f"one count is {scales[0]:g} Pa: the range ends at {high * scales[0]:g} Pa in 16 bits"
        )
    return Scaling(scales[0], scales[1], low, high)


def _set_limits(sdo: SdoClient, scaling: Scaling) -> None:
    sdo.step = "limits"
    sdo.write_checked(cia408.UPPER_LIMIT, 1, scaling.high, 2, is_signed=True)
    sdo.write_checked(cia408.LOWER_LIMIT, 1, scaling.low, 2, is_signed=True)
    sdo.step = "hold set point"
    sdo.write_checked(cia408.HOLD_SETPOINT, 1, 0, 2, is_signed=True)
    sdo.step = "mode"
    modes = (
        (cia408.DEVICE_MODE, cia408.SETPOINT_VIA_BUS),
        (cia408.CONTROL_MODE, cia408.PRESSURE_CLOSED_LOOP),
    )
    for index, mode in modes:
        if sdo.read(index, 0, is_signed=True) != mode:
            sdo.write_checked(index, 0, mode, 1, is_signed=True)


def _map(sdo: SdoClient, communication: int, mapping: int, cob_id: int, layout: PdoLayout) -> None:
    """Disable, clear, write, count, enable (CiA 301); every value is read back."""
    sdo.step = f"mapping {mapping:04X}"
    sdo.write(communication, 1, cob_id | COB_DISABLED, 4)
    sdo.write(mapping, 0, 0, 1)
    for number, mapped in enumerate(layout.objects, start=1):
        sdo.write_checked(mapping, number, mapped.entry, 4)
    sdo.write_checked(mapping, 0, len(layout.objects), 1)
    sdo.write_checked(communication, 2, _EVERY_SYNC, 1)
    sdo.write(communication, 1, cob_id, 4)
    found = sdo.read(communication, 1)
    if found & (COB_DISABLED | 0x7FF) != cob_id:  # bit 30 (no RTR) may be set by the device
        raise sdo.error(f"wrote {communication:04X}:1 = 0x{cob_id:X}, the device has 0x{found:X}")


def _disable_other_pdos(sdo: SdoClient) -> None:
    """Nothing on the bus but what is read: TPDO 2 to 4 off, where the device has them."""
    sdo.step = "other PDOs"
    for number in range(1, 4):
        try:
            cob_id = sdo.read(cia408.TPDO_COMMUNICATION + number, 1)
        except SdoAbortError as abort:
            if abort.code != SdoAbort.NO_OBJECT:
                raise
            return
        if not cob_id & COB_DISABLED:
            sdo.write(cia408.TPDO_COMMUNICATION + number, 1, cob_id | COB_DISABLED, 4)
