"""CiA 301 services as pure functions: NMT, SYNC, emergency, heartbeat; little-endian."""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import NamedTuple

from soro_hardware.transport.frame import Frame

NMT_ID, SYNC_ID, EMCY_BASE = 0x000, 0x080, 0x080
TPDO_BASES = (0x180, 0x280, 0x380, 0x480)
RPDO_BASES = (0x200, 0x300, 0x400, 0x500)
HEARTBEAT_BASE = 0x700
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
    COMMUNICATION = 0x8100  # of CANopenNode: SYNC is late
    TEMPERATURE = 0x4000
    AMBIENT_TEMPERATURE = 0x4100
    DEVICE_TEMPERATURE = 0x4200
    CAN_OVERRUN = 0x8110
    ERROR_PASSIVE = 0x8120
    HEARTBEAT_LOST = 0x8130
    BUS_OFF_RECOVERED = 0x8140
    PDO_TOO_SHORT = 0x8210
    RPDO_TIMEOUT = 0x8250
    PRESSURE_MONITORING = 0x8302


_EMERGENCIES = {int(one): one.name.lower().replace("_", " ") for one in EmcyCode if one}


class Emergency(NamedTuple):
    """Content of an emergency message: error code, error register (0x1001), five bytes of the maker."""

    code: int
    register: int
    manufacturer: bytes


def nmt(command: NmtCommand, node: int) -> Frame:
    """Return a network management command; node 0 means all nodes."""
    return Frame(NMT_ID, bytes((command, node)))


def parse_nmt(data: bytes) -> tuple[int, int] | None:
    """Return command and node, or None for a malformed message."""
    return (data[0], data[1]) if len(data) == 2 else None


def heartbeat(node: int, state: NmtState) -> Frame:
    """Return the heartbeat of a node; with the state BOOT_UP it is the boot-up message."""
    return Frame(HEARTBEAT_BASE + node, bytes((state,)))


def guard(node: int) -> Frame:
    """Return a node guarding request."""
    return Frame(HEARTBEAT_BASE + node, remote=True, length=1)


def guarded(node: int, state: NmtState, toggle: int) -> Frame:
    """Return the answer to a node guarding request.

    Parameters
    ----------
    node : int
        Node id.
    state : NmtState
    toggle : int
        Toggle bit, 0 or 1.
    """
    return Frame(HEARTBEAT_BASE + node, bytes((toggle << 7 | state,)))


def emergency(node: int, code: int, register: int) -> Frame:
    """Return an emergency message, without what a manufacturer may add.

    Parameters
    ----------
    node : int
        Node id.
    code, register : int
        Error code and error register.
    """
    return Frame(EMCY_BASE + node, struct.pack("<HB5x", code, register))


def parse_emergency(data: bytes) -> Emergency | None:
    """Return the content of an emergency message, or None for a malformed one."""
    return Emergency(*struct.unpack("<HB5s", data)) if len(data) == 8 else None


def emergency_text(code: int) -> str:
    """Emergency code in words; one that is not known has those of its class, the first two digits."""
    words = _EMERGENCIES.get(code) or _EMERGENCIES.get(code & 0xFF00, "")
    return f"0x{code:04X} {words}".rstrip()
