"""A motion terminal by its registers: blocks of set points and readings, and the life of its motion apps.

Start-up and end are sequences of the published driver: a command word a slot, then the status words are read
until they say so, 100 times a second.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.port import Array, Flags
from soro_core.hardware.vtem import registers
from soro_core.hardware.vtem.config import VtemPlatform
from soro_core.hardware.vtem.modbus import Client, write_answer, write_request
from soro_core.hardware.vtem.registers import ACKNOWLEDGE, END_APP, PRESSURE_APP, Layout, State, Status

_POLL_S = 0.01


class Terminal:
    """Slots of one terminal that feed chambers.

    Attributes
    ----------
    statuses : dict
        Newest status of each slot in use; empty before the first.
    pressure_pa : ndarray (n,)
        Newest pressures [Pa gauge] of slots that regulate; NaN before the first.
    sent_pa : ndarray (n,)
        Last set points [Pa gauge] as they went out.
    """

    def __init__(
        self, platform: VtemPlatform, client: Client, clock: Callable[[], float], lockstep: bool
    ) -> None:
        self.platform, self.client, self._clock, self._lockstep = platform, client, clock, lockstep
        self.layout = Layout(tuple((valve.slot, valve.valve) for valve in platform.valves))
        self._outputs = platform.registers.outputs + self.layout.offset
        self._inputs = platform.registers.inputs + self.layout.offset
        self._none: Array = np.zeros(len(platform.valves))
        self.statuses: dict[int, Status] = {}
        self.pressure_pa: Array = np.full(len(platform.valves), np.nan)
        self.sent_pa: Array = self._none
        self._is_valid: Flags = np.zeros(len(platform.valves), dtype=np.bool_)

    # -- a cycle -----------------------------------------------------------------------------------

    def exchange(self, setpoint_pa: Array, deadline_s: float) -> Flags | None:
        """Write all set points and read all inputs; where these are of now, None if they did not come."""
        words, size = self._block(setpoint_pa), self.layout.size
        if self.platform.registers.one_transaction:
            found = self.client.read_write(self._inputs, size, self._outputs, words, deadline_s)
        elif not self.client.write(self._outputs, words, deadline_s):
            return None
        else:
            found = self.client.read(self._inputs, size, deadline_s)
        return None if found is None else self._take(found)

    def vent(self) -> None:
        """Write 0 Pa, without waiting."""
        self.client.post(self._outputs, self._block(self._none))

    def vent_bytes(self) -> tuple[bytes, bytes]:
        """The same as bytes, for the process that vents when this one dies, and the answer to it."""
        unit, last = self.platform.registers.unit, 0xFFFF
        words = self._words(self._none)
        return (
            write_request(self._outputs, words, unit, last),
            write_answer(self._outputs, len(words), unit, last),
        )

    def read(self, timeout_s: float) -> bool:
        """Read all inputs; whether they came."""
        found = self.client.read(self._inputs, self.layout.size, self._clock() + timeout_s)
        if found is not None:
            self._take(found)
        return found is not None

    def chambers_of(self, slot: int) -> str:
        """Names of the chambers of a slot, and where it is."""
        names = [valve.chamber for valve in self.platform.valves if valve.slot == slot]
        return f"{', '.join(names)} (slot {slot})"

    # -- start-up and end --------------------------------------------------------------------------

    def start(self) -> None:
        """Bring every slot from whatever it does to motion app 03 at 0 Pa, and wait until it is empty.

        Raises
        ------
        HardwareError
            One line that names slot and step.
        """
        times, slots = self.platform.host, self.layout.slots
        self._poll()
        running = [slot for slot in slots if self.statuses[slot].regulates]
        for slot in running:  # ended with pressure behind it, a valve might keep it
            self._command(slot, PRESSURE_APP, self.layout.control(slot))
        if running:
            self._await(self.is_empty, times.vent_timeout_s)
        for slot in slots:
            if self.statuses[slot].state is State.RUNNING:
                self._command(slot, END_APP)
        self._await(lambda: all(s.state is not State.RUNNING for s in self._all()), times.stop_timeout_s)
        for slot in slots:
            if not self.statuses[slot].is_idle:
                self._command(slot, ACKNOWLEDGE, registers.ACKNOWLEDGE_CONTROL)
        self._require(lambda status: status.is_idle, times.start_timeout_s, "does not get ready")
        for slot in slots:
            self._command(slot, PRESSURE_APP, self.layout.control(slot))
        self._require(lambda status: status.regulates, times.start_timeout_s, "does not run motion app 03")
        if not self._await(self.is_empty, times.vent_timeout_s):
            n = int(np.argmax(np.abs(self.pressure_pa)))
            slot, kept = self.platform.valves[n].slot, self.pressure_pa[n] / 1e3
            raise self._failed(slot, f"{kept:.1f} kPa after {times.vent_timeout_s:g} s of set point 0")

    def stop(self) -> None:
        """End the motion apps, which must be at 0 Pa, and wait until they have ended."""
        for slot in self.layout.slots:
            self._command(slot, END_APP)
        self._require(
            lambda status: status.is_idle, self.platform.host.stop_timeout_s, "does not end its app"
        )

    def is_empty(self) -> bool:
        """Whether the newest readings show every chamber empty whose slot regulates."""
        is_empty = np.abs(self.pressure_pa) < self.platform.host.vented_pa
        return bool(np.all(is_empty | ~self._is_valid))

    def _command(self, slot: int, app: int, control: int = 0) -> None:
        """Command a slot, by one word at a time as it is known to work: set points first, and 0."""
        first = self.platform.registers.outputs + registers.WORDS * slot
        for address, word in ((first + 1, 0), (first + 2, 0), (first, registers.command(app, control))):
            deadline_s = self._clock() + self.platform.host.answer_timeout_s
            if not self.client.write_one(address, word, deadline_s):
                raise self._failed(slot, self.client.refusal or "no answer to a command")
        self.sent_pa = self._none.copy()

    def _require(self, wanted: Callable[[Status], bool], timeout_s: float, text: str) -> None:
        if not self._await(lambda: all(map(wanted, self._all())), timeout_s):
            slot = next(slot for slot in self.layout.slots if not wanted(self.statuses[slot]))
            raise self._failed(slot, f"{text} within {timeout_s:g} s: {self.statuses[slot]}")

    def _await(self, is_done: Callable[[], bool], timeout_s: float) -> bool:
        """Read until something is so; whether it is. In lockstep a reading takes a cycle of the devices."""
        period_s = 1.0 / self.platform.cycle_hz if self._lockstep else _POLL_S
        for _ in range(max(round(timeout_s / period_s), 1)):
            if is_done():
                return True
            if not self._lockstep:
                time.sleep(_POLL_S)
            self._poll()
        return is_done()

    def _poll(self) -> None:
        if not self.read(self.platform.host.answer_timeout_s):
            why = self.client.refusal or "no answer to a reading"
            raise HardwareError(f"motion terminal: {why}; are address, unit and registers right?")

    def _all(self) -> list[Status]:
        return list(self.statuses.values())

    def _failed(self, slot: int, text: str) -> HardwareError:
        return HardwareError(f"{self.chambers_of(slot)}: {text}")

    def _block(self, setpoint_pa: Array) -> list[int]:
        words = self._words(setpoint_pa)
        self.sent_pa = np.array(self.layout.setpoints(words))
        return words

    def _words(self, setpoint_pa: Array) -> list[int]:
        allowed = self.platform.range
        return self.layout.outputs(setpoint_pa.tolist(), allowed.minimum_pa, allowed.maximum_pa)

    def _take(self, inputs: list[int]) -> Flags:
        """Where a block of inputs has readings: a slot that regulates nothing says nothing of pressure."""
        self.statuses = self.layout.statuses(inputs)
        self._is_valid = np.array([self.statuses[slot].regulates for slot, _ in self.layout.places])
        self.pressure_pa = np.where(self._is_valid, self.layout.pressures(inputs), self.pressure_pa)
        return self._is_valid
