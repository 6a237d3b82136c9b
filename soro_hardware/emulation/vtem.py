"""A motion terminal behind its bus node, after its manuals and the published driver.

Where the sources state nothing, the worst case is assumed: a valve whose slot runs no motion app keeps its
pressure, and a terminal without messages from its host keeps its set points.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersResponse,
    ReadWriteMultipleRegistersRequest,
    ReadWriteMultipleRegistersResponse,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterResponse,
)

from soro_hardware.emulation.devices import ServedDevices
from soro_hardware.vtem.config import VtemPlatform
from soro_hardware.vtem.modbus import (
    READ,
    READ_WRITE,
    WRITE,
    WRITE_ONE,
    ModbusDecoder,
    ModbusFrame,
    agrees,
    frame_of,
    message_of,
)
from soro_hardware.vtem.registers import (
    ACKNOWLEDGE,
    CONTROL_OF_VALVE,
    END_APP,
    PRESSURE_APP,
    SLOTS,
    WORDS,
    SlotState,
    SlotStatus,
    command,
    pressure_of,
    word_of,
)

_TEACH = 60  # the motion apps have smaller numbers
_ILLEGAL_FUNCTION, _ILLEGAL_ADDRESS, _ILLEGAL_VALUE = 1, 2, 3


class EmulatedSlot:
    """One slot: its state and its two valves.

    Parameters
    ----------
    air : callable
        Returns the pressures [Pa gauge] of the two valves.
    boot_s, start_s : float
        Time [s] from power-on to READY, and from the command to a running motion app.
    wake : list of int
        Output words of the slot at power-on.
    """

    def __init__(
        self,
        air: Callable[[], tuple[float, float]],
        boot_s: float,
        start_s: float,
        wake: list[int],
    ) -> None:
        self.outputs, self._wake, self._air = list(wake), wake, air
        self._boot_ns, self._start_ns = round(boot_s * 1e9), round(start_s * 1e9)
        self.status = SlotStatus(END_APP, SlotState.NOT_READY)
        self.is_failing = self._is_to_acknowledge = False
        self._kept_pa = (0.0, 0.0)
        self._ready_ns = self._boot_ns
        self._running_ns: int | None = None

    def reboot(self, now_ns: int) -> None:
        """Restart as after a loss of power, at a time [ns]."""
        self._rest(SlotState.NOT_READY)
        self.outputs[:] = self._wake
        self._ready_ns, self._is_to_acknowledge = now_ns + self._boot_ns, False

    def fail(self, is_failing: bool) -> None:
        """Begin or end an error; after its end the slot waits for the acknowledgement."""
        self.is_failing, self._is_to_acknowledge = is_failing, True
        self._rest(SlotState.FAILED if is_failing else SlotState.NOT_READY)

    def advance(self, now_ns: int) -> None:
        """Execute the command word when its time is over."""
        app, state = self.outputs[0] & 0x3F, self.status.state
        if state is SlotState.NOT_READY:
            if self._is_to_acknowledge and self.outputs[0] == command(ACKNOWLEDGE, 1):
                self._is_to_acknowledge = False
            if not self._is_to_acknowledge and now_ns >= self._ready_ns:
                self._rest(SlotState.READY)
        elif state is SlotState.READY and 0 < app < _TEACH:
            if self._running_ns is None:
                self._running_ns = now_ns + self._start_ns
            if now_ns >= self._running_ns:
                self.status = SlotStatus(app, SlotState.RUNNING)
        elif state is SlotState.READY:
            self._running_ns = None
        elif state is SlotState.RUNNING and app != self.status.app:
            self._rest(SlotState.READY)

    def demand_pa(self, valve: int) -> float:
        """Return the pressure [Pa gauge] that a valve regulates, or keeps while it is closed."""
        if self.status.regulates and self.outputs[0] >> 6 & CONTROL_OF_VALVE[valve]:
            return pressure_of(self.outputs[1 + valve])
        return self._kept_pa[valve]

    def _rest(self, state: SlotState) -> None:
        if self.status.regulates:
            self._kept_pa = self._air()
        self.status, self._running_ns = SlotStatus(END_APP, state), None


class EmulatedTerminal(ServedDevices):
    """Bus node, terminal and air of a platform; parameters as in `EmulatedDevices`.

    In lockstep a write of the outputs and the following read of the inputs are one cycle. A read alone also
    advances the time by one cycle, so that the start-up ends.

    Attributes
    ----------
    slots : list of EmulatedSlot
        All eight slots, used or not.
    frames : ModbusDecoder
        Decoder of the host's messages.
    """

    def __init__(self, platform: VtemPlatform, lockstep: bool, seed: int = 0) -> None:
        emulation = platform.emulation
        super().__init__(platform, lockstep, seed)
        self._registers, self._answer_ns = platform.registers, round(emulation.answer_s * 1e9)
        self.slots = [
            EmulatedSlot(
                self._air_of(n), emulation.boot_s, emulation.app_start_s, _outputs_of(emulation.wake_pa)
            )
            for n in range(SLOTS)
        ]
        demands = [self._demand(slot, valve) for slot in self.slots for valve in (0, 1)]
        self.connect_air(demands, (2 * valve.slot + valve.valve for valve in platform.valves))
        self.on_fault("reboot", lambda _: self.reboot())
        self.while_fault("brownout", self._fail)
        self.on_fault("freeze_tpdo", self._freeze, lambda _: self._frozen.clear())
        self.frames, self._decoder = ModbusDecoder(), DecodePDU(is_server=True)
        self._frozen: dict[int, list[int]] = {}
        self._answers: deque[tuple[int, bytes]] = deque()
        self._is_written, self._last = False, -1

    def reboot(self) -> None:
        """Restart terminal and node as after a loss of power; the connection ends."""
        self.air.advance(self.now_ns)
        for slot in self.slots:
            slot.reboot(self.now_ns)
        self._answers.clear()
        self.line.hang_up = True

    def end_app(self, slot: int) -> None:
        """End the motion app of a slot, as a user can on the web page of the terminal."""
        self.air.advance(self.now_ns)
        self.slots[slot].outputs[0] = command(END_APP)
        self.slots[slot].advance(self.now_ns)

    def take(self, chunk: bytes) -> None:
        for frame in self.frames.feed(chunk):
            is_again, self._last = frame.transaction == self._last, frame.transaction
            self._advance(self.now_ns)
            answer = frame_of(self._answer_to(frame))
            if self.lockstep:
                self.line.put(answer)
            else:
                self._answers.append((self.now_ns + self._answer_ns, answer))
            if self.lockstep and not is_again and (function := frame.pdu[0]) in (READ, READ_WRITE):
                self.end_cycle(self._is_written or function == READ_WRITE)

    def connected(self, has_host: bool) -> None:
        self.frames.reset()
        self._answers.clear()

    def poll(self, now_ns: int) -> None:
        self._is_written = False  # a cycle has ended
        self._advance(now_ns)

    def give_setpoint(self, place: int, pressure_pa: float) -> None:
        self.slots[place // 2].outputs[1 + place % 2] = word_of(pressure_pa)

    def due_ns(self) -> int | None:
        return self._answers[0][0] if self._answers else None

    def work(self, now_ns: int) -> None:
        while self._answers and self._answers[0][0] <= now_ns:
            self.line.put(self._answers.popleft()[1])

    def _answer_to(self, frame: ModbusFrame) -> ModbusPDU:
        """Return the node's answer, which does not depend on the unit."""
        function = frame.pdu[0] & 0x7F
        known = frame.pdu[0] in (READ, WRITE_ONE, WRITE, READ_WRITE)
        request = message_of(frame.pdu, self._decoder) if known and agrees(frame.pdu) else None
        if request is None:
            answer: ModbusPDU = ExceptionResponse(function, _ILLEGAL_VALUE if known else _ILLEGAL_FUNCTION)
        else:
            answer = self._done(request)
        answer.dev_id, answer.transaction_id = frame.unit, frame.transaction
        return answer

    def _done(self, request: ModbusPDU) -> ModbusPDU:
        function = request.function_code
        target, writes = request.address, request.registers
        begin, count = request.address, request.count
        if isinstance(request, ReadWriteMultipleRegistersRequest):
            target, writes = request.write_address, request.write_registers
            begin, count = request.read_address, request.read_count
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
            return WriteMultipleRegistersResponse(address=target, count=len(writes))
        found = self._inputs()[begin : begin + count]
        kind = ReadHoldingRegistersResponse if function == READ else ReadWriteMultipleRegistersResponse
        return kind(registers=found)

    def _write(self, first: int, words: list[int], is_cycle: bool) -> None:
        if self.lockstep and is_cycle and self._is_written:
            self.end_cycle()  # the host has not read the inputs of the last cycle
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

    def _fail(self, place: int, is_failing: bool) -> None:
        self.air.advance(self.now_ns)
        self.slots[place // 2].fail(is_failing)

    def _freeze(self, place: int) -> None:
        self._frozen[place // 2] = self._words(place // 2)

    def _air_of(self, number: int) -> Callable[[], tuple[float, float]]:
        def pressures() -> tuple[float, float]:
            first, second = self.air.pressure_pa[2 * number : 2 * number + 2].tolist()
            return first, second

        return pressures

    def _demand(self, slot: EmulatedSlot, valve: int) -> Callable[[], float]:
        return lambda: slot.demand_pa(valve)


def _outputs_of(wake_pa: float | None) -> list[int]:
    """Return command word and set points at power-on; with a pressure the slot starts its app by itself."""
    if wake_pa is None:
        return [0] * WORDS
    return [command(PRESSURE_APP, sum(CONTROL_OF_VALVE)), word_of(wake_pa), word_of(wake_pa)]
