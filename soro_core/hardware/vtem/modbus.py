"""Modbus TCP over a `ByteLink`: one request, one answer, always bounded in time.

pymodbus builds the frames and reads the messages in them. Its clients are not used: they wait, retry and
reconnect by themselves, and a control loop needs all of that bounded and counted. Its framer is not asked to
read: at a damaged header it waits for ever.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable, Sequence
from typing import NamedTuple

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from soro_core.errors import HardwareError
from soro_core.hardware.transport.tcp import ByteLink, drain

# What is damaged is counted here; without a handler Python would print pymodbus' words for it.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

READ, WRITE_ONE, WRITE, READ_WRITE = 3, 6, 16, 23
# The transaction of the process that vents in need: no request of a driver has it.
LAST_TRANSACTION = 0xFFFF
_HEADER = struct.Struct(">HHHB")
_LONGEST = 254  # unit and message
# Not now, but perhaps in the next cycle.
_BUSY = (5, 6)
EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "server device failure",
    5: "acknowledged, not done yet",
    6: "server device busy",
}


class Frame(NamedTuple):
    """One message on its way."""

    transaction: int
    unit: int
    pdu: bytes


class Frames:
    """Frames out of a stream of bytes.

    Attributes
    ----------
    garbled : int
        Headers that were none. What came with one is dropped: nothing marks the begin of the next frame.
    """

    def __init__(self) -> None:
        self.garbled = 0
        self._buffer = b""

    def feed(self, chunk: bytes) -> list[Frame]:
        """Take bytes; every complete frame, oldest first."""
        self._buffer += chunk
        found: list[Frame] = []
        while len(self._buffer) >= _HEADER.size:
            transaction, protocol, length, unit = _HEADER.unpack_from(self._buffer)
            if protocol or not 2 <= length <= _LONGEST:
                self.garbled += 1
                self._buffer = b""
                break
            end = _HEADER.size - 1 + length
            if len(self._buffer) < end:
                break
            found.append(Frame(transaction, unit, self._buffer[_HEADER.size : end]))
            self._buffer = self._buffer[end:]
        return found

    def reset(self) -> None:
        """Forget a frame that has not ended; it is counted."""
        self.garbled += bool(self._buffer)
        self._buffer = b""


_FRAMER = FramerSocket(DecodePDU(is_server=False))
_ANSWERS = DecodePDU(is_server=False)


def message_of(pdu: bytes, decoder: DecodePDU) -> ModbusPDU | None:
    """What bytes of a frame mean, or None; older releases of pymodbus raise at some that are damaged."""
    try:
        return decoder.decode(pdu)
    except (struct.error, ModbusException):
        return None


def frame_of(message: ModbusPDU) -> bytes:
    """Bytes of a request or an answer."""
    frame: bytes = _FRAMER.buildFrame(message)
    return frame


def write_request(address: int, values: Sequence[int], unit: int, transaction: int) -> bytes:
    """Bytes of a request that writes registers."""
    return frame_of(
        WriteMultipleRegistersRequest(
            address=address, registers=list(values), dev_id=unit, transaction_id=transaction
        )
    )


def write_answer(address: int, count: int, unit: int, transaction: int) -> bytes:
    """Bytes of the answer that confirms `write_request`."""
    return _HEADER.pack(transaction, 0, 6, unit) + struct.pack(">BHH", WRITE, address, count)


class Client:
    """A Modbus master of one unit; every failure of the connection is a `HardwareError` of the link.

    Attributes
    ----------
    sent, received, late, refused : int
        Requests; answers, of these late ones; exceptions that were answered.
    refusal : str or None
        What the newest request was refused with, unless the unit was only busy.
    """

    def __init__(self, link: ByteLink, unit: int, clock: Callable[[], float]) -> None:
        self.link, self._unit, self._clock = link, unit, clock
        self._frames = Frames()
        self._transaction, self._posted = 0, set[int]()
        self.sent = self.received = self.late = self.refused = self._unknown = 0
        self.refusal: str | None = None

    @property
    def garbled(self) -> int:
        """Frames that were none, or no answer."""
        return self._frames.garbled + self._unknown

    def read(self, address: int, count: int, deadline_s: float) -> list[int] | None:
        """Read registers; None if they have not come by then."""
        return self._ask(
            ReadHoldingRegistersRequest(address=address, count=count, dev_id=self._unit), count, deadline_s
        )

    def write(self, address: int, values: Sequence[int], deadline_s: float) -> bool:
        """Write registers; whether that was confirmed by then."""
        return self._ask(self._write(address, values), 0, deadline_s) is not None

    def write_one(self, address: int, value: int, deadline_s: float) -> bool:
        """Write one register, by the function for it."""
        request = WriteSingleRegisterRequest(address=address, registers=[value], dev_id=self._unit)
        return self._ask(request, 1, deadline_s) == [value]

    def read_write(
        self, inputs: int, count: int, outputs: int, values: Sequence[int], deadline_s: float
    ) -> list[int] | None:
        """Write registers and read others, by one message."""
        request = ReadWriteMultipleRegistersRequest(
            read_address=inputs,
            read_count=count,
            write_address=outputs,
            write_registers=list(values),
            dev_id=self._unit,
        )
        return self._ask(request, count, deadline_s)

    def post(self, address: int, values: Sequence[int]) -> None:
        """Write registers without waiting for the answer."""
        self._send(self._write(address, values))
        self._posted.add(self._transaction)

    def reset(self) -> None:
        """Begin with a new connection."""
        self._frames.reset()
        self._posted.clear()

    def _write(self, address: int, values: Sequence[int]) -> ModbusPDU:
        return WriteMultipleRegistersRequest(address=address, registers=list(values), dev_id=self._unit)

    def _send(self, request: ModbusPDU) -> None:
        has_paused = drain(self._hear)
        self._frames.reset()  # what is left of an answer is no part of the next
        self._transaction = self._transaction % (LAST_TRANSACTION - 1) + 1
        request.transaction_id = self._transaction
        self.link.send(frame_of(request))  # in any case: it may be a vent
        self.sent += 1
        if not has_paused:
            self.link.close()
            raise HardwareError("the terminal sends without a pause")

    def _ask(self, request: ModbusPDU, count: int, deadline_s: float) -> list[int] | None:
        self.refusal = None
        self._send(request)
        while True:
            left_s = max(deadline_s - self._clock(), 0.0)
            chunk = self.link.receive(left_s)
            answer: tuple[list[int] | None] | None = None
            for frame in self._frames.feed(chunk):
                if answer is not None or frame.transaction != self._transaction:
                    self._take_old(frame)
                else:
                    answer = self._answer(frame, request, count)
            if answer is not None:
                return answer[0]
            if not chunk or left_s == 0:
                return None

    def _hear(self, timeout_s: float) -> bool:
        chunk = self.link.receive(timeout_s)
        for frame in self._frames.feed(chunk):
            self._take_old(frame)
        return bool(chunk)

    def _take_old(self, frame: Frame) -> None:
        """An answer to an earlier request: of use to nobody, for it says nothing of now."""
        is_posted = frame.transaction in self._posted
        self._posted.discard(frame.transaction)
        self.received += 1
        self.late += not is_posted

    def _answer(self, frame: Frame, request: ModbusPDU, count: int) -> tuple[list[int] | None] | None:
        """What a frame answers, None if it is no answer: registers, or None in their place if refused."""
        function, size = request.function_code, len(frame.pdu)
        expected = {function | 0x80: 2, function: 5 if function in (WRITE_ONE, WRITE) else 2 + 2 * count}
        is_one = frame.unit == self._unit and size == expected.get(frame.pdu[0])
        found = message_of(frame.pdu, _ANSWERS) if is_one else None
        if found is None:
            self._unknown += 1
            return None
        if isinstance(found, ExceptionResponse):
            self.received += 1
            self.refused += 1
            if found.exception_code not in _BUSY:
                text = EXCEPTIONS.get(found.exception_code, "unknown")
                self.refusal = f"exception {found.exception_code} ({text}) to function {function}"
            return (None,)
        is_echo = found.address == request.address
        if function == WRITE:
            is_echo = is_echo and found.count == request.count
        if (function in (WRITE_ONE, WRITE) and not is_echo) or len(found.registers) != count:
            self._unknown += 1
            return None
        self.received += 1
        return (list(found.registers),)
