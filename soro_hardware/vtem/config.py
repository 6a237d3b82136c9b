"""Platform files of the family vtem_modbus: a Festo VTEM motion terminal behind a Modbus TCP bus node."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from soro_core.config import Strict
from soro_hardware.platform import EmulationBase, Freshness, TcpPlatform, ValveBase, require_once
from soro_hardware.vtem.registers import HIGHEST_PA, LOWEST_PA, SLOTS

_PART_OF_A_CYCLE = 0.8


class VtemValve(ValveBase):
    """One valve: the chamber that it feeds and its place on the terminal."""

    slot: int = Field(ge=0, lt=SLOTS, description="slot of the terminal, from 0")
    valve: int = Field(
        ge=0, le=1, description="valve of the slot: 0 has its first pressure word, 1 its second"
    )


class VtemRegisters(Strict):
    """Addresses of the terminal in the bus node's registers, as in the messages."""

    unit: int = Field(
        255, ge=0, le=255, description="Modbus unit identifier; a bus node without a gateway ignores it"
    )
    outputs: int = Field(
        40003, ge=0, le=65535 - 3 * SLOTS, description="command word of slot 0: 40001, two words of the node"
    )
    inputs: int = Field(
        45395, ge=0, le=65535 - 3 * SLOTS, description="status word of slot 0: 45392, three words of the node"
    )
    one_transaction: bool = Field(
        False, description="write and read by one message (function 23), which not every node has"
    )


class VtemOptions(Freshness):
    """Times of the driver."""

    supervisor: bool = Field(
        True, description="run a process beside the driver that vents when the driver dies; not in lockstep"
    )
    answer_timeout_s: float = Field(
        1.0, gt=0, le=10, description="longest wait for an answer at start-up and at the end"
    )
    start_timeout_s: float = Field(
        20.0, gt=0, le=60, description="longest time until every slot runs its motion app"
    )
    stop_timeout_s: float = Field(
        10.0, gt=0, le=60, description="longest time until every slot has ended its motion app"
    )
    vented_pa: float = Field(
        5e3, gt=0, le=20e3, description="pressure below which a chamber counts as vented"
    )
    vent_timeout_s: float = Field(
        2.0, gt=0, le=10, description="longest wait for vented chambers at start-up"
    )


class VtemEmulation(EmulationBase):
    """How the emulated terminal behaves; the times are assumptions."""

    boot_s: float = Field(0.1, ge=0, le=60, description="time from power-on until the slots are ready")
    app_start_s: float = Field(0.1, ge=0, le=20, description="time from the command until a motion app runs")
    answer_s: float = Field(
        0.001, ge=0, le=0.1, description="time from a request to its answer, in real time"
    )


class VtemPlatform(TcpPlatform):
    """Valves of a motion terminal."""

    start_advice: ClassVar[str] = (
        "no connection or no answer: address and port of the bus node, and that no other master is there; "
        "a slot that does not run: supply pressure, load voltage, and whether motion app 03 is licensed on it"
    )
    where_supervisor: ClassVar[str] = "host.supervisor"

    family: Literal["vtem_modbus"]
    valves: Annotated[tuple[VtemValve, ...], Field(strict=False, min_length=1, max_length=2 * SLOTS)]
    registers: VtemRegisters = VtemRegisters()
    host: VtemOptions = VtemOptions()
    emulation: VtemEmulation = VtemEmulation()

    @property
    def is_supervised(self) -> bool:
        return self.host.supervisor

    @property
    def budget_s(self) -> float:
        """Time [s] that a cycle has for its answers, whatever the rate of the loop: it leaves some of it."""
        return min(self.cycle_budget_s, _PART_OF_A_CYCLE / self.cycle_hz)

    @model_validator(mode="after")
    def _consistent(self) -> VtemPlatform:
        places = [(valve.slot, valve.valve) for valve in self.valves]
        require_once("valves: each valve", places, lambda place: f"valve {place[1]} of slot {place[0]}")
        if self.range.minimum_pa < LOWEST_PA or self.range.maximum_pa > HIGHEST_PA:
            raise ValueError(f"range: within {LOWEST_PA:g} to {HIGHEST_PA:g} Pa, that of motion app 03")
        return self
