"""A motion terminal over Modbus TCP: requests to it, answers to the driver, damage under a driver at work."""

from __future__ import annotations

import math
import random
import struct
from functools import partial

from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    ReadWriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from soro_hardware import load_platform
from soro_hardware.emulation.vtem import EmulatedTerminal
from soro_hardware.vtem.client import Client
from soro_hardware.vtem.modbus import ModbusDecoder, frame_of, write_request
from tests.apparatus.fuzz.boards import bytes_between
from tests.apparatus.fuzz.pieces import Counted, Target, damaged

_UNIT, _OUTPUTS, _INPUTS, _WORDS = 255, 40003, 45395, 6
# A head that says that 254 bytes follow swallows so many requests of 12 bytes.
_PATIENCE = 25


def requests_to_the_terminal(pieces: int, seed: int) -> Counted:
    """What is no request is counted or refused; a good one is served behind it; pressures stay in range."""
    rng, counted = random.Random(seed), Counted()
    devices = EmulatedTerminal(load_platform("vtem_modbus"), lockstep=True)
    read = frame_of(ReadHoldingRegistersRequest(address=_INPUTS, count=_WORDS, dev_id=_UNIT))
    for number in range(pieces):
        words = [3 << 6 | 3, rng.randrange(1000), 0, 2 << 6 | 3, 0, 0]
        both = ReadWriteMultipleRegistersRequest(
            read_address=_INPUTS, read_count=6, write_address=_OUTPUTS, write_registers=words, dev_id=_UNIT
        )
        one = WriteSingleRegisterRequest(address=_OUTPUTS, registers=[61], dev_id=_UNIT)
        messages = [
            write_request(_OUTPUTS, words, _UNIT, number % 60000),
            read,
            frame_of(one),
            frame_of(both),
        ]
        before, piece = devices.frames.garbled, damaged(rng, messages)
        refusals, answers = _fed(devices, piece)
        for _ in range(_PATIENCE):
            refused, is_served = _fed(devices, read)
            refusals += refused
            if is_served > refused:
                break
        else:
            raise AssertionError(f"no request was served behind {piece.hex()}")
        is_bad = devices.frames.garbled > before or refusals > 0
        _count(counted, is_bad, answers > 0)
        if not -90e3 <= devices.pressure_pa.min() <= devices.pressure_pa.max() <= 700e3:
            raise AssertionError(f"{devices.pressure_pa} in the chambers")
    return counted


def answers_to_the_driver(pieces: int, seed: int) -> Counted:
    """An answer is taken whole or counted, and the next transaction is as good as the first."""
    rng, counted, link = random.Random(seed), Counted(), _Scripted()
    client = Client(link, _UNIT, lambda: 0.0)
    for _ in range(pieces):
        before = client.garbled + client.late + client.refused
        words = [rng.randrange(0x10000) for _ in range(_WORDS)]
        good = ReadHoldingRegistersResponse(registers=words)
        kinds: list[ModbusPDU] = [good, good, good, ExceptionResponse(3, rng.randrange(1, 12))]
        link.answer = lambda tid, kinds=kinds: damaged(rng, [_as(pdu, tid) for pdu in kinds])
        found = client.read(_INPUTS, _WORDS, math.inf)
        link.answer = lambda tid, good=good: _as(good, tid)
        if client.read(_INPUTS, _WORDS, math.inf) != words:
            raise AssertionError("a good answer was lost")
        if found is not None and len(found) != _WORDS:
            raise AssertionError(f"{found} for {_WORDS} registers")
        _count(counted, client.garbled + client.late + client.refused > before, found is not None)
    return counted


class _Scripted:
    """A connection whose other end is the fuzzer."""

    def __init__(self) -> None:
        self.answer = lambda transaction: b""
        self._coming = b""

    def send(self, data: bytes) -> None:
        self._coming = self.answer(struct.unpack_from(">H", data)[0])

    def receive(self, timeout_s: float) -> bytes:
        chunk, self._coming = self._coming, b""
        return chunk


def _as(pdu: ModbusPDU, transaction: int) -> bytes:
    pdu.transaction_id, pdu.dev_id = transaction, _UNIT
    return frame_of(pdu)


def _fed(devices: EmulatedTerminal, piece: bytes) -> tuple[int, int]:
    """Refusals among the answers to a piece, and answers."""
    devices.line.feed(piece)
    answers = ModbusDecoder().feed(bytes(devices.line.output))
    devices.line.output.clear()
    return sum(frame.pdu[0] > 0x80 for frame in answers), len(answers)


def _count(counted: Counted, is_bad: bool, is_answered: bool) -> None:
    counted.sent += 1
    counted.bad += is_bad
    counted.good += is_answered and not is_bad
    counted.untold += not is_answered and not is_bad


TARGETS: dict[str, tuple[Target, float]] = {
    "requests to the terminal": (requests_to_the_terminal, 0.3),
    "answers to the driver": (answers_to_the_driver, 0.69),
    "damage on the way, both directions": (partial(bytes_between, name="vtem_modbus"), 0.01),
}
