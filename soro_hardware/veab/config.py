"""Platform files of the family veab_tcp: VEAB boards behind the published TCP server."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from soro_hardware.platform import EmulationBase, Freshness, TcpPlatform, ValveBase, require_once
from soro_hardware.veab.protocol import LOWEST_PA, SPAN_PA


class VeabValve(ValveBase):
    """One valve: the chamber that it feeds and its place in the server's messages."""

    port: int = Field(ge=0, description="position in the server's messages, from 0")


class VeabOptions(Freshness):
    """Times of the driver."""

    keep_alive_s: float = Field(
        0.1,
        ge=0.01,
        le=0.2,
        description="pause between exchanges after which the driver sends 0 Pa; after 0.5 s without a "
        "message the server ends and holds its pressures",
    )
    supervisor: bool = Field(
        True, description="run a process beside the driver that vents when the driver dies; not in lockstep"
    )
    vented_pa: float = Field(
        5e3, gt=0, le=20e3, description="pressure below which a chamber counts as vented"
    )
    vent_timeout_s: float = Field(
        2.0, gt=0, le=10, description="longest wait for vented chambers at start-up and at the end"
    )
    stale_cycles: int = Field(5, ge=1, le=100, description="missed readings in a row that make a fault")
    push_hz: float | None = Field(
        None,
        gt=0,
        le=1000,
        description="largest number of readings a second from the server; none: emulation.push_hz. Another "
        "rate shows that the server has another number of ports",
    )


class VeabEmulation(EmulationBase):
    """How the emulated server behaves."""

    push_hz: float = Field(
        250.0, gt=0, le=1000, description="readings a second that the server sends, in real time"
    )
    ports: int | None = Field(
        None, ge=1, le=64, description="ports of the server; none: as many as the platform has"
    )
    gather_s: float = Field(
        0.0,
        ge=0,
        le=0.2,
        description="longest delay of readings that TCP sends in one segment, in real time; a message of the "
        "host, which acknowledges the segment before, ends the delay",
    )
    restart_s: float | None = Field(
        None,
        gt=0,
        le=60,
        description="time from the end of the server to its restart; none: no restart",
    )


class VeabPlatform(TcpPlatform):
    """VEAB valves behind the published server."""

    start_advice: ClassVar[str] = "start the server on the Pi, it ends with each client"
    where_supervisor: ClassVar[str] = "host.supervisor"

    family: Literal["veab_tcp"]
    ports: int = Field(ge=1, le=64, description="ports of the server, used or not: 12 with all six boards")
    valves: Annotated[tuple[VeabValve, ...], Field(strict=False, min_length=1, max_length=64)]
    host: VeabOptions = VeabOptions()
    emulation: VeabEmulation = VeabEmulation()

    @property
    def update_hz(self) -> float:
        return min(self.cycle_hz, self.push_hz)

    @property
    def push_hz(self) -> float:
        """Readings a second that the server sends at most."""
        return self.host.push_hz or self.emulation.push_hz

    @property
    def is_supervised(self) -> bool:
        return self.host.supervisor

    @model_validator(mode="after")
    def _consistent(self) -> VeabPlatform:
        numbers = [valve.port for valve in self.valves]
        require_once("valves: each port", numbers)
        if max(numbers) >= self.ports:
            raise ValueError(f"valves: ports 0 to {self.ports - 1}, not {max(numbers)}")
        highest = LOWEST_PA + SPAN_PA
        if self.range.minimum_pa < LOWEST_PA or self.range.maximum_pa > highest:
            raise ValueError(f"range: within {LOWEST_PA:g} to {highest:g} Pa, the span of the valves")
        return self
