"""Pressure regulators behind one port: drivers, supervisor, doctor, procedures, emulated devices."""

from soro_hardware.families import Platform, load_platform, open_regulator
from soro_hardware.platform import PlatformBase
from soro_hardware.port import BusStatistics, Exchange, Fault, Regulator

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
