"""Pressure regulators behind one port: drivers, transports and emulated devices."""

from soro_core.hardware.families import Platform, load_platform, open_regulator
from soro_core.hardware.platform import PlatformBase
from soro_core.hardware.port import BusStatistics, Exchange, Fault, Regulator

__all__ = [
    "BusStatistics",
    "Exchange",
    "Fault",
    "Platform",
    "PlatformBase",
    "Regulator",
    "load_platform",
    "open_regulator",
]
