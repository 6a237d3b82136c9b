"""Platform files of the family canopen_408: CiA 408 valves behind a CAN adapter."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from soro_hardware.canopen.mapping import DeviceMapping, default_mapping
from soro_hardware.platform import EmulationBase, Freshness, PlatformBase, ValveBase, require_once
from soro_hardware.transport.config import Transport

SYNC_LATE_PERIODS = 1.5  # after which CANopenNode, for one, reports SYNC as lost


class CanopenValve(ValveBase):
    """One regulator: the chamber that it feeds and its node on the bus."""

    node: int = Field(ge=1, le=127, description="CANopen node id")
    channel: int = Field(0, ge=0, le=15, description="regulator of a node that has several")


class CanopenOptions(Freshness):
    """Times and identities of CANopen; the defaults suit control rates of 50 Hz and more."""

    master_node: int = Field(
        127, ge=1, le=127, description="node id under which the driver sends its heartbeat"
    )
    heartbeat_s: float = Field(
        0.025, ge=0.005, le=1, description="period of the heartbeats of driver and devices, or guard time"
    )
    heartbeat_consumer_s: float = Field(
        0.1, ge=0.01, le=1, description="silence after which the other side is lost"
    )
    rpdo_deadline_s: float = Field(0.05, ge=0.005, le=0.5, description="longest time between two set points")
    boot_timeout_s: float = Field(5.0, gt=0, le=60, description="time for a device to boot")
    sdo_timeout_s: float = Field(0.25, gt=0, le=5, description="time for one SDO answer")
    sdo_retries: int = Field(2, ge=0, le=10, description="further attempts after an SDO timeout")
    activation_timeout_s: float = Field(
        0.5, gt=0, le=5, description="time from first set point to state ACTIVE"
    )
    status_s: float = Field(
        0.1,
        ge=0.01,
        le=1,
        description="period of status words and supply pressure, which a device sends by event",
    )

    most_celsius: float = Field(
        70.0, gt=0, le=150, description="temperature above which a device trips, where it reports one"
    )
    sync_period_s: float | None = Field(
        None,
        gt=0,
        le=1,
        description="period of SYNC that the driver writes to the devices (1006); at least "
        "rpdo_deadline_s / 1.5, because some devices report an error 1.5 periods after a SYNC; "
        "none: not written",
    )

    @property
    def life_time_factor(self) -> int:
        """Guard times without a question or an answer after which a guarded node or its host is lost."""
        return min(round(self.heartbeat_consumer_s / self.heartbeat_s), 255)

    mapping: DeviceMapping = Field(
        default_factory=default_mapping, description="objects and PDOs of the devices"
    )
    vendor_id: int | None = Field(
        None, ge=0, le=0xFFFFFFFF, description="required vendor (1018:1); none for any"
    )
    product_code: int | None = Field(None, ge=0, le=0xFFFFFFFF, description="required product (1018:2)")
    full_scale_pa: float | None = Field(
        None,
        gt=0,
        le=2e6,
        description="pressure at 16384 counts [Pa]; only for devices with normalised values",
    )


class CanopenEmulation(EmulationBase):
    """How the emulated devices of this platform behave."""

    adapters: Annotated[
        tuple[Literal["slcan", "slcan_silent", "slcan_remembering", "socketcand"], ...], Field(strict=False)
    ] = Field(
        (),
        description="adapters on the emulated bus; empty: the one of the transport. slcan_silent "
        "acknowledges no command, as the CANable with its stock firmware; slcan_remembering has time stamps "
        "on, and delivers frames on request only, until it is told otherwise",
    )
    boot_delay_s: float = Field(0.1, ge=0, le=10, description="time from power-on to boot-up; 0 in lockstep")
    pressure_unit: Literal["pa", "bar", "normalised"] = Field(
        "pa", description="unit of the device's pressures"
    )
    pressure_prefix: int = Field(1, ge=-6, le=6, description="power of ten of the device's pressures")
    full_scale_pa: float = Field(
        100e3, gt=0, le=2e6, description="pressure at 16384 counts, for normalised [Pa]"
    )
    supply_pa: float = Field(
        150e3,
        ge=0,
        le=5e6,
        description="supply pressure that the devices report, at least 60 kPa above the range",
    )


class CanopenPlatform(PlatformBase):
    """CiA 408 valves on one CAN bus."""

    family: Literal["canopen_408"]
    transport: Transport
    valves: Annotated[tuple[CanopenValve, ...], Field(strict=False, min_length=1, max_length=126)]
    canopen: CanopenOptions = Field(default_factory=CanopenOptions)
    emulation: CanopenEmulation = CanopenEmulation()

    @property
    def device(self) -> str | None:
        return self.transport.address

    @property
    def nodes(self) -> dict[int, dict[int, str]]:
        """Chambers of the channels of each node."""
        nodes: dict[int, dict[int, str]] = {}
        for valve in self.valves:
            nodes.setdefault(valve.node, {})[valve.channel] = valve.chamber
        return nodes

    @model_validator(mode="after")
    def _consistent(self) -> CanopenPlatform:
        nodes = [valve.node for valve in self.valves]
        channels = self.canopen.mapping.channels
        places = [(valve.node, valve.channel) for valve in self.valves]
        if channels == 1:
            require_once("valves: each node", places, lambda place: place[0])
        require_once("valves: each channel", places, lambda place: f"{place[0]}.{place[1]}")
        if max(valve.channel for valve in self.valves) >= channels:
            raise ValueError(f"valves: channel 0 to {channels - 1}, of as many as the mapping has")
        if self.canopen.mapping.guarding and self.transport.kind == "socketcand":
            raise ValueError("canopen.mapping.guarding: not over socketcand, which has no remote frames")
        times, period = self.canopen, 1.0 / self.cycle_hz
        if times.master_node in nodes:
            raise ValueError(f"canopen.master_node: a node id that no valve has, not {times.master_node}")
        if times.rpdo_deadline_s < 2 * period:
            raise ValueError(f"canopen.rpdo_deadline_s: at least two cycles, {2 * period:.4g} s")
        watched_s = None if times.sync_period_s is None else SYNC_LATE_PERIODS * times.sync_period_s
        if watched_s is not None and watched_s < times.rpdo_deadline_s:
            least_s = times.rpdo_deadline_s / SYNC_LATE_PERIODS
            raise ValueError(
                f"canopen.sync_period_s: at least {least_s:.4g} s, not {times.sync_period_s:g}: devices take "
                f"SYNC for lost after {SYNC_LATE_PERIODS:g} periods, and rpdo_deadline_s lets it come after "
                f"{times.rpdo_deadline_s:g} s"
            )
        if times.heartbeat_consumer_s < 2 * max(times.heartbeat_s, period):
            raise ValueError("canopen.heartbeat_consumer_s: at least twice the heartbeat and twice the cycle")
        return self
