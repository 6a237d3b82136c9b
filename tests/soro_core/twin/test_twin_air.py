"""Pneumatic states of a twin: the air behind its valves and the arm, one step together."""

import subprocess
import sys

import numpy as np
import pytest

from soro_core import load_robot, simulate
from soro_core.errors import ConfigError, ModelError
from soro_core.pneumatics import RegulatorModel, ValveModel
from soro_core.pneumatics.chamber import AMBIENT_PA, GAS_CONSTANT
from soro_core.pneumatics.flow import REFERENCE_DENSITY
from soro_core.twin import SensorConfig, Twin, TwinConfig
from soro_lab.scene import Scene, check_model
from tests.collapsing_arm import collapsing_arm
from tests.refused import fails, refused

V = 30e-6
C = 1e-9
IDEAL = RegulatorModel(
    delay_s=0.0, hysteresis_pa=0.0, command_resolution_pa=0.0, reading_resolution_pa=0.0, reading_noise_pa=0.0
)
# Opens fully at any deviation.
OPEN = ValveModel(band_pa=1.0)
STRONG = OPEN.model_copy(update={"supply_pa": 600e3})
SETPOINT = np.array([60e3, 20e3, 0.0])


@pytest.fixture(scope="module")
def robot(robot_with_tubes):
    return robot_with_tubes


def twin_of(robot, valve=OPEN, regulator=IDEAL, **keys):
    return Twin(robot, TwinConfig(air="states", valve=valve, regulator=regulator, refine=2, **keys))


def air_of(twin, state):
    """Masses and volumes."""
    return np.split(state.arm.internal[twin.plant.arm.n_internal :], 2)


def advance(twin, state, setpoint, ticks):
    """States after each tick, the first given."""
    states = [state]
    for _ in range(ticks):
        states.append(twin.step_setpoints(states[-1], setpoint))
        assert states[-1].status.ok, states[-1].status
    return states


def time_to(states, level, dt):
    """Time at which the pressure of the first chamber passes a level, on straight lines between ticks."""
    p = np.array([state.air.pressure_pa[0] for state in states]) - level
    k = int(np.argmax(p * p[0] <= 0.0))
    return dt * (k - 1 + p[k - 1] / (p[k - 1] - p[k]))


def test_a_chamber_fills_with_choked_flow(robot):
    """m' = C rho_0 P_supply while open, whatever the arm does; the supply is critical to 144 kPa."""
    twin = twin_of(robot, STRONG)
    states = advance(twin, twin.initial(), np.full(3, 90e3), 6)
    gained = np.array([air_of(twin, state)[0] for state in states]) - air_of(twin, states[0])[0]
    flow = C * REFERENCE_DENSITY * (600e3 + AMBIENT_PA)
    assert gained == pytest.approx(np.outer(np.arange(7) * twin.dt * flow, np.ones(3)), rel=1e-9, abs=1e-18)
    assert 30e3 < states[-1].air.pressure_pa[0] < 80e3


def test_venting_takes_two_and_a_half_times_as_long_as_filling(robot):
    """63 % of 50 kPa at a supply of 150 kPa and 30 ml: 39 and 92 ms in rigid chambers."""
    twin = twin_of(robot, rate_hz=1000.0)
    level = 50e3 * (1.0 - np.exp(-1.0))
    fill = advance(twin, twin.initial(), np.full(3, 50e3), 100)
    vent = advance(twin, twin.initial(np.full(3, 50e3)), np.zeros(3), 150)
    times = time_to(fill, level, twin.dt), time_to(vent, 50e3 - level, twin.dt)
    assert times == (pytest.approx(0.039, rel=0.05), pytest.approx(0.092, rel=0.05))
    assert 2.2 < times[1] / times[0] < 2.6


@pytest.mark.parametrize(("conductance", "fills_s"), [(1e-9, 0.0022), (5e-11, 0.056)])
def test_how_fast_a_valve_is_for_the_chambers_of_the_shipped_robot(conductance, fills_s):
    """Of 1.5 ml; docs/model_terms.md has these figures beside the lag of 52 ms."""
    valve = ValveModel(fill_m3_s_pa=conductance, vent_m3_s_pa=conductance)
    twin = twin_of(load_robot("tue_three_bellow"), valve, rate_hz=1000.0)
    fill = advance(twin, twin.initial(), np.full(3, 50e3), 60)
    assert time_to(fill, 50e3 * (1.0 - np.exp(-1.0)), twin.dt) == pytest.approx(fills_s, rel=0.1)


def test_the_volume_grows_with_the_arm_and_thins_the_air():
    """Chambers of 1.5 ml, without tubes: their growth counts."""
    twin = twin_of(load_robot("tue_three_bellow"), ValveModel(fill_m3_s_pa=2e-11, vent_m3_s_pa=2e-11))
    arm = twin.plant.arm
    start = twin.initial()
    end = advance(twin, start, SETPOINT, 80)[-1]
    (_, before), (mass, volume) = air_of(twin, start), air_of(twin, end)
    assert volume == pytest.approx(
        before + arm.displaced_volume(end.arm.q) - arm.displaced_volume(start.arm.q)
    )
    assert volume[0] > 1.02 * before[0]
    pressure = mass * GAS_CONSTANT * 293.15 / volume - AMBIENT_PA
    assert end.air.pressure_pa == pytest.approx(pressure, rel=1e-9, abs=1e-6)


def test_ticks_are_the_steps_of_a_simulation(robot):
    """One place for the air: the twin adds nothing to `simulate`."""
    valve = ValveModel(fill_m3_s_pa=1e-10, vent_m3_s_pa=1e-10, leak_m3_s_pa=1e-12, polytropic=1.2)
    twin = twin_of(robot, valve, integrator="tr_bdf2")
    start = twin.initial(np.array([10e3, 0.0, 5e3]))
    end = advance(twin, start, SETPOINT, 40)[-1]
    run = simulate(
        twin.plant.arm,
        start.arm.q,
        t_end=40 * twin.dt,
        dt=2.5e-3,
        integrator="tr_bdf2",
        pressure=SETPOINT,
        valves=valve,
        pressure0=start.air.pressure_pa,
    )
    assert run.status == "ok"
    assert end.arm.q == pytest.approx(run.q[-1], rel=1e-9)
    assert end.air.pressure_pa == pytest.approx(run.pressure[-1], rel=1e-9)


def test_a_pressurised_start_stays_at_rest(robot):
    pressure = np.array([30e3, 10e3, 20e3])
    twin = twin_of(robot)
    start = twin.initial(pressure)
    end = advance(twin, start, pressure, 40)[-1]
    assert end.air.pressure_pa == pytest.approx(pressure, abs=0.1)
    assert end.arm.q == pytest.approx(start.arm.q, rel=1e-4, abs=1e-6)


def test_the_regulators_dead_time_comes_before_the_valve(robot):
    """7 ms at ticks of 5 ms: nothing moves in the first, the air flows for 3 ms of the second."""
    delayed = IDEAL.model_copy(update={"delay_s": 0.007})
    twin = twin_of(robot, STRONG, delayed)
    first, second = advance(twin, twin.initial(), np.full(3, 90e3), 2)[1:]
    assert first.air.pressure_pa == pytest.approx(np.zeros(3), abs=0.1)
    gained = air_of(twin, second)[0] - air_of(twin, first)[0]
    flow = C * REFERENCE_DENSITY * (600e3 + AMBIENT_PA)
    assert gained == pytest.approx(np.full(3, 0.003 * flow), rel=1e-3)


def test_readings_have_the_regulators_noise_and_steps(robot):
    coarse = IDEAL.model_copy(update={"reading_resolution_pa": 100.0, "reading_noise_pa": 50.0})
    twin = twin_of(robot, regulator=coarse, imu=SensorConfig(rate_hz=200.0, delay_s=0.0))
    state, errors = twin.initial(), []
    for _ in range(200):
        state = twin.step_setpoints(state, SETPOINT)
        state, seen = twin.observe(state)
        assert np.abs(np.rint(seen.reading_pa / 100.0) * 100.0 - seen.reading_pa).max() < 1e-9
        assert np.isfinite(seen.imus[0].linear_acceleration).all()
        errors.append(seen.reading_pa - twin.plant.pressures(state.arm))
    assert np.std(errors) == pytest.approx(np.hypot(50.0, 100.0 / np.sqrt(12.0)), rel=0.1)


def test_a_failed_step_stops_at_the_last_good_state(robot):
    twin = twin_of(robot)
    good = advance(twin, twin.initial(), SETPOINT, 3)[-1]
    failed = twin.step_setpoints(good, np.full(3, np.nan))
    assert "not finite" in failed.status
    assert failed.arm is good.arm
    assert failed.air.pressure_pa == pytest.approx(good.air.pressure_pa)


def test_what_is_not_asked_for_is_not_there(robot):
    twin = Twin(robot, TwinConfig())
    assert twin.initial().arm.internal.shape == (twin.plant.arm.n_internal,)
    with fails(ModelError, key="valves"):
        twin.plant.pressures(twin.initial().arm)


def test_pressures_from_elsewhere_are_refused(robot):
    twin = twin_of(robot)
    with fails(ModelError, "states", "lag", key="air"):
        twin.step_pressures(twin.initial(), SETPOINT)


@pytest.mark.parametrize(
    ("keys", "found"),
    [
        ({"air": "states", "pressures": "measured"}, ("", "air: lag", "pressures: measured")),
        ({"valve": {"band_pa": 10.0}}, ("valve", "air: lag")),
        ({"air": "valves"}, ("air", "'valves'", "'lag'", "'states'")),
        ({"air": "states", "valve": {"fill": 1e-9}}, ("valve.fill", "'an unknown key'")),
        ({"air": "states", "valve": {"supply_pa": -1.0}}, ("valve.supply_pa", "-1.0")),
    ],
)
def test_mistakes_are_named(keys, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        TwinConfig(**keys)


def test_a_robot_without_volumes_is_refused_with_what_it_lacks():
    with fails(ConfigError, "lag", "volume_m3", "link0/chamber0", where="parameters of twin", key="air"):
        Twin(collapsing_arm(), TwinConfig(air="states"))


def test_a_scene_refuses_what_has_no_air_of_its_own(robot):
    with refused("", names=("air: states", "valves: real")):
        Scene(platform="emulated_canopen", valves="real", twin={"air": "states"})
    behind = Scene(platform="emulated_canopen", twin={"air": "states"})
    with refused("twin.air", "states", ("volume_m3", "link0/chamber0")):
        check_model(behind, collapsing_arm(), "scene.yaml")
    scene = Scene(twin={"air": "states", "valve": {"band_pa": 500.0}})
    check_model(scene, robot, "scene.yaml")
    assert scene.twin_node().valve.band_pa == 500.0
    with fails(ConfigError, "volume_m3", "link0/chamber0", where="scene.yaml", key="twin.air", got="states"):
        check_model(scene, collapsing_arm(), "scene.yaml")


@pytest.mark.parametrize("integrator", ["rk4", "dopri5"])
def test_explicit_integrators_are_refused_before_and_after_the_start(robot, integrator):
    scene = Scene(model={"integrator": integrator}, twin={"air": "states"})
    with refused("twin.air", names=(integrator, "lag")):
        check_model(scene, robot, "scene.yaml")
    with fails(ModelError, integrator, "trapezoidal", key="integrator"):
        Twin(robot, scene.twin_node())


@pytest.mark.process
def test_configurations_load_no_kernels():
    """A regulator node, an emulator or `soro doctor` on a small computer must not pay for numba."""
    code = (
        "import sys\n"
        "from soro_lab.scene import Scene, RegulatorNodeConfig\n"
        "Scene(twin={'air': 'states', 'valve': {'band_pa': 500.0}}), RegulatorNodeConfig()\n"
        "print(*sorted({'numba', 'rclpy', 'scipy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.stdout.strip(), done.stderr) == ("", "")
