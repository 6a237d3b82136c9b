"""Modbus client over a `ByteLink`: one request, one answer, in bounded time.

The clients of pymodbus are not used: they wait, retry and reconnect by themselves, and a control loop needs
these steps bounded and counted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from soro_core.errors import HardwareError
from soro_hardware.transport.tcp import ByteLink, drain
from soro_hardware.vtem.modbus import (
    LAST_TRANSACTION,
    READ,
    READ_WRITE,
    WRITE,
    WRITE_ONE,
    ModbusDecoder,
    ModbusFrame,
    frame_of,
    message_of,
)

_ANSWERS = DecodePDU(is_server=False)
# Exceptions of a busy device, which may answer in the next cycle.
_BUSY = (5, 6)
EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "server device failure",
    5: "acknowledged, not done yet",
    6: "server device busy",
}


class Client:
    """A Modbus client of one unit; every failure of the connection is a `HardwareError` of the link.

    Parameters
    ----------
    link : ByteLink
        Connection to the bus node.
    unit : int
        Unit identifier.
    clock : callable
        Returns a monotonic time [s].

    Attributes
    ----------
    sent, received, late, refused : int
        Number of requests, of answers, of late answers, and of exceptions.
    refusal : str or None
        Exception that answered the newest request, unless the unit was busy.
    """

    def __init__(self, link: ByteLink, unit: int, clock: Callable[[], float]) -> None:
        self.link, self._unit, self._clock = link, unit, clock
        self._frames = ModbusDecoder()
        self._transaction, self._posted = 0, set[int]()
        self.sent = self.received = self.late = self.refused = self._unknown = 0
        self.refusal: str | None = None

    @property
    def garbled(self) -> int:
        """Number of damaged frames and of answers that match no request."""
        return self._frames.garbled + self._unknown

    def read(self, address: int, count: int, deadline_s: float) -> list[int] | None:
        """Read registers.

        Parameters
        ----------
        address, count : int
            First register, and number of registers.
        deadline_s : float
            Time of `clock` at which the wait ends [s].

        Returns
        -------
        list of int or None
            Words; None without an answer, or after an exception.
        """
        return self._ask(
            ReadHoldingRegistersRequest(address=address, count=count, dev_id=self._unit), count, deadline_s
        )

    def write(self, address: int, values: Sequence[int], deadline_s: float) -> bool:
        """Write registers.

        Parameters
        ----------
        address : int
            First register.
        values : sequence of int
            Words to write.
        deadline_s : float
            Time of `clock` at which the wait ends [s].

        Returns
        -------
        bool
            Whether the unit has confirmed the write.
        """
        return self._ask(self._write(address, values), 0, deadline_s) is not None

    def write_one(self, address: int, value: int, deadline_s: float) -> bool:
        """Write one register with function 6.

        Parameters
        ----------
        address, value : int
            Register, and word to write.
        deadline_s : float
            Time of `clock` at which the wait ends [s].

        Returns
        -------
        bool
            Whether the unit has confirmed the write.
        """
        request = WriteSingleRegisterRequest(address=address, registers=[value], dev_id=self._unit)
        return self._ask(request, 1, deadline_s) == [value]

    def read_write(
        self, inputs: int, count: int, outputs: int, values: Sequence[int], deadline_s: float
    ) -> list[int] | None:
        """Write registers and read others with one message; return the words as `read`.

        Parameters
        ----------
        inputs, count : int
            First register to read, and number of registers.
        outputs : int
            First register to write.
        values, deadline_s : sequence of int, float
            As in `Client.write`.
        """
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
        """Start with a new connection."""
        self._frames.reset()
        self._posted.clear()

    def _write(self, address: int, values: Sequence[int]) -> ModbusPDU:
        return WriteMultipleRegistersRequest(address=address, registers=list(values), dev_id=self._unit)

    def _send(self, request: ModbusPDU) -> None:
        has_paused = drain(self._receive_old)
        self._frames.reset()  # the rest of an old answer is no part of the next one
        self._transaction = self._transaction % (LAST_TRANSACTION - 1) + 1
        request.transaction_id = self._transaction
        self.link.send(frame_of(request))  # send always: the request may be a vent
        self.sent += 1
        if not has_paused:
            self.link.close()
            raise HardwareError("the terminal sends without a pause", code="flood")

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

    def _receive_old(self, timeout_s: float) -> bool:
        chunk = self.link.receive(timeout_s)
        for frame in self._frames.feed(chunk):
            self._take_old(frame)
        return bool(chunk)

    def _take_old(self, frame: ModbusFrame) -> None:
        """Count an answer to an earlier request."""
        is_posted = frame.transaction in self._posted
        self._posted.discard(frame.transaction)
        self.received += 1
        self.late += not is_posted

    def _answer(self, frame: ModbusFrame, request: ModbusPDU, count: int) -> tuple[list[int] | None] | None:
        """Return the words of an answer in a tuple, ``(None,)`` for an exception, None for another frame."""
        function, size = request.function_code, len(frame.pdu)
        expected = {function | 0x80: 2, function: 5 if function in (WRITE_ONE, WRITE) else 2 + 2 * count}
        is_one = frame.unit == self._unit and size == expected.get(frame.pdu[0])
        if frame.pdu[0] in (READ, READ_WRITE):  # older releases of pymodbus accept an odd byte count
            is_one = is_one and frame.pdu[1] == size - 2
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
