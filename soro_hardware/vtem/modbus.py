"""Frames of Modbus TCP.

pymodbus encodes the frames and decodes the messages. Its framer is not used for reading: after a damaged
header it waits forever.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Sequence
from typing import NamedTuple

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    WriteMultipleRegistersRequest,
)

# This module counts damaged frames; without a handler Python would print the warnings of pymodbus.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

READ, WRITE_ONE, WRITE, READ_WRITE = 3, 6, 16, 23
# Transaction number of the supervisor; no request of a driver has it.
LAST_TRANSACTION = 0xFFFF
_HEADER = struct.Struct(">HHHB")
_LONGEST = 254  # unit and message: 123 registers written at most
_MOST_READ = 125


class ModbusFrame(NamedTuple):
    """One message with transaction number and unit."""

    transaction: int
    unit: int
    pdu: bytes


class ModbusDecoder:
    """Decodes frames from a byte stream.

    Attributes
    ----------
    garbled : int
        Number of invalid headers. The bytes after one are dropped, because nothing marks the next frame.
    """

    def __init__(self) -> None:
        self.garbled = 0
        self._buffer = b""

    def feed(self, chunk: bytes) -> list[ModbusFrame]:
        """Process bytes; return the complete frames, oldest first."""
        self._buffer += chunk
        found: list[ModbusFrame] = []
        while len(self._buffer) >= _HEADER.size:
            transaction, protocol, length, unit = _HEADER.unpack_from(self._buffer)
            if protocol or not 2 <= length <= _LONGEST:
                self.garbled += 1
                self._buffer = b""
                break
            end = _HEADER.size - 1 + length
            if len(self._buffer) < end:
                break
            found.append(ModbusFrame(transaction, unit, self._buffer[_HEADER.size : end]))
            self._buffer = self._buffer[end:]
        return found

    def reset(self) -> None:
        """Drop and count an incomplete frame."""
        self.garbled += bool(self._buffer)
        self._buffer = b""


_FRAMER = FramerSocket(DecodePDU(is_server=False))


def message_of(pdu: bytes, decoder: DecodePDU) -> ModbusPDU | None:
    """Decode a message; None if it is damaged, for which older releases of pymodbus raise."""
    try:
        return decoder.decode(pdu)
    except (struct.error, ModbusException):
        return None


def agrees(pdu: bytes) -> bool:
    """Return whether quantities, byte count and length of a request agree."""
    function, size = pdu[0], len(pdu)
    if function == WRITE_ONE:
        return size == 5
    head = {READ: 5, WRITE: 6, READ_WRITE: 10}[function]
    if size < head:
        return False
    if function != WRITE and not 1 <= int.from_bytes(pdu[3:5], "big") <= _MOST_READ:
        return False
    if function == READ:
        return size == head
    count = int.from_bytes(pdu[head - 3 : head - 1], "big")
    return count >= 1 and pdu[head - 1] == 2 * count == size - head


def frame_of(message: ModbusPDU) -> bytes:
    """Return the bytes of a request or an answer."""
    frame: bytes = _FRAMER.buildFrame(message)
    return frame


def write_request(address: int, values: Sequence[int], unit: int, transaction: int) -> bytes:
    """Return the bytes of a request that writes registers.

    Parameters
    ----------
    address : int
        First register.
    values : sequence of int
        Words to write.
    unit, transaction : int
        Unit identifier and transaction number.
    """
    return frame_of(
        WriteMultipleRegistersRequest(
            address=address, registers=list(values), dev_id=unit, transaction_id=transaction
        )
    )


def read_request(address: int, count: int, unit: int, transaction: int) -> bytes:
    """Return the bytes of a request that reads registers.

    Parameters
    ----------
    address, count : int
        First register, and number of registers.
    unit, transaction : int
        Unit identifier and transaction number.
    """
    return frame_of(
        ReadHoldingRegistersRequest(address=address, count=count, dev_id=unit, transaction_id=transaction)
    )


def read_answer(registers: Sequence[int], unit: int, transaction: int) -> bytes:
    """Return the bytes of the answer to `read_request`.

    Parameters
    ----------
    registers : sequence of int
        Words of the answer.
    unit, transaction : int
        Unit identifier and transaction number.
    """
    return frame_of(
        ReadHoldingRegistersResponse(registers=list(registers), dev_id=unit, transaction_id=transaction)
    )


def write_answer(address: int, count: int, unit: int, transaction: int) -> bytes:
    """Return the bytes of the answer to `write_request`; parameters as in `read_request`."""
    return _HEADER.pack(transaction, 0, 6, unit) + struct.pack(">BHH", WRITE, address, count)
