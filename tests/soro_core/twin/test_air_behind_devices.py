"""The air of a twin behind emulated valves: they say what they do, and read what pressures come of it."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.pneumatics import ValveAction, ValveModel, healthy
from soro_core.twin import Twin, TwinConfig
from soro_hardware import load_platform
from soro_hardware.emulation.faults.fault_types import Injection
from soro_hardware.emulation.process import emulate
from tests.apparatus.faults.matrix import FOUR
from tests.apparatus.faults.rigs import PLATFORMS, rig_of
from tests.apparatus.faults.rows import Row
from tests.refused import fails

VALVE = ValveModel(fill_m3_s_pa=1e-9, vent_m3_s_pa=1e-9)
PERIOD_NS = 5_000_000
EVERY = ("emulated_canopen", "itv_serial", "alicat_serial", "veab_tcp", "soro_board", "vtem_modbus")


@pytest.fixture(scope="module")
def robot(robot_with_tubes):
    return robot_with_tubes


class Coupled:
    """Emulated devices in lockstep whose valves are told directly, and a twin that moves their air."""

    def __init__(self, robot, platform="emulated_canopen"):
        self.platform = load_platform(platform) if isinstance(platform, str) else platform
        self.devices = emulate(self.platform, True, 1)
        config = TwinConfig(air="states", valve=VALVE, regulator=self.platform.regulator, refine=1)
        self.twin = Twin(robot, config)
        self.state = self.twin.initial()
        self.demands = [0.0] * len(self.devices.air.pressure_pa)
        given = [lambda n=n: self.demands[n] for n in range(len(self.demands))]
        self.devices.connect_air(given, self.devices.places)
        self.devices.on_tick = self.heard
        self.devices.connect_plant(lambda: self.state.air.pressure_pa)

    def heard(self, time_ns, pressures, action):
        self.state = self.twin.step_valves(self.state, action)
        assert self.state.status.ok, self.state.status

    def demand(self, *demands):
        for place, demand in zip(self.devices.places, demands, strict=True):
            self.demands[place] = demand

    def inject(self, fault, chamber="link0/chamber1", **keys):
        self.devices.faults.add(Injection(fault=fault, chamber=chamber, **keys))

    def run(self, ticks, *demands):
        if demands:
            self.demand(*demands)
        for _ in range(ticks):
            self.devices.tick(self.devices.now_ns + PERIOD_NS)
        return self.devices.pressure_pa


@pytest.mark.parametrize("platform", EVERY)
def test_behind_every_family_the_air_moves_as_behind_the_twins_own_valves(robot, platform):
    coupled = Coupled(robot, platform)
    alone, n = coupled.twin.initial(), len(coupled.platform.valves)
    setpoint = np.zeros(3)
    for tick in range(120):
        setpoint = np.array([40e3, 25e3, 10e3]) if tick < 60 else np.array([5e3, 60e3, 0.0])
        coupled.run(1, *np.resize(setpoint, n))
        alone = coupled.twin.step_setpoints(alone, setpoint)
        np.testing.assert_array_equal(coupled.devices.pressure_pa, alone.air.pressure_pa)
        np.testing.assert_array_equal(coupled.state.arm.q, alone.arm.q)
    assert coupled.devices.pressure_pa[1] > 50e3


def test_readings_are_those_of_the_moved_air(robot):
    coupled = Coupled(robot)
    coupled.run(100, 50e3, 20e3, 0.0)
    readings = np.array(
        [[coupled.devices.air.reading_pa(n) for n in range(3)] for _ in range(60) if len(coupled.run(1))]
    )
    noise = coupled.platform.regulator.reading_noise_pa
    np.testing.assert_allclose(readings.mean(axis=0), coupled.state.air.pressure_pa, atol=noise)
    assert noise / 2 < readings[:, 0].std() < 2 * noise


def test_a_vent_takes_the_time_of_the_flow(robot):
    """All valves let go: faster at first than a lag, and down to nothing."""
    coupled = Coupled(robot)
    coupled.run(200, 60e3, 60e3, 60e3)
    ticks = 0
    coupled.demand(None, None, None)
    while coupled.run(1).max() >= 5e3:
        ticks += 1
        assert ticks < 200
    assert 0.1 < ticks * 5e-3 < 0.35
    assert coupled.run(200).max() < 10.0


@pytest.mark.parametrize(
    ("fault", "keys", "low", "high"),
    [
        ("stuck_open", {}, 145e3, 150.1e3),
        ("stuck_closed", {}, 29e3, 31e3),
        ("stuck_at", {"value": 50e3}, 49e3, 51e3),
        ("leak", {"value": 20.0}, 5e3, 69e3),
        ("burst", {}, -1.0, 5e3),
        ("supply_drop", {"value": 20e3}, 19e3, 21e3),
        ("vent_blocked", {}, 69e3, 71e3),
        ("kinked_line", {"value": 50.0}, 31e3, 55e3),
        ("slow_valve", {"value": 50.0}, 31e3, 55e3),
    ],
)
def test_faults_act_on_orifices_and_chambers(robot, fault, keys, low, high):
    coupled = Coupled(robot)
    coupled.run(200, 30e3, 30e3, 30e3)
    coupled.inject(fault, **keys)
    pressure = coupled.run(100, 30e3, 70e3, 30e3)
    assert low < pressure[1] < high
    np.testing.assert_allclose(pressure[[0, 2]], 30e3, atol=1500)


@pytest.mark.parametrize(
    ("fault", "stays"),
    [
        ("stuck_open", True),
        ("stuck_closed", True),
        ("vent_blocked", True),
        ("slow_valve", False),
        ("leak", False),
    ],
)
def test_a_vent_reaches_what_its_fault_lets_go(robot, fault, stays):
    coupled = Coupled(robot)
    coupled.run(200, 60e3, 60e3, 60e3)
    coupled.inject(fault)
    pressure = coupled.run(100, None, None, None)
    assert pressure[[0, 2]].max() < 100.0
    assert (pressure[1] > 50e3) == stays
    assert stays or pressure[1] < 100.0
    coupled.devices.faults.clear()
    assert coupled.run(100).max() < 100.0


def test_without_a_twin_the_air_goes_on_from_where_it_is(robot):
    coupled = Coupled(robot)
    coupled.run(100, 40e3, 40e3, 40e3)
    before = coupled.devices.pressure_pa.copy()
    coupled.devices.connect_plant(lambda: None)
    coupled.devices.on_tick = lambda *_: None
    after = coupled.run(1)
    np.testing.assert_allclose(after, before, atol=500)
    assert coupled.devices.air.take_action().spans == ()
    assert coupled.run(200, None, None, None).max() < 10.0


def test_a_twin_takes_over_at_the_pressures_that_there_are(robot):
    twin = Coupled(robot).twin
    state = twin.at_pressures(twin.initial(), np.array([30e3, 10e3, 0.0]))
    np.testing.assert_allclose(state.air.pressure_pa, [30e3, 10e3, 0.0])
    np.testing.assert_allclose(twin.plant.pressures(state.arm), [30e3, 10e3, 0.0], atol=1e-6)
    hold = ValveAction(((twin.dt, state.air.pressure_pa),), healthy(3))
    after = twin.step_valves(state, hold)
    np.testing.assert_allclose(after.air.pressure_pa, [30e3, 10e3, 0.0], atol=500)


def test_a_twin_with_a_lag_takes_no_actions(robot):
    twin = Twin(robot, TwinConfig(refine=1))
    with fails(ModelError, key="condition"):
        twin.step_valves(twin.initial(), ValveAction(((twin.dt, np.zeros(3)),), healthy(3)))


@pytest.mark.parametrize("family", sorted(set(PLATFORMS) - {FOUR}))
def test_the_valves_tell_of_all_time_that_passes(family):
    """By the family's own bytes: some advance their air more than once in a cycle."""
    rig, told = rig_of(family, Row("", "tolerate")), []
    rig.devices.connect_plant(lambda: np.zeros(3))
    rig.regulator.configure()
    rig.devices.on_tick = lambda time_ns, pressures, action: told.append(action.spans)
    try:
        for cycle in range(100):
            rig.regulator.exchange(np.array([30e3, 20e3, 10e3]), round(cycle * rig.period_s * 1e9))
    finally:
        rig.close()
    assert len(told) >= 100
    times = [sum(span for span, _ in spans) for spans in told[1:]]
    np.testing.assert_allclose(times, rig.period_s, rtol=1e-9)


def test_chambers_on_any_ports_of_a_board_keep_their_own_faults(robot):
    platform = load_platform("soro_board")
    valves = [v.model_copy(update={"port": n}) for v, n in zip(platform.valves, (5, 2, 9), strict=True)]
    coupled = Coupled(robot, platform.model_copy(update={"valves": tuple(valves)}))
    assert coupled.devices.places == [5, 2, 9]
    coupled.run(200, 20e3, 40e3, 60e3)
    np.testing.assert_allclose(coupled.devices.pressure_pa, [20e3, 40e3, 60e3], atol=1500)
    coupled.inject("vent_blocked", "link0/chamber2")
    pressure = coupled.run(100, None, None, None)
    assert pressure[:2].max() < 100.0
    assert pressure[2] > 55e3
