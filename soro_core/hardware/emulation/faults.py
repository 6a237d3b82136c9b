"""Faults of emulated devices: one vocabulary on every family, a schedule, and what is active now.

Bus faults act on bytes or frames on their way, device faults on one device, pneumatic faults on the valve,
the line and the chamber of one chamber, sensor faults on its reading. The names mean the same on every
family; a family only says at which places they act (`Faults.value`, `Faults.on_start`).

As text a fault is one YAML mapping, in scene files, on the command line, on the control socket and on the
topic alike: ``{at: 5.0, fault: stuck_open, chamber: link0/chamber1, duration_s: 2.0}``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal, NamedTuple, Self, TypeAlias

import numpy as np
import yaml
from pydantic import Field, model_validator

from soro_core.config import Strict, parse, read_mapping
from soro_core.errors import ConfigError

Group: TypeAlias = Literal["bus", "device", "pneumatic", "sensor"]


class Kind(NamedTuple):
    """One word of the vocabulary: what it does, and its parameter with default and bounds."""

    group: Group
    text: str
    key: str = ""
    default: float = 0.0
    low: float = 0.0
    high: float = 0.0


_P = ("p", 0.2, 0.0, 1.0)
KINDS: dict[str, Kind] = {
    "drop": Kind("bus", "messages get lost, each with probability p", *_P),
    "corrupt_bits": Kind("bus", "one bit of a message is wrong, of each with probability p", *_P),
    "truncate": Kind("bus", "messages end too early, each with probability p", *_P),
    "duplicate": Kind("bus", "messages come twice, each with probability p", *_P),
    "delay": Kind("bus", "messages come later", "delay_s", 0.02, 0.0, 10.0),
    "reorder": Kind("bus", "a message comes after the one that follows it, with probability p", *_P),
    "garbage_line": Kind("bus", "noise comes before a message, with probability p", *_P),
    "bus_off": Kind("bus", "the controller of the host's adapter has taken itself off the bus"),
    "ack_missing": Kind("bus", "nobody acknowledges what the host's adapter sends: its cable is off"),
    "babble": Kind("bus", "a device floods the bus with one identifier", "can_id", 0.0, 0.0, 2047.0),
    "adapter_unplug": Kind("bus", "the adapter is pulled out of the host"),
    "reboot": Kind("device", "the device starts anew and has lost what it was told"),
    "brownout": Kind("device", "the device's supply voltage is low, then gone, and comes back at the end"),
    "mute": Kind("device", "the device sends nothing any more; its valve goes on"),
    "freeze_tpdo": Kind("device", "the device sends old values; everything else goes on"),
    "wrong_node_id": Kind("device", "the device answers under another address", "node", 99.0, 1.0, 127.0),
    "sdo_abort": Kind("device", "the device refuses every access to its parameters"),
    "sdo_timeout": Kind("device", "the device answers no access to its parameters"),
    "setpoint_ignored": Kind("device", "the device takes set points without a word, and keeps the last one"),
    "stuck_open": Kind("pneumatic", "the valve stays open to the supply", "supply_pa", 150e3, 0.0, 1e6),
    "stuck_closed": Kind("pneumatic", "the valve stays closed: no air in, none out"),
    "stuck_at": Kind("pneumatic", "the valve stays at one opening", "pressure_pa", 30e3, -101e3, 1e6),
    "slow_valve": Kind("pneumatic", "the valve's lag is longer; its vent is not", "factor", 20.0, 1.0, 1e4),
    "leak": Kind(
        "pneumatic", "the chamber loses this part of its pressure a second", "rate_1_s", 2.0, 0.0, 1e3
    ),
    "burst": Kind("pneumatic", "the chamber is open to the air", "rate_1_s", 500.0, 0.0, 1e4),
    "kinked_line": Kind(
        "pneumatic", "the line carries less, to and from the chamber", "factor", 50.0, 1.0, 1e4
    ),
    "supply_drop": Kind("pneumatic", "the supply has only this pressure left", "supply_pa", 20e3, 0.0, 1e6),
    "vent_blocked": Kind("pneumatic", "air goes in and does not come out"),
    "sensor_offset": Kind("sensor", "readings are off by", "offset_pa", 15e3, -1e6, 1e6),
    "sensor_scale": Kind("sensor", "readings are multiplied by", "factor", 1.5, -10.0, 10.0),
    "sensor_noise": Kind("sensor", "readings have this much more noise", "sigma_pa", 2e3, 0.0, 1e6),
    "sensor_stuck": Kind("sensor", "the reading stays as it is"),
    "sensor_saturate": Kind("sensor", "readings end at", "most_pa", 20e3, -1e6, 1e6),
    "sensor_quantise": Kind("sensor", "readings come in steps of", "step_pa", 2e3, 1.0, 1e6),
    "sensor_open_circuit": Kind(
        "sensor", "the sensor's wire is off; it reads", "reading_pa", -125e3, -1e6, 1e6
    ),
}
CLEAR = "clear"
_OF_ALL = ("bus",)


class Injection(Strict):
    """A fault, when and where; the parameter of its kind goes by its own name (``rate_1_s: 5.0``)."""

    at: float = Field(0.0, ge=0, le=86400, description="seconds after the start, or after it was injected")
    fault: str = Field(description="a word of the vocabulary, or clear: end all faults (of the chamber)")
    chamber: str = Field("", description="whose device, valve or sensor; for faults of the bus empty")
    duration_s: float = Field(0.0, ge=0, le=86400, description="how long it lasts; 0: until it is cleared")
    value: float | None = Field(None, description="the kind's parameter, under its name or this one")

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
        if isinstance(data[kind.key], bool) or not isinstance(data[kind.key], int | float):
            raise ValueError(f"{named}: {kind.key} is a number")
        return {**{key: item for key, item in data.items() if key != kind.key}, "value": data[kind.key]}

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.fault == CLEAR:
            return self
        if self.fault not in KINDS:
            raise ValueError(f"fault: one of {', '.join([*KINDS, CLEAR])}")
        kind = KINDS[self.fault]
        if (kind.group in _OF_ALL) == bool(self.chamber):
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
        """The parameter, or its default."""
        return KINDS[self.fault].default if self.value is None else self.value

    def __str__(self) -> str:
        of = f" of {self.chamber}" if self.chamber else ""
        key = KINDS[self.fault].key if self.fault in KINDS else ""
        return f"{self.fault}{of}{f' ({key} {self.parameter:g})' if key else ''}"

    def as_text(self) -> str:
        """The mapping that `read_injection` reads."""
        given = {name: getattr(self, name) for name in self.model_fields_set}
        return yaml.safe_dump(given, default_flow_style=True, width=10_000, sort_keys=False).strip()


def read_injection(text: str, where: str = "fault") -> Injection:
    """Read a fault from one YAML mapping, with or without its braces.

    Raises
    ------
    ConfigError
        One line that names what was found and what is allowed.
    """
    text = text.strip()
    data = read_mapping(text if text.startswith("{") else f"{{{text}}}", where)
    if "fault" not in data:
        allowed = f"'fault: leak, chamber: link0/chamber0' or so; words: {', '.join([*KINDS, CLEAR])}"
        raise ConfigError(where, "", text, allowed)
    return parse(data, Injection, where)


class _Entry(NamedTuple):
    injection: Injection
    start_ns: int
    end_ns: int | None


class Faults:
    """What is scheduled and what is active, in the time of the emulated world.

    Attributes
    ----------
    chambers : tuple of str
        Names of the chambers, in order; empty until the platform is known.
    supported : frozenset of str
        What the family routes.
    on_start, on_end : dict
        What a family does at the moment at which a fault of a kind begins or ends.
    rng : numpy Generator
        Chance of every fault that has one.
    """

    def __init__(self, seed: int = 0, supported: Iterable[str] = KINDS) -> None:
        self.chambers: tuple[str, ...] = ()
        self.supported = frozenset(supported)
        self.on_start: dict[str, Callable[[Injection], None]] = {}
        self.on_end: dict[str, Callable[[Injection], None]] = {}
        self.rng = np.random.default_rng([seed, 0xFA])
        self.now_ns = 0
        self._waiting: list[_Entry] = []
        self._active: list[_Entry] = []
        self._values: dict[str, dict[str, float]] = {}

    def add(self, injection: Injection) -> None:
        """Schedule a fault from now on; one that is due begins at once.

        Raises
        ------
        ConfigError
            If the family or the platform has no such thing.
        """
        if injection.fault != CLEAR and injection.fault not in self.supported:
            allowed = f"on these devices one of {', '.join(k for k in KINDS if k in self.supported)}"
            raise ConfigError("fault", "fault", injection.fault, allowed)
        if injection.chamber and injection.chamber not in self.chambers:
            raise ConfigError(
                "fault", "chamber", injection.chamber, f"one of {', '.join(filter(None, self.chambers))}"
            )
        start_ns = self.now_ns + round(injection.at * 1e9)
        end_ns = start_ns + round(injection.duration_s * 1e9) if injection.duration_s else None
        self._waiting.append(_Entry(injection, start_ns, end_ns))
        self._waiting.sort(key=lambda entry: entry.start_ns)
        self.advance(self.now_ns)

    def advance(self, now_ns: int) -> None:
        """Begin and end what is due; families call it once a step."""
        self.now_ns = now_ns
        while self._waiting and self._waiting[0].start_ns <= now_ns:
            entry = self._waiting.pop(0)
            if entry.injection.fault == CLEAR:
                self.clear(entry.injection.chamber)
            else:
                self._begin(entry)
        for entry in [e for e in self._active if e.end_ns is not None and e.end_ns <= now_ns]:
            self._end(entry)

    def clear(self, chamber: str = "") -> None:
        """End everything that is active and forget what is scheduled, of a chamber or of all."""
        self._waiting = [e for e in self._waiting if chamber and e.injection.chamber != chamber]
        for entry in [e for e in self._active if not chamber or e.injection.chamber == chamber]:
            self._end(entry)

    @property
    def active(self) -> tuple[Injection, ...]:
        """What is active now."""
        return tuple(entry.injection for entry in self._active)

    @property
    def waiting(self) -> tuple[tuple[Injection, float], ...]:
        """What is scheduled, and in how many seconds."""
        return tuple((entry.injection, (entry.start_ns - self.now_ns) * 1e-9) for entry in self._waiting)

    @property
    def is_active(self) -> bool:
        """Whether anything is; asked with every byte and frame."""
        return bool(self._active)

    def value(self, fault: str, chamber: str = "") -> float | None:
        """Parameter of a fault that is active now, or None."""
        return self._values.get(chamber, {}).get(fault)

    def of(self, number: int) -> Mapping[str, float]:
        """Faults of a chamber, by its number, that are active now, with their parameters."""
        return self._values.get(self.chambers[number], {}) if self._values and self.chambers else {}

    def happens(self, fault: str) -> bool:
        """Toss for a fault of the bus that has a probability."""
        p = self.value(fault)
        return p is not None and bool(self.rng.random() < p)

    def _begin(self, entry: _Entry) -> None:
        self._active.append(entry)
        self._collect()
        self.on_start.get(entry.injection.fault, _nothing)(entry.injection)

    def _end(self, entry: _Entry) -> None:
        self._active.remove(entry)
        self._collect()
        self.on_end.get(entry.injection.fault, _nothing)(entry.injection)

    def _collect(self) -> None:
        self._values = {}
        for injection, _, _ in self._active:
            self._values.setdefault(injection.chamber, {})[injection.fault] = injection.parameter


def _nothing(_: Injection) -> None:
    return


# What every family has: the air behind the valves and its sensors are the same for all.
OF_THE_AIR = frozenset(n for n, k in KINDS.items() if k.group in ("pneumatic", "sensor")) | {
    "setpoint_ignored"
}
