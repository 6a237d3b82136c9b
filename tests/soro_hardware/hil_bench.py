"""A first pressurisation on emulated valves in this process, in lockstep."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from hardware_bench import Bench, platform

from soro_core.errors import HardwareError
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import load_robot
from soro_hardware import BusStatistics, Exchange, PlatformBase, Regulator
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.emulation.air import EmulatedPressures
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_hardware.emulation.faults.schedule import FaultSchedule
from soro_hardware.hil.paced import CycleSample, PacedRegulator, small_limits
from soro_hardware.hil.plan import FirstPressureConfig, HilPlan, ProcedureState
from soro_hardware.hil.pressurise import expectation, pressurise

CONFIG = FirstPressureConfig(steps_pa=(5e3, 20e3), rest_s=0.5, hold_s=0.6, vent_s=3.0)
NAMES = ("link0/chamber0", "link0/chamber1", "link0/chamber2")
ROBOT = "tue_three_bellow"


class OnAir(Regulator):
    """Emulated valves and their air without a bus between; the readings may come back on other chambers."""

    device_watchdog = True
    chamber_names = NAMES
    update_hz = 200.0
    statistics = BusStatistics()

    def __init__(self, described: PlatformBase, sensors: tuple[int, ...] = (0, 1, 2)) -> None:
        self._sensors, self._setpoint = list(sensors), np.zeros(3)
        self.gone, self.vents = False, 0
        demands = [lambda n=n: float(self._setpoint[n]) for n in range(3)]
        self.air = EmulatedPressures(described.regulator, demands, np.random.default_rng(1))
        self.faults = self.air.faults = FaultSchedule(1)
        self.faults.chambers = NAMES

    @property
    def pressure_pa(self) -> np.ndarray:
        return self.air.pressure_pa

    def configure(self) -> None:
        """Nothing to do."""

    def exchange(self, setpoint_pa: np.ndarray, now_ns: int) -> Exchange:
        if self.gone:
            raise HardwareError("the adapter is gone")
        self.air.advance(now_ns)
        self.faults.advance(now_ns)
        reading = np.array([self.air.reading_pa(n) for n in self._sensors])
        self._setpoint = setpoint_pa.copy()
        return Exchange(self._setpoint, reading, np.ones(3, dtype=bool))

    def vent(self) -> None:
        self.vents += 1
        self._setpoint = np.zeros(3)

    close = vent


class OnCan(Bench):
    """The same with all the frames of a CAN bus."""

    def __init__(self, described: CanopenPlatform) -> None:
        super().__init__(described)
        self.faults = self.world.faults

    @property
    def pressure_pa(self) -> np.ndarray:
        return self.world.pressure_pa


@dataclass
class Pressurised:
    """A rig with what went over the wire, and what was found."""

    config: FirstPressureConfig = CONFIG
    wiring: tuple[int, ...] = (0, 1, 2)  # which chamber of the arm each valve really feeds
    sensors: tuple[int, ...] = (0, 1, 2)  # whose reading comes back as that of each chamber
    arm: bool = False
    share: tuple[float, ...] = (1.0, 1.0, 1.0)  # part of its force that each chamber gives
    confirm: bool = False
    directions: tuple[str, ...] = ()
    fault: str = ""
    can: bool = False
    answer: Callable[[str], str | None] = lambda question: "y"
    stop_at: int = 10**9
    samples: list[CycleSample] = field(default_factory=list)
    true_pa: list[np.ndarray] = field(default_factory=list)
    questions: list[str] = field(default_factory=list)

    def run(self) -> ProcedureState:
        """Carry it out."""
        described = platform()
        self.devices = OnCan(described) if self.can else OnAir(described, self.sensors)
        driver = self.devices.driver if self.can else self.devices
        driver.configure()
        if self.fault:
            self.devices.faults.add(read_injection(self.fault))
        config = self.config
        limits = small_limits(described, config.steps_pa[-1], config.rise_pa_s)
        self.true = SoftArm(load_robot(ROBOT)) if self.arm else None
        expected = expectation(described, driver.update_hz, config, self.true and self.true.robot)
        guarded = PacedRegulator(described, driver, limits, lockstep=True, tip=self._tip)
        self.limited, self._waiting = guarded, []
        self.plan = HilPlan(config, expected, self.confirm, self.directions)
        return pressurise(
            self.plan,
            guarded,
            self.record,
            self._ask,
            lambda: self._waiting.pop() if self._waiting else None,
            lambda: len(self.samples) >= self.stop_at,
        )

    def _tip(self) -> np.ndarray | None:
        """Where the arm rests under the pressures of now, by a marker that is not where the file says."""
        if self.true is None:
            return None
        pressure = np.zeros(3)
        pressure[list(self.wiring)] = self.devices.pressure_pa
        shape = equilibrium(self.true, np.array(self.share) * pressure)
        return self.true.pose(shape, self.true.length)[:3, 3] + [0.5, 0.1, 0.02]

    def record(self, sample: CycleSample) -> None:
        """Take a sample of the run."""
        self.samples.append(sample)
        self.true_pa.append(self.devices.pressure_pa.copy())

    def _ask(self, question: str) -> None:
        self.questions.append(question)
        if (answer := self.answer(question)) is not None:
            self._waiting.append(answer)


def failed(state: ProcedureState) -> dict[str, str]:
    """What failed: name and what was found."""
    return {finding.name: finding.found for finding in state.findings if finding.level == "fail"}
