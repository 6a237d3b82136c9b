"""Pressure regulators behind one port: drivers, supervisor, doctor, procedures, emulated devices."""

from soro_hardware.families import Platform as Platform
from soro_hardware.families import load_platform as load_platform
from soro_hardware.families import open_regulator as open_regulator
from soro_hardware.platform import PlatformBase as PlatformBase
from soro_hardware.port import BusStatistics as BusStatistics
from soro_hardware.port import Exchange as Exchange
from soro_hardware.port import Fault as Fault
from soro_hardware.port import Regulator as Regulator
