"""The list of all families of regulators.

A family has a model of its platform files, a function that makes its driver, and a function that makes its
emulated devices, which `soro_hardware.emulation.families` calls. Each part is imported when it is used: a driver
imports neither the library of another bus nor the emulator.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

from soro_core.config import find_config, parse, read_yaml
from soro_core.errors import ConfigError
from soro_core.extras import named_packages
from soro_hardware.platform import PlatformBase
from soro_hardware.port import Regulator


@dataclass(frozen=True)
class Family:
    """Parts of one family, as ``module:name`` relative to a package.

    Attributes
    ----------
    config : str
        Model of the platform files: a `PlatformBase` with the keys of the family.
    driver : str
        Function as `Family.open`.
    emulator : str
        Function ``emulate(platform, lockstep, seed) -> EmulatedDevices``.
    package : str
        Package of the parts; a family outside of soro states its own.
    """

    config: str
    driver: str
    emulator: str
    package: str = "soro_core"

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
            Whether the cycles advance the time of the devices.

        Returns
        -------
        Regulator
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
            return getattr(import_module(f"{self.package}.{module}"), name)


FAMILIES = {
    "canopen_408": Family(
        config="hardware.canopen.config:CanopenPlatform",
        driver="hardware.canopen.driver:open_driver",
        emulator="emulation.canopen.world:emulate",
    ),
    "itv_rs232": Family(
        config="hardware.serial_line.config:ItvPlatform",
        driver="hardware.serial_line.dialects:open_itv",
        emulator="emulation.serial_line.devices:ItvDevices",
    ),
    "alicat": Family(
        config="hardware.serial_line.config:AlicatPlatform",
        driver="hardware.serial_line.dialects:open_alicat",
        emulator="emulation.serial_line.devices:AlicatDevices",
    ),
    "veab_tcp": Family(
        config="hardware.veab.config:VeabPlatform",
        driver="hardware.veab.driver:open_driver",
        emulator="emulation.veab:EmulatedVeabServer",
    ),
    "soro_board": Family(
        config="hardware.board.config:BoardPlatform",
        driver="hardware.board.driver:open_driver",
        emulator="emulation.board.board:EmulatedBoard",
    ),
    "vtem_modbus": Family(
        config="hardware.vtem.config:VtemPlatform",
        driver="hardware.vtem.driver:open_driver",
        emulator="emulation.vtem:EmulatedTerminal",
    ),
}

Platform: TypeAlias = PlatformBase


def parse_platform(data: Mapping[str, Any], where: str) -> PlatformBase:
    """Check a mapping against the model of its family.

    Raises
    ------
    ConfigError
        If a key is wrong; the message states the allowed values.
    """
    found = data.get("family", "nothing")
    family = FAMILIES.get(found) if isinstance(found, str) else None
    if family is None:
        raise ConfigError(where, "family", found, f"one of {', '.join(FAMILIES)}")
    model: type[PlatformBase] = family.find(family.config)
    return parse(data, model, where)


def load_platform(name_or_path: str | Path) -> PlatformBase:
    """Read a platform file.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped file (``emulated_canopen``) or a path that ends in .yaml.

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
    family = FAMILIES[platform.family]
    family.find(family.driver)


def open_regulator(
    platform: PlatformBase,
    endpoint: str | None = None,
    clock: Callable[[], float] = time.monotonic,
    lockstep: bool = False,
) -> Regulator:
    """Make the driver of a platform, which opens nothing before `Regulator.configure`.

    Parameters
    ----------
    platform : PlatformBase
        Description of the hardware.
    endpoint : str, optional
        Path or address that replaces the platform's device, for example that of an emulator.
    clock : callable
        Returns a monotonic time [s].
    lockstep : bool
        Whether the cycles advance the time of the devices: each cycle waits for its answers, at most
        `lockstep_timeout_s`, and no step waits for the clock.

    Returns
    -------
    Regulator
    """
    return FAMILIES[platform.family].open(platform, endpoint, clock, lockstep)
