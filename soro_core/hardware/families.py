"""The families of regulators: the one list that names them all, by where their parts are found.

A family is a folder with three things: the model of its platform files, a function that makes its driver, and
one that makes its emulated devices. Each is imported when it is asked for, so that a driver does not load
the other buses' libraries and an emulator no driver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from soro_core.hardware.emulation.devices import EmulatedDevices
    from soro_core.hardware.platform import PlatformBase
    from soro_core.hardware.port import Regulator


@dataclass(frozen=True)
class Family:
    """Where the parts of one family are, as ``module:name`` below a package.

    Attributes
    ----------
    config : str
        A `PlatformBase` with the family's own keys.
    driver : str
        ``open(platform, endpoint, clock, lockstep) -> Regulator``; opens nothing before `configure`.
    emulator : str
        ``emulate(platform, lockstep, seed) -> EmulatedDevices``.
    package : str
        Where they are; a family outside this tree names its own.
    """

    config: str
    driver: str
    emulator: str
    package: str = "soro_core.hardware"

    def platform_model(self) -> type[PlatformBase]:
        """Model of the family's platform files."""
        model: type[PlatformBase] = self._find(self.config)
        return model

    def open(
        self, platform: PlatformBase, endpoint: str | None, clock: Callable[[], float], lockstep: bool
    ) -> Regulator:
        """Make the driver of a platform."""
        regulator: Regulator = self._find(self.driver)(platform, endpoint, clock, lockstep)
        return regulator

    def emulate(self, platform: PlatformBase, lockstep: bool, seed: int) -> EmulatedDevices:
        """Make the emulated devices of a platform."""
        devices: EmulatedDevices = self._find(self.emulator)(platform, lockstep, seed)
        devices.connect_faults(platform.chamber_names, seed)
        return devices

    def _find(self, place: str) -> Any:
        module, name = place.split(":")
        return getattr(import_module(f"{self.package}.{module}"), name)


FAMILIES = {
    "canopen_408": Family(
        config="canopen.config:CanopenPlatform",
        driver="canopen.driver:open_driver",
        emulator="emulation.world:emulate",
    ),
    "itv_rs232": Family(
        config="serial_line.config:ItvPlatform",
        driver="serial_line.dialects:open_itv",
        emulator="serial_line.emulated:emulate_itv",
    ),
    "alicat": Family(
        config="serial_line.config:AlicatPlatform",
        driver="serial_line.dialects:open_alicat",
        emulator="serial_line.emulated:emulate_alicat",
    ),
    "veab_tcp": Family(
        config="veab.config:VeabPlatform",
        driver="veab.driver:open_driver",
        emulator="veab.emulated:emulate",
    ),
    "soro_board": Family(
        config="board.config:BoardPlatform",
        driver="board.driver:open_driver",
        emulator="board.emulated:emulate",
    ),
    "vtem_modbus": Family(
        config="vtem.config:VtemPlatform",
        driver="vtem.driver:open_driver",
        emulator="vtem.emulated:emulate",
    ),
}
