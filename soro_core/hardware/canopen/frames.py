"""CiA 301 services, bytes <-> values: NMT, SYNC, emergency, expedited SDO, heartbeat. Pure; little-endian."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from soro_core.hardware.transport.frame import Frame

NMT_ID, SYNC_ID, EMCY_BASE = 0x000, 0x080, 0x080
TPDO_BASES = (0x180, 0x280, 0x380, 0x480)
RPDO_BASES = (0x200, 0x300, 0x400, 0x500)
SDO_RESPONSE, SDO_REQUEST, HEARTBEAT_BASE = 0x580, 0x600, 0x700
COB_DISABLED = 0x8000_0000  # bit 31 of a PDO's COB-ID: the PDO does not exist

SYNC = Frame(SYNC_ID)


class NmtCommand(IntEnum):
    """Command specifiers of the network management."""

    START = 0x01
    STOP = 0x02
    PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


class NmtState(IntEnum):
    """States that a heartbeat reports."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class EmcyCode(IntEnum):
    """Emergency error codes in use (CiA 301, CiA 408 and makers' manuals)."""

    NO_ERROR = 0x0000
    GENERIC = 0x1000
    COIL_CURRENT = 0x2320
    SUPPLY_LOW = 0x3120
    CAN_OVERRUN = 0x8110
    ERROR_PASSIVE = 0x8120
    HEARTBEAT_LOST = 0x8130
    BUS_OFF_RECOVERED = 0x8140
    PDO_TOO_SHORT = 0x8210
    RPDO_TIMEOUT = 0x8250
    PRESSURE_MONITORING = 0x8302


class SdoAbort(IntEnum):
    """Abort codes of the service data objects."""

    TOGGLE = 0x0503_0000
    TIMEOUT = 0x0504_0000
    COMMAND = 0x0504_0001
    WRITE_ONLY = 0x0601_0001
    READ_ONLY = 0x0601_0002
    NO_OBJECT = 0x0602_0000
    NOT_MAPPABLE = 0x0604_0041
    PDO_TOO_LONG = 0x0604_0042
    LENGTH = 0x0607_0010
    NO_SUBINDEX = 0x0609_0011
    TOO_HIGH = 0x0609_0031
    TOO_LOW = 0x0609_0032
    DEVICE_STATE = 0x0800_0022


class Emergency(NamedTuple):
    """Content of an emergency message: error code, error register (0x1001), five bytes of the maker."""

    code: int
    register: int
    manufacturer: bytes


@dataclass(frozen=True)
class SdoRequest:
    """A client's request; `data` is None for a read."""

    index: int
    sub: int
    data: bytes | None


@dataclass(frozen=True)
class SdoReply:
    """A server's answer: data of a read, empty data of a write, or an abort code."""

    index: int
    sub: int
    data: bytes
    abort: int | None = None


def nmt(command: NmtCommand, node: int) -> Frame:
    """Network management command; node 0 means all."""
    return Frame(NMT_ID, bytes((command, node)))


def parse_nmt(data: bytes) -> tuple[int, int] | None:
    """Command and node, or None for a malformed one."""
    return (data[0], data[1]) if len(data) == 2 else None


def heartbeat(node: int, state: NmtState) -> Frame:
    """Heartbeat of a node; state BOOT_UP makes it the boot-up message."""
    return Frame(HEARTBEAT_BASE + node, bytes((state,)))


def guard(node: int) -> Frame:
    """Question for a node's state (node guarding)."""
    return Frame(HEARTBEAT_BASE + node, remote=True, length=1)


def guarded(node: int, state: NmtState, toggle: int) -> Frame:
    """The node's answer; bit 7 is its toggle, 0 or 1."""
    return Frame(HEARTBEAT_BASE + node, bytes((toggle << 7 | state,)))


def emergency(node: int, code: int, register: int, manufacturer: bytes = bytes(5)) -> Frame:
    """Emergency message."""
    return Frame(EMCY_BASE + node, struct.pack("<HB5s", code, register, manufacturer))


def parse_emergency(data: bytes) -> Emergency | None:
    """Content of an emergency message, or None for a malformed one."""
    return Emergency(*struct.unpack("<HB5s", data)) if len(data) == 8 else None


def sdo_read(node: int, index: int, sub: int) -> Frame:
    """Request to upload an object."""
    return Frame(SDO_REQUEST + node, struct.pack("<BHB4x", 0x40, index, sub))


def sdo_write(node: int, index: int, sub: int, data: bytes) -> Frame:
    """Request to download an object of one to four bytes."""
    command = 0x23 | (4 - len(data)) << 2
    return Frame(SDO_REQUEST + node, struct.pack("<BHB4s", command, index, sub, data))


def parse_sdo_request(data: bytes) -> SdoRequest | SdoAbort:
    """What a client asks for, or the code with which to abort (segmented transfers are not served)."""
    if len(data) != 8:
        return SdoAbort.COMMAND
    command, index, sub = struct.unpack_from("<BHB", data)
    if command == 0x40:
        return SdoRequest(index, sub, None)
    if command & 0xE2 == 0x22:  # expedited download; without a size (bit 0) all four bytes count
        length = 4 - (command >> 2 & 3) if command & 1 else 4
        return SdoRequest(index, sub, data[4 : 4 + length])
    return SdoAbort.COMMAND


def sdo_read_reply(node: int, index: int, sub: int, data: bytes) -> Frame:
    """Server's answer to a read of one to four bytes."""
    command = 0x43 | (4 - len(data)) << 2
    return Frame(SDO_RESPONSE + node, struct.pack("<BHB4s", command, index, sub, data))


def sdo_write_reply(node: int, index: int, sub: int) -> Frame:
    """Server's answer to a write."""
    return Frame(SDO_RESPONSE + node, struct.pack("<BHB4x", 0x60, index, sub))


def sdo_abort(node: int, index: int, sub: int, code: int) -> Frame:
    """Server's refusal."""
    return Frame(SDO_RESPONSE + node, struct.pack("<BHBI", 0x80, index, sub, code))


def parse_sdo_reply(data: bytes) -> SdoReply | None:
    """Content of a server's answer, or None for one that is malformed or segmented."""
    if len(data) != 8:
        return None
    command, index, sub = struct.unpack_from("<BHB", data)
    if command == 0x80:
        return SdoReply(index, sub, b"", struct.unpack_from("<I", data, 4)[0])
    if command == 0x60:
        return SdoReply(index, sub, b"")
    if command & 0xE2 == 0x42:
        length = 4 - (command >> 2 & 3) if command & 1 else 4
        return SdoReply(index, sub, data[4 : 4 + length])
    return None


def abort_text(code: int) -> str:
    """Abort code in words."""
    try:
        return f"0x{code:08X} {SdoAbort(code).name.lower().replace('_', ' ')}"
    except ValueError:
        return f"0x{code:08X}"


def emergency_text(code: int) -> str:
    """Emergency code in words."""
    try:
        return f"0x{code:04X} {EmcyCode(code).name.lower().replace('_', ' ')}"
    except ValueError:
        return f"0x{code:04X}"
