"""Device mapping: the objects of a CANopen device for set point, reading, control and status word.

A mapping and the EDS file of a device describe it completely, so that a device of another make needs only a
configuration. The shipped mappings are in config/canopen; a platform names one and may change its keys.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, model_validator

from soro_core.config import Strict, config_folder, find_config, read_yaml
from soro_core.errors import ConfigError

DEFAULT_DEVICE = "cia408"
PDO_NUMBERS = 4  # those with predefined identifiers

_ENTRY = re.compile(r"(setpoint|control|reading|status)(?:\.(\d+))?|(supply|temperature)")


class ObjectAddress(Strict):
    """One object of the device; size and sign are those of the EDS."""

    index: int = Field(ge=0x1000, le=0xFFFF)
    sub: int = Field(0, ge=0, le=254)


class ObjectValue(ObjectAddress):
    """A value that is written at start-up, or that fills a place in an RPDO."""

    value: int


Entry: TypeAlias = str | ObjectValue | ObjectAddress


class PdoMapping(Strict):
    """One PDO, in the order of its entries.

    An entry is ``setpoint``, ``control`` (RPDO), ``reading`` or ``status`` (TPDO), with ``.1`` and so on for
    further channels; ``supply`` and ``temperature`` (TPDO), of the whole node; or an object: in an RPDO with
    a constant value, in a TPDO passed over.
    """

    number: int = Field(ge=1, le=PDO_NUMBERS, description="number of the predefined PDO")
    entries: Annotated[tuple[Entry, ...], Field(strict=False, min_length=1, max_length=8)]
    transmission: Literal["sync", "event"] = Field(
        "sync",
        description="sync: with every SYNC; event: the device sends at a change, and periodically",
    )
    fixed: bool = Field(
        False, description="the device has a fixed map, which the driver compares and does not write"
    )

    @model_validator(mode="after")
    def _known(self) -> PdoMapping:
        for entry in self.entries:
            if isinstance(entry, str) and not _ENTRY.fullmatch(entry):
                known = "setpoint, control, reading, status, supply or temperature, or setpoint.1"
                raise ValueError(f"entries: {known}, not {entry}")
        return self


class Linear(Strict):
    """Counts and pressures: pressure = (count - zero_count) pa_per_count."""

    pa_per_count: float = Field(gt=0, le=1e5)
    zero_count: int = Field(0, ge=-(2**31), lt=2**31, description="count at 0 Pa gauge")


class SupplyObject(ObjectAddress, Linear):
    """Pressure [Pa gauge] that a node gets from its supply."""


class TemperatureObject(ObjectAddress):
    """Temperature of a node: celsius = (count - zero_count) celsius_per_count."""

    celsius_per_count: float = Field(gt=0, le=100)
    zero_count: int = Field(0, ge=-(2**31), lt=2**31, description="count at 0 degC")


class DeviceScaling(Strict):
    """Unit and power of ten are read from sub-objects 2 and 3 of set point and reading (CiA 408)."""

    kind: Literal["device"]


class FixedScaling(Strict):
    """The platform states the scales, because the device does not report them."""

    kind: Literal["fixed"]
    setpoint: Linear
    reading: Linear


Scaling: TypeAlias = Annotated[DeviceScaling | FixedScaling, Field(discriminator="kind")]


class DeviceMapping(Strict):
    """How a driver uses one kind of device; objects of further channels follow at `channel_offset`."""

    device: str = Field(description="name of the shipped mapping that this one is based on")
    eds: str = Field(description="EDS file: a path, or the name of one in config/canopen")
    profile: int | None = Field(None, ge=0, le=0xFFFF, description="low word of object 1000; none for any")
    guarding: bool = Field(
        False, description="node guarding (100C, 100D) in place of heartbeats, for devices without them"
    )
    channels: int = Field(1, ge=1, le=16, description="regulators in one node")
    channel_offset: int = Field(
        0x800, ge=1, le=0x1000, description="from an object of one channel to that of the next"
    )
    setpoint: ObjectAddress
    reading: ObjectAddress
    control: ObjectAddress | None = Field(
        None, description="control word of the CiA 408 state machine; none: the device has no state machine"
    )
    status: ObjectAddress | None = None
    hold_setpoint: ObjectAddress | None = Field(
        None, description="set point in state HOLD; the driver writes 0"
    )
    upper_limit: ObjectAddress | None = Field(
        None, description="upper limit of the set point; the driver writes the platform's range"
    )
    lower_limit: ObjectAddress | None = None
    supply: SupplyObject | None = Field(
        None, description="supply pressure; the devices of a node have one supply"
    )
    temperature: TemperatureObject | None = Field(
        None, description="temperature of the node, watched if a TPDO has it"
    )
    settings: Annotated[tuple[ObjectValue, ...], Field(strict=False)] = Field(
        (), description="objects that the driver writes at start-up to every channel with another value"
    )
    rpdos: Annotated[tuple[PdoMapping, ...], Field(strict=False, min_length=1)]
    tpdos: Annotated[tuple[PdoMapping, ...], Field(strict=False, min_length=1)]
    scaling: Scaling

    @model_validator(mode="before")
    @classmethod
    def _on_shipped(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        return {**shipped_mapping(str(given.get("device", DEFAULT_DEVICE))), **given}

    @model_validator(mode="after")
    def _consistent(self) -> DeviceMapping:
        if (self.control is None) != (self.status is None):
            raise ValueError("control and status: both, or none of them")
        of_node: dict[str, ObjectAddress | None] = {"supply": self.supply}
        if any("temperature" in pdo.entries for pdo in self.tpdos):
            of_node["temperature"] = self.temperature
        for pdos, kinds in (
            (self.rpdos, {"setpoint": self.setpoint, "control": self.control}),
            (self.tpdos, {"reading": self.reading, "status": self.status, **of_node}),
        ):
            numbers = [pdo.number for pdo in pdos]
            if len(set(numbers)) < len(numbers):
                raise ValueError("rpdos, tpdos: each number once")
            found = [slot(entry) for pdo in pdos for entry in pdo.entries]
            given = sorted((kind, channel) for kind, channel in found if kind not in ("constant", "other"))
            wanted = sorted(
                (kind, channel)
                for kind, address in kinds.items()
                if address is not None
                for channel in range(1 if kind in of_node else self.channels)
            )
            if given != wanted:
                names = ", ".join(f"{kind}.{channel}" for kind, channel in wanted)
                raise ValueError(f"rpdos, tpdos: each of {names} in one PDO, once")
        for key, pdos, wrong in (("rpdos", self.rpdos, "other"), ("tpdos", self.tpdos, "constant")):
            if any(slot(entry)[0] == wrong for pdo in pdos for entry in pdo.entries):
                raise ValueError(f"{key}: objects {'with' if key == 'rpdos' else 'without'} a value")
        for pdo in (*self.rpdos, *self.tpdos):
            if pdo.transmission == "event" and {"setpoint", "reading"} & {slot(e)[0] for e in pdo.entries}:
                raise ValueError("rpdos, tpdos: set points and readings go with SYNC")
        return self

    @property
    def eds_path(self) -> Path:
        """Path of the EDS file.

        Raises
        ------
        ConfigError
            If there is no such file.
        """
        shipped = config_folder() / "canopen" / self.eds
        for path in (Path(self.eds), shipped):
            if path.is_file():
                return path
        known = ", ".join(sorted(path.name for path in shipped.parent.glob("*.eds")))
        raise ConfigError("canopen.mapping", "eds", self.eds, f"the path of an EDS file, or one of {known}")

    def address(self, kind: str, channel: int) -> ObjectAddress | None:
        """Return the object of one channel: setpoint, reading, control, status or a limit; None for none."""
        first: ObjectAddress | None = getattr(self, kind)
        return None if first is None else self.of_channel(first, channel)

    def of_channel(self, first: ObjectAddress, channel: int) -> ObjectAddress:
        """Return the same object of another channel."""
        return ObjectAddress(index=first.index + channel * self.channel_offset, sub=first.sub)


def slot(entry: Entry) -> tuple[str, int]:
    """Return kind and channel of a PDO entry; ``constant`` is a fixed value, ``other`` an ignored object."""
    if isinstance(entry, ObjectAddress):
        return ("constant" if isinstance(entry, ObjectValue) else "other"), 0
    match = _ENTRY.fullmatch(entry)
    assert match is not None, "checked with the mapping"
    return match[1] or match[3], int(match[2] or 0)


def shipped_mapping(name: str) -> dict[str, Any]:
    """Return the keys of a mapping in config/canopen.

    Raises
    ------
    ConfigError
        If there is no mapping of that name.
    """
    return {**read_yaml(find_config(name, "canopen")), "device": name}


def default_mapping() -> DeviceMapping:
    """Return the mapping of nodes with one CiA 408 valve."""
    return DeviceMapping.model_validate({"device": DEFAULT_DEVICE})
