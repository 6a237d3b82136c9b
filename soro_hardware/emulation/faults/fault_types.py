"""Names and effects of the faults of emulated devices, and one fault with its time and place.

Bus faults act on bytes or frames in transit, those of the group stop on the emergency stop and the dump valve
of the arm, device faults on one device, pneumatic faults on the valve and the line of one chamber, or on the
chamber itself, sensor faults on its reading. A name means the same for every family; each family implements
its effect (`Faults.value`, `Faults.on_start`).

As text a fault is one YAML mapping, in scene files, on the command line, on the control socket and on the
topic: ``{at: 5.0, fault: stuck_open, chamber: link0/chamber1, duration_s: 2.0}``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, Self, TypeAlias

import yaml
from pydantic import Field, model_validator

from soro_core.config import Strict, parse, read_mapping
from soro_core.errors import ConfigError
from soro_core.files.units import as_number, unit_of

Group: TypeAlias = Literal["bus", "stop", "device", "pneumatic", "sensor"]


class FaultType(NamedTuple):
    """One kind of fault: its group and effect, and its parameter with default and bounds."""

    group: Group
    text: str
    key: str = ""
    default: float = 0.0
    low: float = 0.0
    high: float = 0.0


_P = ("p", 0.2, 0.0, 1.0)
KINDS: dict[str, FaultType] = {
    "drop": FaultType("bus", "messages are lost, each with probability p", *_P),
    "corrupt_bits": FaultType("bus", "one bit of a message is inverted, in each with probability p", *_P),
    "truncate": FaultType("bus", "messages are cut short, each with probability p", *_P),
    "duplicate": FaultType("bus", "messages arrive twice, each with probability p", *_P),
    "delay": FaultType("bus", "messages arrive late", "delay_s", 0.02, 0.0, 10.0),
    "reorder": FaultType("bus", "a message arrives after the next one, each with probability p", *_P),
    "garbage_line": FaultType("bus", "noise precedes a message, each with probability p", *_P),
    "bus_off": FaultType("bus", "the CAN controller of the host's adapter is in the state bus-off"),
    "ack_missing": FaultType(
        "bus", "no node acknowledges the frames of the host's adapter: its cable is unplugged"
    ),
    "babble": FaultType("bus", "a device floods the bus with one identifier", "can_id", 0.0, 0.0, 2047.0),
    "adapter_unplug": FaultType("bus", "the adapter is unplugged from the host"),
    "stop_pressed": FaultType(
        "stop", "the emergency stop is pressed: its contact and the dump valve are open"
    ),
    "dump_valve_open": FaultType(
        "stop", "the dump valve is without current: every chamber is open to the air"
    ),
    "dump_valve_stuck": FaultType("stop", "the dump valve stays shut without current"),
    "reboot": FaultType("device", "the device restarts and loses its settings and set points"),
    "brownout": FaultType("device", "the device's supply voltage is low, then 0, and returns at the end"),
    "mute": FaultType("device", "the device sends nothing; its valve still follows set points"),
    "freeze_tpdo": FaultType("device", "the device sends old readings; everything else works"),
    "wrong_node_id": FaultType(
        "device", "the device answers under another address", "node", 99.0, 1.0, 127.0
    ),
    "overheat": FaultType("device", "the device reports this temperature", "celsius", 90.0, -40.0, 200.0),
    "supply_rise": FaultType("device", "the device reports this supply", "supply_pa", 1.2e6, 0.0, 5e6),
    "sdo_abort": FaultType("device", "the device refuses every access to its parameters"),
    "sdo_timeout": FaultType("device", "the device answers no access to its parameters"),
    "set_by_another": FaultType(
        "device",
        "its front panel or another program sets this set point, once",
        "pressure_pa",
        30e3,
        -101e3,
        1e6,
    ),
    "setpoint_ignored": FaultType("device", "the device accepts set points, but keeps the last one"),
    "stuck_open": FaultType("pneumatic", "the valve stays open to the supply", "supply_pa", 150e3, 0.0, 1e6),
    "stuck_closed": FaultType("pneumatic", "the valve stays closed: no air flows in or out"),
    "stuck_at": FaultType("pneumatic", "the valve holds this pressure", "pressure_pa", 30e3, -101e3, 1e6),
    "slow_valve": FaultType(
        "pneumatic", "the valve is slower by this factor, except when it vents", "factor", 20.0, 1.0, 1e4
    ),
    "leak": FaultType(
        "pneumatic", "the chamber loses this fraction of its pressure per second", "rate_1_s", 2.0, 0.0, 1e3
    ),
    "burst": FaultType("pneumatic", "the chamber is open to the atmosphere", "rate_1_s", 500.0, 0.0, 1e4),
    "kinked_line": FaultType(
        "pneumatic", "the flow to and from the chamber is smaller by this factor", "factor", 50.0, 1.0, 1e4
    ),
    "supply_drop": FaultType(
        "pneumatic", "the supply pressure falls to this value", "supply_pa", 20e3, 0.0, 1e6
    ),
    "vent_blocked": FaultType("pneumatic", "air flows in, but not out"),
    "sensor_offset": FaultType("sensor", "readings have this offset", "offset_pa", 15e3, -1e6, 1e6),
    "sensor_scale": FaultType("sensor", "readings are multiplied by this factor", "factor", 1.5, -10.0, 10.0),
    "sensor_noise": FaultType(
        "sensor", "readings have additional noise of this standard deviation", "sigma_pa", 2e3, 0.0, 1e6
    ),
    "sensor_stuck": FaultType("sensor", "the reading does not change"),
    "sensor_saturate": FaultType("sensor", "readings saturate at this value", "most_pa", 20e3, -1e6, 1e6),
    "sensor_quantise": FaultType("sensor", "readings are multiples of this step", "step_pa", 2e3, 1.0, 1e6),
    "sensor_open_circuit": FaultType(
        "sensor", "the sensor's wire is broken; the reading has this value", "reading_pa", -125e3, -1e6, 1e6
    ),
}
# Faults that every family supports, because all families share the model of the air and its sensors.
OF_THE_AIR = frozenset(n for n, k in KINDS.items() if k.group in ("stop", "pneumatic", "sensor")) | {
    "setpoint_ignored",
    "set_by_another",
}
CLEAR = "clear"
OF_ALL: tuple[Group, ...] = ("bus", "stop")  # groups of faults that concern no single chamber


class Injection(Strict):
    """A fault with its time and place; the parameter has the name of its kind (``rate_1_s: 5.0``)."""

    at: float = Field(0.0, ge=0, le=86400, description="seconds after the start, or after the injection")
    fault: str = Field(description="name of the fault, or clear: end all faults (of the chamber)")
    chamber: str = Field(
        "", description="chamber whose device, valve or sensor fails; empty for bus and stop"
    )
    duration_s: float = Field(0.0, ge=0, le=86400, description="duration [s]; 0: until it is cleared")
    value: float | None = Field(None, description="parameter of the fault, under its own name or this one")

    @model_validator(mode="before")
    @classmethod
    def _named_parameter(cls, data: Any) -> Any:
        named = data.get("fault") if isinstance(data, Mapping) else None
        kind = KINDS.get(named) if isinstance(named, str) else None
        if kind is None:
            return data
        for key in data.keys() - cls.model_fields.keys() - {kind.key}:
            allowed = f"{kind.key} from {kind.low:g} to {kind.high:g}" if kind.key else "no parameter"
            raise ValueError(f"{named}: {allowed}, not {key}")
        if not kind.key or kind.key not in data:
            return data
        value = as_number(data[kind.key], unit_of(kind.key))
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{named}: {kind.key} is a number")
        return {**{key: item for key, item in data.items() if key != kind.key}, "value": value}

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.fault == CLEAR:
            return self
        if self.fault not in KINDS:
            raise ValueError(f"fault: one of {', '.join([*KINDS, CLEAR])}")
        kind = KINDS[self.fault]
        if (kind.group in OF_ALL) == bool(self.chamber):
            raise ValueError(
                f"{self.fault}: {'no chamber' if self.chamber else 'a chamber, link0/chamber0 or so'}"
            )
        if self.value is not None and not kind.key:
            raise ValueError(f"{self.fault}: no value")
        if self.value is not None and not kind.low <= self.value <= kind.high:
            raise ValueError(f"{self.fault}: {kind.key} from {kind.low:g} to {kind.high:g}")
        return self

    @property
    def parameter(self) -> float:
        """Parameter of the fault, or its default."""
        return KINDS[self.fault].default if self.value is None else self.value

    def __str__(self) -> str:
        of = f" of {self.chamber}" if self.chamber else ""
        key = KINDS[self.fault].key if self.fault in KINDS else ""
        if not key:
            return f"{self.fault}{of}"
        if key.endswith("_pa"):
            return f"{self.fault}{of} ({key.removesuffix('_pa')} {1e-3 * self.parameter:g} kPa)"
        return f"{self.fault}{of} ({key} {self.parameter:g})"

    def as_text(self) -> str:
        """Return the fault as text for `read_injection`."""
        given = {name: getattr(self, name) for name in self.model_fields_set}
        return yaml.safe_dump(given, default_flow_style=True, width=10_000, sort_keys=False).strip()


def read_injection(text: str, where: str = "fault") -> Injection:
    """Read a fault from one YAML mapping, with or without its braces.

    Raises
    ------
    ConfigError
        If the text is no fault; the message states what is allowed.
    """
    text = text.strip()
    data = read_mapping(text if text.startswith("{") else f"{{{text}}}", where)
    if "fault" not in data:
        allowed = f"'fault: leak, chamber: link0/chamber0' or so; words: {', '.join([*KINDS, CLEAR])}"
        raise ConfigError(where, "", text, allowed)
    return parse(data, Injection, where)
