"""A motion terminal behind its bus node, as its manuals and the published driver describe it.

What nobody has written down is assumed to our disadvantage: a valve whose slot runs no motion app keeps its
pressure, and a terminal whose host falls silent goes on with the set points that it has.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersResponse,
    ReadWriteMultipleRegistersRequest,
    ReadWriteMultipleRegistersResponse,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterResponse,
)

from soro_core.hardware.emulation.air import Air
from soro_core.hardware.emulation.faults import Injection
from soro_core.hardware.emulation.ports import ServedPorts
from soro_core.hardware.vtem.config import VtemPlatform
from soro_core.hardware.vtem.modbus import (
    READ,
    READ_WRITE,
    WRITE,
    WRITE_ONE,
    Frame,
    Frames,
    frame_of,
    message_of,
)
from soro_core.hardware.vtem.registers import (
    ACKNOWLEDGE,
    CONTROL_OF_VALVE,
    END_APP,
    SLOTS,
    WORDS,
    State,
    Status,
    command,
    pressure_of,
    word_of,
)

_TEACH = 60  # below it are motion apps
_ILLEGAL_FUNCTION, _ILLEGAL_ADDRESS, _ILLEGAL_VALUE = 1, 2, 3


class Slot:
    """One slot: its state, and what its two valves do.

    Parameters
    ----------
    outputs : list of int
        Command word and set points; the terminal writes there.
    air : callable
        Gives the pressures [Pa gauge] of its two valves.
    boot_s, start_s : float
        Time until it is ready, and until a motion app runs.
    """

    def __init__(
        self, outputs: list[int], air: Callable[[], tuple[float, float]], boot_s: float, start_s: float
    ) -> None:
        self.outputs, self._air = outputs, air
        self._boot_ns, self._start_ns = round(boot_s * 1e9), round(start_s * 1e9)
        self.status, self.is_failing, self._is_to_acknowledge = Status(END_APP, State.NOT_READY), False, False
        self._kept_pa = (0.0, 0.0)
        self._ready_ns = self._boot_ns
        self._running_ns: int | None = None

    def reboot(self, now_ns: int) -> None:
        """Lose power and come back."""
        self._rest(State.NOT_READY)
        self.outputs[:] = [0, 0, 0]
        self._ready_ns, self._is_to_acknowledge = now_ns + self._boot_ns, False

    def fail(self, is_failing: bool) -> None:
        """Begin or end an error; after its end it waits to be acknowledged."""
        self.is_failing, self._is_to_acknowledge = is_failing, True
        self._rest(State.FAILED if is_failing else State.NOT_READY)

    def advance(self, now_ns: int) -> None:
        """Do what the command word says, once it is time."""
        app, state = self.outputs[0] & 0x3F, self.status.state
        if state is State.NOT_READY:
            if self._is_to_acknowledge and self.outputs[0] == command(ACKNOWLEDGE, 1):
                self._is_to_acknowledge = False
            if not self._is_to_acknowledge and now_ns >= self._ready_ns:
                self._rest(State.READY)
        elif state is State.READY and 0 < app < _TEACH:
            if self._running_ns is None:
                self._running_ns = now_ns + self._start_ns
            if now_ns >= self._running_ns:
                self.status = Status(app, State.RUNNING)
        elif state is State.READY:
            self._running_ns = None
        elif state is State.RUNNING and app != self.status.app:
            self._rest(State.READY)

    def demand_pa(self, valve: int) -> float:
        """What a valve does: it regulates, or stays shut."""
        if self.status.regulates and self.outputs[0] >> 6 & CONTROL_OF_VALVE[valve]:
            return pressure_of(self.outputs[1 + valve])
        return self._kept_pa[valve]

    def _rest(self, state: State) -> None:
        if self.status.regulates:
            self._kept_pa = self._air()
        self.status, self._running_ns = Status(END_APP, state), None


class EmulatedTerminal(ServedPorts):
    """Bus node, terminal and air of a platform.

    In lockstep a block of outputs, with the inputs that are read after it, is a cycle; reading alone lets the
    devices' time go on as well, so that a start-up gets somewhere.

    Attributes
    ----------
    slots : list of Slot
        All eight, used or not.
    frames : Frames
        What the host has sent.
    """

    def __init__(self, platform: VtemPlatform, lockstep: bool, seed: int = 0) -> None:
        emulation = platform.emulation
        super().__init__([2 * valve.slot + valve.valve for valve in platform.valves], emulation.step_s)
        self._registers, self._lockstep = platform.registers, lockstep
        self._period_ns, self._answer_ns = round(1e9 / platform.cycle_hz), round(emulation.answer_s * 1e9)
        self.slots = [
            Slot([0] * WORDS, self._air_of(n), emulation.boot_s, emulation.app_start_s) for n in range(SLOTS)
        ]
        demands = [self._demand(slot, valve) for slot in self.slots for valve in (0, 1)]
        self.air = Air(emulation.regulator, demands, np.random.default_rng(seed))
        self.frames, self._decoder = Frames(), DecodePDU(is_server=True)
        self._frozen: dict[int, list[int]] = {}
        self._answers: deque[tuple[int, bytes]] = deque()
        self._is_written, self._last = False, -1

    def connect_faults(self, chambers: tuple[str, ...], seed: int) -> None:
        super().connect_faults(chambers, seed)
        self.faults.supported |= {"reboot", "brownout", "freeze_tpdo"}
        self.faults.on_start["reboot"] = lambda fault: self.reboot()
        self.faults.on_start["brownout"] = lambda fault: self._fail(fault, True)
        self.faults.on_end["brownout"] = lambda fault: self._fail(fault, False)
        self.faults.on_start["freeze_tpdo"] = self._freeze
        self.faults.on_end["freeze_tpdo"] = lambda fault: self._frozen.clear()

    def reboot(self) -> None:
        """The whole terminal and its node lose power and come back; the connection is gone."""
        self.air.advance(self.now_ns)
        for slot in self.slots:
            slot.reboot(self.now_ns)
        self._answers.clear()
        self.line.hang_up = True

    def end_app(self, slot: int) -> None:
        """A slot leaves its motion app, as when somebody ends it at the terminal's own web page."""
        self.air.advance(self.now_ns)
        self.slots[slot].outputs[0] = command(END_APP)
        self.slots[slot].advance(self.now_ns)

    def take(self, chunk: bytes) -> None:
        for frame in self.frames.feed(chunk):
            is_again, self._last = frame.transaction == self._last, frame.transaction
            self._advance(self.now_ns)
            answer = frame_of(self._answer_to(frame))
            if self._lockstep:
                self.line.put(answer)
            else:
                self._answers.append((self.now_ns + self._answer_ns, answer))
            if self._lockstep and not is_again and (function := frame.pdu[0]) in (READ, READ_WRITE):
                self.tick(self.now_ns + self._period_ns, self._is_written or function == READ_WRITE)

    def connected(self, has_host: bool) -> None:
        self.frames.reset()
        self._answers.clear()

    def poll(self, now_ns: int) -> None:
        self._is_written = False  # a cycle has ended
        self._advance(now_ns)

    def due_ns(self) -> int | None:
        return self._answers[0][0] if self._answers else None

    def work(self, now_ns: int) -> None:
        while self._answers and self._answers[0][0] <= now_ns:
            self.line.put(self._answers.popleft()[1])

    def _answer_to(self, frame: Frame) -> ModbusPDU:
        """What the node answers; it does not mind who is addressed."""
        function = frame.pdu[0] & 0x7F
        known = frame.pdu[0] in (READ, WRITE_ONE, WRITE, READ_WRITE)
        request = message_of(frame.pdu, self._decoder) if known else None
        if request is None:
            answer: ModbusPDU = ExceptionResponse(function, _ILLEGAL_VALUE if known else _ILLEGAL_FUNCTION)
        else:
            answer = self._done(request, len(frame.pdu))
        answer.dev_id, answer.transaction_id = frame.unit, frame.transaction
        return answer

    def _done(self, request: ModbusPDU, size: int) -> ModbusPDU:
        function = request.function_code
        target, writes, said, head = request.address, request.registers, request.count, 6
        begin, count = request.address, request.count
        if isinstance(request, ReadWriteMultipleRegistersRequest):
            target, writes, said, head = (
                request.write_address,
                request.write_registers,
                request.write_count,
                10,
            )
            begin, count = request.read_address, request.read_count
        if function in (WRITE, READ_WRITE) and not (said == len(writes) and size == head + 2 * said):
            return ExceptionResponse(function, _ILLEGAL_VALUE)
        first, begin = target - self._registers.outputs, begin - self._registers.inputs
        if function != READ and not 0 <= first <= first + len(writes) <= WORDS * SLOTS:
            return ExceptionResponse(function, _ILLEGAL_ADDRESS)
        if function in (READ, READ_WRITE) and not 0 <= begin < begin + count <= WORDS * SLOTS:
            return ExceptionResponse(function, _ILLEGAL_ADDRESS)
        if function != READ:
            self._write(first, list(writes), is_cycle=function != WRITE_ONE)
        if function == WRITE_ONE:
            return WriteSingleRegisterResponse(address=target, registers=writes)
        if function == WRITE:
            return WriteMultipleRegistersResponse(address=target, count=said)
        found = self._inputs()[begin : begin + count]
        kind = ReadHoldingRegistersResponse if function == READ else ReadWriteMultipleRegistersResponse
        return kind(registers=found)

    def _write(self, first: int, words: list[int], is_cycle: bool) -> None:
        if self._lockstep and is_cycle and self._is_written:
            self.tick(self.now_ns + self._period_ns)  # nobody has read the inputs of the cycle before
        for place, word in enumerate(words, first):
            self.slots[place // WORDS].outputs[place % WORDS] = word
        self._is_written |= is_cycle
        self._advance(self.now_ns)

    def _inputs(self) -> list[int]:
        fresh = [self._words(number) for number in range(SLOTS)]
        return [word for number, words in enumerate(fresh) for word in self._frozen.get(number, words)]

    def _words(self, number: int) -> list[int]:
        pressures = [word_of(self.air.reading_pa(2 * number + valve)) for valve in (0, 1)]
        return [self.slots[number].status.word, *pressures]

    def _advance(self, now_ns: int) -> None:
        self.air.advance(now_ns)
        for slot in self.slots:
            slot.advance(now_ns)

    def _fail(self, fault: Injection, is_failing: bool) -> None:
        self.air.advance(self.now_ns)
        self.slots[self._slot_of(fault)].fail(is_failing)

    def _freeze(self, fault: Injection) -> None:
        number = self._slot_of(fault)
        self._frozen[number] = self._words(number)

    def _slot_of(self, fault: Injection) -> int:
        return self.faults.chambers.index(fault.chamber) // 2

    def _air_of(self, number: int) -> Callable[[], tuple[float, float]]:
        def pressures() -> tuple[float, float]:
            first, second = self.air.pressure_pa[2 * number : 2 * number + 2].tolist()
            return first, second

        return pressures

    def _demand(self, slot: Slot, valve: int) -> Callable[[], float]:
        return lambda: slot.demand_pa(valve)


def emulate(platform: VtemPlatform, lockstep: bool, seed: int) -> EmulatedTerminal:
    """Emulated devices of a platform."""
    return EmulatedTerminal(platform, lockstep, seed)
