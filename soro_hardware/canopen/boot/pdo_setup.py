"""Set-up of the PDOs of a device over SDO: their objects, their times, and those that are off."""

from __future__ import annotations

from soro_hardware.canopen import cia408
from soro_hardware.canopen.device import Device, Pdo
from soro_hardware.canopen.frames import COB_DISABLED
from soro_hardware.canopen.mapping import PDO_NUMBERS
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
