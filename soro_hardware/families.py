"""Families of regulators by name: shipped ones, and others by the entry point `soro.families`.

A family has a model of its platform files, a function that makes its driver, and a function that makes its
emulated devices. Each part is imported when it is used: a driver imports neither the library of another bus
nor the emulator.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

from soro_core import registered
from soro_core.config import find_config, parse, read_yaml
from soro_core.errors import ConfigError
from soro_core.extras import named_packages
from soro_hardware.platform import PlatformBase
from soro_hardware.port import Regulator

GROUP = "soro.families"


@dataclass(frozen=True)
class Family:
    """Parts of one family, each as ``module:name``.

    Attributes
    ----------
    config : str
        Model of the platform files: a `PlatformBase` with the keys of the family.
    driver : str
        Function as `Family.open`.
    emulator : str
        Function ``emulate(platform, lockstep, seed) -> EmulatedDevices``.
    tried_on : str
        What driver and emulated devices were held against; `soro doctor` says it, and docs/hardware.md.
    """

    config: str
    driver: str
    emulator: str
    tried_on: str = "not stated by its package"

    def open(
        self, platform: PlatformBase, endpoint: str | None, clock: Callable[[], float], lockstep: bool
    ) -> Regulator:
        """Make the driver of a platform, which opens nothing before `Regulator.configure`.

        Parameters
        ----------
        platform : PlatformBase
            Description of the hardware.
        endpoint : str or None
            Path or address that replaces the platform's device, for example that of an emulator.
        clock : callable
            Returns a monotonic time [s].
        lockstep : bool
            Whether the cycles advance the time of the devices: each cycle waits for its answers, at most
            `lockstep_timeout_s`, and no step waits for the clock.
        """
        regulator: Regulator = self.find(self.driver)(platform, endpoint, clock, lockstep)
        return regulator

    def find(self, place: str) -> Any:
        """Import the module of a place ``module:name`` and return the object of that name.

        Raises
        ------
        MissingPackageError
            If the library of the family's bus is not installed.
        """
        module, name = place.split(":")
        with named_packages():
            return getattr(import_module(module), name)


FAMILIES = {
    "canopen_408": Family(
        config="soro_hardware.canopen.config:CanopenPlatform",
        driver="soro_hardware.canopen.driver:open_driver",
        emulator="soro_hardware.emulation.canopen.world:emulate",
        tried_on="no device; node and master of the package canopen",
    ),
    "itv_rs232": Family(
        config="soro_hardware.serial_line.config:ItvPlatform",
        driver="soro_hardware.serial_line.dialects:open_itv",
        emulator="soro_hardware.emulation.serial_line.devices:ItvDevices",
        tried_on="no device and no program of another author",
    ),
    "alicat": Family(
        config="soro_hardware.serial_line.config:AlicatPlatform",
        driver="soro_hardware.serial_line.dialects:open_alicat",
        emulator="soro_hardware.emulation.serial_line.devices:AlicatDevices",
        tried_on="no device; the client alicatlib on the emulated units",
    ),
    "veab_tcp": Family(
        config="soro_hardware.veab.config:VeabPlatform",
        driver="soro_hardware.veab.driver:open_driver",
        emulator="soro_hardware.emulation.veab:EmulatedVeabServer",
        tried_on="no device and no program of another author",
    ),
    "soro_board": Family(
        config="soro_hardware.board.config:BoardPlatform",
        driver="soro_hardware.board.driver:open_driver",
        emulator="soro_hardware.emulation.board.board:EmulatedBoard",
        tried_on="no device and no program of another author",
    ),
    "vtem_modbus": Family(
        config="soro_hardware.vtem.config:VtemPlatform",
        driver="soro_hardware.vtem.driver:open_driver",
        emulator="soro_hardware.emulation.vtem:EmulatedTerminal",
        tried_on="no device; client and server of pyModbusTCP",
    ),
}

Platform: TypeAlias = PlatformBase


def names() -> tuple[str, ...]:
    """Return the names of all families: shipped ones first."""
    return registered.names_of(GROUP, FAMILIES)


def find_family(name: str) -> Family:
    """Return the family of a name.

    Raises
    ------
    ValueError
        If there is none of this name, or its package does not load; the text says what is allowed.
    """
    if name in FAMILIES:
        return FAMILIES[name]
    family: Family = registered.load(
        GROUP, FAMILIES, name, lambda found: isinstance(found, Family), "soro_hardware.families.Family"
    )
    return family


def parse_platform(data: Mapping[str, Any], where: str) -> PlatformBase:
    """Check a mapping against the model of its family.

    Raises
    ------
    ConfigError
        If a key is wrong; the message states the allowed values.
    """
    found = data.get("family", "nothing")
    try:
        family = find_family(found if isinstance(found, str) else "")
    except ValueError as error:
        raise ConfigError(where, "family", found, str(error)) from None
    model: type[PlatformBase] = family.find(family.config)
    return parse(data, model, where)


def load_platform(name_or_path: str | Path) -> PlatformBase:
    """Read a platform file, or a shipped one by its name (``emulated_canopen``).

    Raises
    ------
    ConfigError
        If there is no such file or a key is wrong; the message states the allowed values.
    """
    path = find_config(name_or_path, "platforms")
    return parse_platform(read_yaml(path), where=str(path))


def require_driver(platform: PlatformBase) -> None:
    """Import the driver of a platform, so that a missing library ends a command at its start.

    Raises
    ------
    MissingPackageError
        If the library of the family's bus is not installed.
    """
    family = find_family(platform.family)
    family.find(family.driver)


def open_regulator(
    platform: PlatformBase,
    endpoint: str | None = None,
    clock: Callable[[], float] = time.monotonic,
    lockstep: bool = False,
) -> Regulator:
    """Make the driver of a platform; parameters as in `Family.open`."""
    return find_family(platform.family).open(platform, endpoint, clock, lockstep)
