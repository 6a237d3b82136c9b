"""Words of a VTEM motion terminal: three a slot in both directions, pressures in mbar.

Outputs (to the terminal): command ``app control << 6 | app``, set point of valve 0, of valve 1. Inputs:
status ``state << 6 | app`` with eight bits of the app above, pressure of valve 0, of valve 1. Sources: the
manual of the terminal (structure of PDO and PDI, states), that of motion app 03 (range), and a public ROS 2
driver (tud-cor-sr/ros2-vtem-control), which has moved soft arms with these addresses, apps and states.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

SLOTS, WORDS = 8, 3
PA_PER_MBAR = 100.0
LOWEST_PA, HIGHEST_PA = -90e3, 700e3

PRESSURE_APP, END_APP, ACKNOWLEDGE = 3, 61, 62
ACKNOWLEDGE_CONTROL = 1
# Bits of the app control by which motion app 03 regulates a valve of its slot.
CONTROL_OF_VALVE = (2, 1)


class SlotState(IntEnum):
    """State of a slot."""

    NOT_READY = 0
    READY = 1
    RUNNING = 2
    FAILED = 3


_TEXTS = {
    SlotState.NOT_READY: "not ready: it starts, or an error waits to be acknowledged",
    SlotState.READY: "ready",
    SlotState.RUNNING: "running",
    SlotState.FAILED: "failure: an error that still lasts",
}


@dataclass(frozen=True)
class SlotStatus:
    """Status of a slot.

    Attributes
    ----------
    app : int
        Running motion app, or `END_APP` without one.
    state : SlotState
        State of the slot.
    """

    app: int
    state: SlotState

    @classmethod
    def of(cls, word: int) -> SlotStatus:
        """Read a status word."""
        return cls(word & 0x3F, SlotState(word >> 6 & 3))

    @property
    def word(self) -> int:
        """The reverse of `of`."""
        return self.state << 6 | self.app

    @property
    def regulates(self) -> bool:
        """Whether motion app 03 runs."""
        return self.app == PRESSURE_APP and self.state is SlotState.RUNNING

    @property
    def is_idle(self) -> bool:
        """Whether no app runs and an app can be started."""
        return self.app == END_APP and self.state is SlotState.READY

    def __str__(self) -> str:
        return f"app {self.app}, {_TEXTS[self.state]}"


def command(app: int, control: int = 0) -> int:
    """Return a command word."""
    return control << 6 | app


def word_of(pressure_pa: float) -> int:
    """Return a pressure [Pa gauge] as a word: mbar, two's complement."""
    return max(min(round(pressure_pa / PA_PER_MBAR), 0x7FFF), -0x8000) & 0xFFFF


def pressure_of(word: int) -> float:
    """The reverse of `word_of`."""
    return (word - 0x10000 if word & 0x8000 else word) * PA_PER_MBAR


@dataclass(frozen=True)
class RegisterLayout:
    """Places of the words in the block of outputs, and of inputs, from the first slot in use to the last.

    Parameters
    ----------
    places : tuple of (slot, valve)
        Slot and valve of each chamber, in the order of the platform.
    """

    places: tuple[tuple[int, int], ...]

    @property
    def slots(self) -> tuple[int, ...]:
        """Slots in use, in order."""
        return tuple(sorted({slot for slot, _ in self.places}))

    @property
    def offset(self) -> int:
        """Number of words before the block."""
        return WORDS * self.slots[0]

    @property
    def size(self) -> int:
        """Number of words of the block."""
        return WORDS * (self.slots[-1] - self.slots[0] + 1)

    def control(self, slot: int) -> int:
        """Return the app control with which a slot regulates its valves in use."""
        return sum(CONTROL_OF_VALVE[valve] for where, valve in self.places if where == slot)

    def outputs(self, setpoint_pa: Sequence[float], lowest_pa: float, highest_pa: float) -> list[int]:
        """Return the block of outputs for set points; slots without a chamber run no motion app.

        Parameters
        ----------
        setpoint_pa : sequence of float, length n
            Set points [Pa gauge].
        lowest_pa, highest_pa : float
            Range [Pa gauge], which the rounding to mbar does not exceed.

        Returns
        -------
        list of int
            Words.
        """
        low, high = math.ceil(lowest_pa / PA_PER_MBAR), math.floor(highest_pa / PA_PER_MBAR)
        words = [command(END_APP), 0, 0] * (self.size // WORDS)
        for slot in self.slots:
            words[self._word(slot)] = command(PRESSURE_APP, self.control(slot))
        for (slot, valve), value in zip(self.places, setpoint_pa, strict=True):
            mbar = min(max(round(value / PA_PER_MBAR), low), high)
            words[self._word(slot) + 1 + valve] = mbar & 0xFFFF
        return words

    def setpoints(self, outputs: Sequence[int]) -> list[float]:
        """Return the set point [Pa gauge] of each chamber in a block of outputs."""
        return [pressure_of(outputs[self._word(slot) + 1 + valve]) for slot, valve in self.places]

    def statuses(self, inputs: Sequence[int]) -> dict[int, SlotStatus]:
        """Return the status of each slot in use in a block of inputs."""
        return {slot: SlotStatus.of(inputs[self._word(slot)]) for slot in self.slots}

    def pressures(self, inputs: Sequence[int]) -> list[float]:
        """Return the pressure [Pa gauge] of each chamber in a block of inputs."""
        return self.setpoints(inputs)

    def empty_pattern(self, empty_pa: float) -> str:
        """Return a regular expression for inputs with regulating slots and empty chambers."""
        words = [".."] * self.size
        most = math.ceil(empty_pa / PA_PER_MBAR) - 1  # below 256: only the low byte differs
        empty = rf"(?:\x00[\x00-\x{most:02x}]|\xff[\x{256 - most:02x}-\xff])"
        for slot in self.slots:
            words[self._word(slot)] = rf".\x{SlotStatus(PRESSURE_APP, SlotState.RUNNING).word:02x}"
        for slot, valve in self.places:
            words[self._word(slot) + 1 + valve] = empty
        return "".join(words)

    def _word(self, slot: int) -> int:
        return WORDS * slot - self.offset
