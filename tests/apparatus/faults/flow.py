"""The chambers of a running twin behind the emulated valves: flow after ISO 6358 in place of a lag."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from soro_core.arrays import Array
from soro_core.pneumatics import ValveAction, ValveModel, chamber_pressures, make_gas, masses_at
from soro_core.robot import load_robot
from soro_core.twin import Twin, TwinConfig
from tests.apparatus.faults.rigs import Rig

# Valve and chamber of docs/hardware.md: 0.1 l/(s bar) on 30 ml with its tube.
VALVE = ValveModel(fill_m3_s_pa=1e-9, vent_m3_s_pa=1e-9)
VOLUME_M3 = 30e-6
# With which it follows what the limiter lets through, and which the monitors expect: band over fastest rise.
LAG_S = 0.01
# How narrow a valve or line, how large a leak must be for the circle to show it in the time that the table
# gives a motion: this valve makes up for a leak of 20 a second until its set point is above 39 kPa.
NARROW, LEAK = 50.0, 30.0
_STEP_S = 1e-3


class Plant:
    """A twin whose chambers hold the air of a rig's valves."""

    def __init__(self, rig: Rig) -> None:
        one = load_robot("tue_three_bellow")
        links = [link.model_dump(exclude_unset=True) for link in one.links]
        for link in links:
            link["chambers"] = [{**chamber, "volume_m3": VOLUME_M3} for chamber in link["chambers"]]
        config = TwinConfig(air="states", valve=VALVE, refine=1, rate_hz=rig.platform.cycle_hz)
        self._twin = Twin(one.replace(links=links), config)
        self.state = self._twin.initial()

    def hear(self, time_ns: int, pressures: Array, action: ValveAction) -> None:
        """Advance by what the valves do."""
        self.state = self._twin.step_valves(self.state, action)
        if not self.state.status.ok:
            raise RuntimeError(str(self.state.status))

    @property
    def pressure_pa(self) -> Array:
        """Gauge pressures of the chambers [Pa]."""
        return self.state.air.pressure_pa

    @property
    def volume_m3(self) -> Array:
        """Volumes of the chambers [m^3]."""
        return VOLUME_M3 + self._twin.plant.arm.displaced_volume(self.state.arm.q)


def behind_a_twin(rig: Rig) -> Rig:
    """The same rig with its air in the chambers of a twin, which moves with it."""
    expected = rig.platform.regulator.model_copy(update={"tau_s": LAG_S, "vent_tau_s": 0.0})
    rig = replace(rig, platform=rig.platform.model_copy(update={"regulator": expected}))
    plant = Plant(rig)
    rig.devices.on_tick = plant.hear
    rig.devices.connect_plant(lambda: plant.pressure_pa)

    def vent_s(from_pa: float, to_pa: float, slower: float) -> float:
        return expected.delay_s + slower * vent_time(float(plant.volume_m3.max()), from_pa, to_pa)

    return replace(rig, vent_s=vent_s)


def vent_time(volume_m3: float, from_pa: float, to_pa: float) -> float:
    """Time [s] in which a healthy valve vents a chamber of constant volume."""
    volume, p = np.array([volume_m3]), np.array([from_pa])
    gas = make_gas(VALVE, volume)
    mass, slope, time_s = np.empty(1), np.empty(1), 0.0
    masses_at(gas, p, volume, mass)
    while p[0] >= to_pa:
        chamber_pressures(gas, mass.copy(), volume, volume, np.zeros(1), _STEP_S, mass, p, slope)
        time_s += _STEP_S
    return time_s
