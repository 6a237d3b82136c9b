"""Service data objects of CiA 301 as pure functions: requests, replies and aborts; little-endian."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from soro_hardware.transport.frame import Frame

SDO_RESPONSE, SDO_REQUEST = 0x580, 0x600


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


@dataclass(frozen=True)
class SdoRequest:
    """A client's request; `data` is None for a read."""

    index: int
    sub: int
    data: bytes | None


@dataclass(frozen=True)
class SdoDownload:
    """The start of a client's segmented write, with the announced size in bytes, or None."""

    index: int
    sub: int
    size: int | None


@dataclass(frozen=True)
class SdoSegment:
    """One segment of a write or of a read; `toggle` alternates, from 0."""

    toggle: int
    data: bytes
    is_last: bool


@dataclass(frozen=True)
class SdoReply:
    """A server's answer: data of a read, empty data of a write or of a segmented read, or an abort code."""

    index: int
    sub: int
    data: bytes
    abort: int | None = None
    in_segments: bool = False

    @property
    def confirms_write(self) -> bool:
        """Whether it confirms a write; an answer to a read has data, or segments follow."""
        return not (self.data or self.in_segments or self.abort is not None)


def sdo_read(node: int, index: int, sub: int) -> Frame:
    """Return a request to read an object.

    Parameters
    ----------
    node : int
        Node id.
    index, sub : int
    """
    return Frame(SDO_REQUEST + node, struct.pack("<BHB4x", 0x40, index, sub))


def sdo_write(node: int, index: int, sub: int, data: bytes) -> Frame:
    """Return a request to write an object of one to four bytes.

    Parameters
    ----------
    node, index, sub : int
        As in `sdo_read`.
    data : bytes
        Value, little-endian.
    """
    command = 0x23 | (4 - len(data)) << 2
    return Frame(SDO_REQUEST + node, struct.pack("<BHB4s", command, index, sub, data))


def sdo_next_segment(node: int, toggle: int) -> Frame:
    """Return a request for the next segment of a read."""
    return Frame(SDO_REQUEST + node, bytes((0x60 | toggle << 4, 0, 0, 0, 0, 0, 0, 0)))


def parse_sdo_request(data: bytes) -> SdoRequest | SdoDownload | SdoSegment | SdoAbort:
    """Return a client's request, or the abort code for an unknown service."""
    if len(data) != 8:
        return SdoAbort.COMMAND
    command, index, sub = struct.unpack_from("<BHB", data)
    if command & 0xE0 == 0x00:
        return SdoSegment(command >> 4 & 1, data[1 : 8 - (command >> 1 & 7)], bool(command & 1))
    if command & 0xE2 == 0x20:  # bit 0: a size is given
        size = struct.unpack_from("<I", data, 4)[0] if command & 1 else None
        return SdoDownload(index, sub, size)
    if command == 0x40:
        return SdoRequest(index, sub, None)
    if command & 0xE2 == 0x22:  # expedited download; without a size (bit 0) all four bytes count
        length = 4 - (command >> 2 & 3) if command & 1 else 4
        return SdoRequest(index, sub, data[4 : 4 + length])
    return SdoAbort.COMMAND


def sdo_read_reply(node: int, index: int, sub: int, data: bytes) -> Frame:
    """Return a server's answer to a read of one to four bytes; parameters as in `sdo_write`."""
    command = 0x43 | (4 - len(data)) << 2
    return Frame(SDO_RESPONSE + node, struct.pack("<BHB4s", command, index, sub, data))


def sdo_write_reply(node: int, index: int, sub: int) -> Frame:
    """Return a server's answer to a write; parameters as in `sdo_read`."""
    return Frame(SDO_RESPONSE + node, struct.pack("<BHB4x", 0x60, index, sub))


def sdo_segment_reply(node: int, toggle: int) -> Frame:
    """Return a server's answer to a segment of a write."""
    return Frame(SDO_RESPONSE + node, bytes((0x20 | toggle << 4, 0, 0, 0, 0, 0, 0, 0)))


def sdo_abort(node: int, index: int, sub: int, code: int) -> Frame:
    """Return a server's refusal.

    Parameters
    ----------
    node, index, sub : int
        As in `sdo_read`.
    code : int
    """
    return Frame(SDO_RESPONSE + node, struct.pack("<BHBI", 0x80, index, sub, code))


def parse_sdo_reply(data: bytes) -> SdoReply | None:
    """Return the content of a server's answer, or None for a malformed one or a segment."""
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
    if command & 0xE2 == 0x40:
        return SdoReply(index, sub, b"", in_segments=True)
    return None


def parse_sdo_segment(data: bytes) -> SdoSegment | None:
    """Return the segment of a read in a server's answer, or None for another answer."""
    if len(data) != 8 or data[0] & 0xE0:
        return None
    return SdoSegment(data[0] >> 4 & 1, data[1 : 8 - (data[0] >> 1 & 7)], bool(data[0] & 1))


def abort_text(code: int) -> str:
    """Abort code in words."""
    try:
        return f"0x{code:08X} {SdoAbort(code).name.lower().replace('_', ' ')}"
    except ValueError:
        return f"0x{code:08X}"
