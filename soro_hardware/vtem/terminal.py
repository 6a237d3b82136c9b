"""A motion terminal: blocks of set points and readings, start and end of the motion apps.

Start-up and end are the sequences of the published driver: one command word to each slot, then the status
words are read every 10 ms until they show the new state.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.errors import HardwareError
from soro_hardware.port import EMPTY_PA
from soro_hardware.vtem import registers
from soro_hardware.vtem.client import Client
from soro_hardware.vtem.config import VtemPlatform
from soro_hardware.vtem.modbus import (
    LAST_TRANSACTION,
    read_answer,
    read_request,
    write_answer,
    write_request,
)
from soro_hardware.vtem.registers import (
    ACKNOWLEDGE,
    END_APP,
    PRESSURE_APP,
    RegisterLayout,
    SlotState,
    SlotStatus,
)

_POLL_S = 0.01


class Terminal:
    """Slots in use of one terminal.

    Parameters
    ----------
    platform : VtemPlatform
        Slots, range and times.
    client : Client
        Modbus client of the bus node.
    clock : callable
        Returns a monotonic time [s].
    lockstep : bool
        Whether each reading advances the time of the devices.

    Attributes
    ----------
    statuses : dict
        Newest status of each slot in use; empty before the first reading.
    pressure_pa : ndarray (n,)
        Newest pressures [Pa gauge] of slots that regulate; NaN before the first reading.
    sent_pa : ndarray (n,)
        Sent set points [Pa gauge].
    """

    def __init__(
        self, platform: VtemPlatform, client: Client, clock: Callable[[], float], lockstep: bool
    ) -> None:
        self.platform, self.client, self._clock, self._lockstep = platform, client, clock, lockstep
        self.layout = RegisterLayout(tuple((valve.slot, valve.valve) for valve in platform.valves))
        self._outputs = platform.registers.outputs + self.layout.offset
        self._inputs = platform.registers.inputs + self.layout.offset
        self._none: Array = np.zeros(len(platform.valves))
        self.statuses: dict[int, SlotStatus] = {}
        self.pressure_pa: Array = np.full(len(platform.valves), np.nan)
        self.sent_pa: Array = self._none
        self._is_valid: Flags = np.zeros(len(platform.valves), dtype=np.bool_)

    # -- a cycle -----------------------------------------------------------------------------------

    def exchange(self, setpoint_pa: Array, deadline_s: float) -> Flags | None:
        """Write all set points (n,) [Pa gauge] and read all inputs until `deadline_s` [s].

        Returns which chambers (n,) have a reading, or None without an answer.
        """
        words, size = self._block(setpoint_pa), self.layout.size
        if self.platform.registers.one_transaction:
            found = self.client.read_write(self._inputs, size, self._outputs, words, deadline_s)
        elif not self.client.write(self._outputs, words, deadline_s):
            return None
        else:
            found = self.client.read(self._inputs, size, deadline_s)
        return None if found is None else self._take(found)

    def vent(self) -> None:
        """Write 0 Pa without waiting for the answer."""
        self.client.post(self._outputs, self._block(self._none))

    def vent_steps(self) -> tuple[dict[str, str], ...]:
        """Return the steps of the supervisor: write 0 Pa, and read inputs that show an empty arm."""
        unit, size, words = self.platform.registers.unit, self.layout.size, self._words(self._none)
        zero = write_request(self._outputs, words, unit, LAST_TRANSACTION)
        written = write_answer(self._outputs, len(words), unit, LAST_TRANSACTION)
        asked = read_request(self._inputs, size, unit, LAST_TRANSACTION)
        head = read_answer([0] * size, unit, LAST_TRANSACTION)[: -2 * size]
        return (
            {"send": zero.decode("latin-1"), "bytes": _literal(written), "of": "terminal"},
            {
                "send": asked.decode("latin-1"),
                "bytes": _literal(head) + self.layout.empty_pattern(EMPTY_PA),
                "of": "terminal",
            },
        )

    def read(self, timeout_s: float) -> bool:
        """Read all inputs; return whether they arrived within `timeout_s` [s]."""
        found = self.client.read(self._inputs, self.layout.size, self._clock() + timeout_s)
        if found is not None:
            self._take(found)
        return found is not None

    def chambers_of(self, slot: int) -> str:
        """Return the names of the chambers of a slot, with its number."""
        names = [valve.chamber for valve in self.platform.valves if valve.slot == slot]
        return f"{', '.join(names)} (slot {slot})"

    # -- start-up and end --------------------------------------------------------------------------

    def start(self) -> None:
        """Start motion app 03 at 0 Pa in every slot, from any state, and wait until all chambers are empty.

        Raises
        ------
        HardwareError
            If a step fails; the message states the slot and the step.
        """
        times, slots = self.platform.host, self.layout.slots
        self._poll()
        running = [slot for slot in slots if self.statuses[slot].regulates]
        for slot in running:  # a valve may keep its pressure when its app ends
            self._command(slot, PRESSURE_APP, self.layout.control(slot))
        if running:
            self._await(self.is_empty, times.vent_timeout_s)
        for slot in slots:
            if self.statuses[slot].state is SlotState.RUNNING:
                self._command(slot, END_APP)
        self._await(lambda: all(s.state is not SlotState.RUNNING for s in self._all()), times.stop_timeout_s)
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
            text = f"{kept:.1f} kPa after {times.vent_timeout_s:g} s of set point 0"
            raise self._failed(slot, text, "pressure")

    def stop(self) -> None:
        """End the motion apps, which have to be at 0 Pa, and wait until they have ended."""
        for slot in self.layout.slots:
            self._command(slot, END_APP)
        self._require(
            lambda status: status.is_idle, self.platform.host.stop_timeout_s, "does not end its app"
        )

    def is_empty(self) -> bool:
        """Return whether the newest readings show every chamber of a regulating slot empty."""
        is_empty = np.abs(self.pressure_pa) < self.platform.host.vented_pa
        return bool(np.all(is_empty | ~self._is_valid))

    def _command(self, slot: int, app: int, control: int = 0) -> None:
        """Write set points 0 and a command to a slot, one word at a time, as the published driver does."""
        first = self.platform.registers.outputs + registers.WORDS * slot
        for address, word in ((first + 1, 0), (first + 2, 0), (first, registers.command(app, control))):
            deadline_s = self._clock() + self.platform.host.answer_timeout_s
            if not self.client.write_one(address, word, deadline_s):
                refusal = self.client.refusal
                raise self._failed(
                    slot, refusal or "no answer to a command", "refused" if refusal else "silent"
                )
        self.sent_pa = self._none.copy()

    def _require(self, wanted: Callable[[SlotStatus], bool], timeout_s: float, text: str) -> None:
        if not self._await(lambda: all(map(wanted, self._all())), timeout_s):
            slot = next(slot for slot in self.layout.slots if not wanted(self.statuses[slot]))
            raise self._failed(slot, f"{text} within {timeout_s:g} s: {self.statuses[slot]}")

    def _await(self, is_done: Callable[[], bool], timeout_s: float) -> bool:
        """Read until `is_done` or `timeout_s`; return `is_done`. In lockstep a reading takes one cycle."""
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
            code = "refused" if self.client.refusal else "silent"
            why = self.client.refusal or "no answer to a reading"
            slots = f"slots {self.layout.slots[0]} to {self.layout.slots[-1]}"
            text = f"{why}; are address, unit and registers right, and has it {slots}?"
            raise HardwareError(text, "motion terminal", code)

    def _all(self) -> list[SlotStatus]:
        return list(self.statuses.values())

    def _failed(self, slot: int, text: str, code: str = "refused") -> HardwareError:
        return HardwareError(text, self.chambers_of(slot), code)

    def _block(self, setpoint_pa: Array) -> list[int]:
        words = self._words(setpoint_pa)
        self.sent_pa = np.array(self.layout.setpoints(words))
        return words

    def _words(self, setpoint_pa: Array) -> list[int]:
        allowed = self.platform.range
        return self.layout.outputs(setpoint_pa.tolist(), allowed.minimum_pa, allowed.maximum_pa)

    def _take(self, inputs: list[int]) -> Flags:
        """Process a block of inputs; return which chambers (n,) have a reading: those of regulating slots."""
        self.statuses = self.layout.statuses(inputs)
        self._is_valid = np.array([self.statuses[slot].regulates for slot, _ in self.layout.places])
        self.pressure_pa = np.where(self._is_valid, self.layout.pressures(inputs), self.pressure_pa)
        return self._is_valid


def _literal(data: bytes) -> str:
    """Return a regular expression, as Latin-1, that matches exactly these bytes."""
    return re.escape(data).decode("latin-1")
