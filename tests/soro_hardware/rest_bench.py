"""Drivers of every family at rest on emulated devices in lockstep, and what their supervisor is told."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from board_bench import BoardBench, VeabBench, board_platform, veab_platform
from hardware_bench import PERIOD_NS, Bench, platform
from serial_bench import AIR, COMMON, LoopPort, SerialBench, alicat, itv
from test_canopen_mapping import FOUR, SCALING
from test_conformance import LINE
from vtem_bench import VtemBench, vtem_platform

from docs.line_family import LineDevice, LinePlatform, LineRegulator
from soro_core.config import parse
from soro_hardware.emulation.devices import EmulatedDevices
from soro_hardware.emulation.faults.fault_types import Injection
from soro_hardware.emulation.veab import EmulatedVeabServer
from soro_hardware.port import EMPTY_PA, Exchange, Regulator
from tests.soro_hardware.line_link import LineLink

SETTLED_PA = 50.0  # a count of a DAC of 12 bit


class Told:
    """In the place of the supervisor's process: what the driver says to it."""

    is_alive = True

    def __init__(self) -> None:
        self.pressed = False
        self.dismissed: bool | None = None

    def watches(self, pressed: bool) -> bool:
        """Whether pressure is asked for, or a device was not seen at zero."""
        self.pressed = pressed
        return True

    def hold(self, plan: Any, descriptors: Any) -> None:
        """The plan is not looked at here."""

    release = wait_until_ready = lambda self: None

    def dismiss(self, vented: bool = True) -> None:
        """Whether the driver says that the arm is empty."""
        self.dismissed = vented


@dataclass
class Resting:
    """A driver and its devices.

    `patience` is the number of cycles in which a set point of zero and a reading must have reached every
    device; `empty_pa` what the family takes for an empty chamber.
    """

    driver: Regulator
    devices: EmulatedDevices
    patience: int
    empty_pa: float = EMPTY_PA
    supervise: Callable[[Told], None] | None = None
    ports: Sequence[LoopPort] = ()
    told: Told = field(default_factory=Told)
    now_ns: int = 0

    def configure(self) -> None:
        """Start up; from then on the supervisor is written down."""
        self.driver.configure()
        if self.supervise is not None:
            self.supervise(self.told)

    def exchange(self, setpoint_pa: float) -> Exchange:
        """One cycle."""
        self.now_ns += PERIOD_NS
        return self.driver.exchange(np.full(self.driver.n_chambers, setpoint_pa), self.now_ns)

    @property
    def demand_pa(self) -> np.ndarray:
        """What each valve does now [Pa gauge]; one that vents asks for nothing."""
        return np.nan_to_num(self.devices.air.demand_pa[self.devices.places])

    def give(self, chamber: int, pressure_pa: float) -> None:
        """Another program, or a hand at the front panel, gives a device a set point."""
        self.devices.air.advance(self.devices.now_ns)
        self.devices.give_setpoint(self.devices.places[chamber], pressure_pa)

    def restart(self, chamber: int) -> None:
        """A device loses its power and has it again; a program that has ended is started by hand."""
        self.inject("reboot", chamber)
        if isinstance(self.devices, EmulatedVeabServer):
            self.devices.start()

    def unplug(self) -> None:
        """Whatever connects host and devices is pulled out, for good."""
        for line in self.devices.lines:
            line.hang_up = line.refuses = True
        for port in self.ports:
            port.gone = True

    def inject(self, fault: str, chamber: int, **parameters: float) -> None:
        """Begin a fault of a device, where the family has it."""
        if fault in self.devices.faults.supported:
            named = {"fault": fault, "chamber": self.driver.chamber_names[chamber], **parameters}
            self.devices.faults.add(Injection.model_validate(named))


def _of(bench: Any, patience: int, is_supervised: bool = False, empty_pa: float = EMPTY_PA) -> Resting:
    devices = bench.world if hasattr(bench, "world") else bench.devices

    def supervise(told: Told) -> None:
        bench.driver.supervisor = told

    ports = getattr(bench, "ports", ())
    return Resting(bench.driver, devices, patience, empty_pa, supervise if is_supervised else None, ports)


def _serial(make: Any, patience: int, wake_pa: float, **changes: Any) -> Resting:
    emulation = {**COMMON["emulation"], **changes.pop("emulation", {}), "wake_pa": wake_pa}
    return _of(SerialBench(make(emulation=emulation, **changes)), patience, True)


def _line(wake_pa: float) -> Resting:
    described = parse({**LINE, "regulator": AIR, "emulation": {"wake_pa": wake_pa}}, LinePlatform, "test")
    devices = LineDevice(described, lockstep=True, seed=0)
    clock = itertools.count(0.0, 1e-3).__next__  # a device that is silent costs no time
    return Resting(LineRegulator(described, LineLink(devices.line), clock, lockstep=True), devices, 2)


# Four channels behind one node whose EDS names neither heartbeat consumer nor deadline.
COUPLER = {"valves": FOUR, "canopen": {"mapping": {"device": "aventics_aes", "scaling": SCALING}}}
# By the set point with which their devices wake.
FAMILIES: dict[str, Callable[[float], Resting]] = {
    "canopen_408": lambda wake_pa: _of(Bench(platform(emulation={"wake_pa": wake_pa})), 2),
    "analog coupler without a watchdog": lambda wake_pa: _of(
        Bench(platform(**COUPLER, emulation={"wake_pa": wake_pa})), 2
    ),
    "veab_tcp": lambda wake_pa: _of(VeabBench(veab_platform(emulation={"wake_pa": wake_pa})), 2, True, 5e3),
    "soro_board": lambda wake_pa: _of(BoardBench(board_platform(emulation={"wake_pa": wake_pa})), 2),
    "vtem_modbus": lambda wake_pa: _of(VtemBench(vtem_platform(emulation={"wake_pa": wake_pa})), 2, True),
    "line": _line,
    # Seen by the question that comes every 0.1 s, asked again, and then sent 0.
    "itv_rs232": lambda wake_pa: _serial(itv, 20 + 20, wake_pa),
    "alicat": lambda wake_pa: _serial(alicat, 30, wake_pa),
    "alicat at 19200 with firmware 5": lambda wake_pa: _serial(
        alicat, 70, wake_pa, baud=19200, emulation={"firmware": "5v12.0-R22"}
    ),
}
