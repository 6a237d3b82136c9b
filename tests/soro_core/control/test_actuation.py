"""Limits, lag and preview of the controller follow from what is stated elsewhere; its own file may differ."""

import numpy as np
import pytest

from soro_core import load_robot
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.config import AllocationConfig, ReferenceConfig
from soro_core.control.pressures.actuation import complete_pressures, contradictions
from soro_core.control.pressures.lag_compensation import compensate
from soro_core.pneumatics import RegulatorModel, initial_state, step
from soro_core.pneumatics.lag import follow
from soro_core.safety import Limits
from soro_lab.scene import ControllerNodeConfig, load_scene
from tests.refused import refused

NARROW = Limits(minimum_pa=-5e3, maximum_pa=60e3, rise_pa_s=100e3, fall_pa_s=150e3)
SLOW = RegulatorModel(tau_s=0.2, delay_s=0.03)
FROM_LIMITS = ("minimum_pa", "maximum_pa", "rise_pa_s", "fall_pa_s")


def values(pressures, names):
    return [getattr(pressures, name) for name in names]


def test_what_a_file_leaves_out_is_that_of_limits_and_regulators():
    found = complete_pressures(AllocationConfig(), NARROW, SLOW, 100.0, 0.010)
    assert values(found, FROM_LIMITS) == values(NARROW, FROM_LIMITS)
    assert found.lag_s == 0.2
    # 10 ms of transport, 30 ms dead time, a tenth of lag and half a hold that the inverse leaves.
    assert found.preview_s == pytest.approx(0.010 + 0.030 + (0.200 + 0.005) / 10)
    assert found.dead_time_s == pytest.approx(0.010 + 0.030)
    assert found.play_pa == SLOW.hysteresis_pa == 900.0
    assert complete_pressures(AllocationConfig(play_pa=50.0), NARROW, SLOW).play_pa == 50.0


def time_from_wish_to_pressure(found, response, rate_hz, ticks):
    """How late [s] a regulator is behind a wish that rises evenly, sent `ticks` after it was computed."""
    tick_s, slope, parts = 1.0 / rate_hz, 10e3, 50
    air, model, late = initial_state(response, 1), np.zeros(1), []
    sent = [np.zeros(1)] * ticks
    for tick in range(100):
        wish = np.array([slope * tick * tick_s])
        command = compensate(wish, model, found.lag_s, found.lag_filter_s, np.array([-1e9]), np.array([1e9]))
        sent.append(command)
        acting = sent.pop(0)
        for part in range(parts):
            air = step(response, air, acting, tick_s / parts)
            late.append(tick * tick_s + (part + 0.5) * tick_s / parts - air.pressure_pa[0] / slope)
        model = follow(model, command, tick_s, found.lag_s)
    return float(np.mean(late[-parts * 40 :]))


@pytest.mark.parametrize("ticks", [0, 1])
@pytest.mark.parametrize(
    ("lag_s", "delay_s", "rate_hz"),
    [
        (0.052, 0.005, 200.0),
        (0.052, 0.005, 100.0),
        (0.2, 0.03, 100.0),
        (0.008, 0.005, 200.0),
        (0.0, 0.0, 50.0),
    ],
)
def test_the_preview_is_the_time_from_a_wish_to_its_pressure(lag_s, delay_s, rate_hz, ticks):
    exact = {"hysteresis_pa": 0.0, "command_resolution_pa": 0.0, "minimum_pa": -100e3, "maximum_pa": 1e8}
    response = RegulatorModel(tau_s=lag_s, delay_s=delay_s, **exact)
    found = complete_pressures(AllocationConfig(), Limits(), response, rate_hz, ticks / rate_hz)
    late_s = time_from_wish_to_pressure(found, response, rate_hz, ticks)
    assert found.preview_s == pytest.approx(late_s, abs=3e-4)
    assert complete_pressures(AllocationConfig(preview_s=0.0), Limits(), SLOW, rate_hz).preview_s == 0.0


def test_a_file_with_values_of_its_own_is_followed_up_to_the_limits_and_says_where_it_differs():
    own = AllocationConfig(maximum_pa=40e3, rise_pa_s=50e3, fall_pa_s=300e3, lag_s=0.1, preview_s=0.05)
    found = complete_pressures(own, NARROW, SLOW)
    assert values(found, (*FROM_LIMITS, "lag_s", "preview_s")) == [-5e3, 40e3, 50e3, 150e3, 0.1, 0.05]
    assert contradictions(own, NARROW, SLOW) == [
        "pressures.fall_pa_s 300000 is beyond the limits: 150000 is used",
        "pressures.lag_s 0.1 is used, but the platform's regulators have 0.2 (tau_s)",
    ]
    assert contradictions(AllocationConfig(), NARROW, SLOW) == []
    assert complete_pressures(AllocationConfig(maximum_pa=150e3)).maximum_pa == 150e3, (
        "without limits there is nothing beyond"
    )


def test_pressures_that_the_limits_leave_none_of_are_refused():
    with refused("", names=("minimum_pa", "maximum_pa")):
        complete_pressures(AllocationConfig(minimum_pa=70e3), NARROW)


# Of a scene, and of the node ---------------------------------------------------------------------------


def platform(folder, **changes):
    file = folder / "slow.yaml"
    regulator = {"tau_s": 0.2, "delay_s": 0.03, **changes}
    file.write_text(
        "family: canopen_408\ntransport: {kind: slcan}\nvalves: [{chamber: link0/chamber0, node: 1}]\n"
        f"range: {{maximum_pa: 50e3}}\ncycle_hz: 200.0\nregulator: {regulator}\n"
    )
    return str(file)


def test_a_scene_states_limits_and_lag_once(tmp_path):
    limits = {"limits.rise_pa_s": 100e3, "limits.fall_pa_s": 150e3}
    on_valves = load_scene("track_circle", {**limits, "platform": platform(tmp_path)})
    pressures, lines = on_valves.controller_node().known_pressures()
    assert values(pressures, FROM_LIMITS) == [0.0, 50e3, 100e3, 150e3], "the platform's range as well"
    assert (pressures.lag_s, pressures.preview_s) == (0.2, pytest.approx(0.05525))
    assert lines == []
    alone = load_scene("track_circle", {**limits, "platform": "", "twin.regulator": {"tau_s": 0.08}})
    pressures, lines = alone.controller_node().known_pressures()
    assert values(pressures, FROM_LIMITS) == [0.0, 90e3, 100e3, 150e3]
    assert (pressures.lag_s, lines) == (0.08, [])


@pytest.mark.parametrize(
    ("platform", "late_s"), [("itv_serial", 27 / 960), ("veab_tcp", 0.0), ("vtem_modbus", 0.0)]
)
def test_on_a_slow_line_the_preview_has_an_update_more(platform, late_s):
    """As the limiter's monitors: a set point waits for its turn."""
    pressures, _ = load_scene("track_circle", {"platform": platform}).controller_node().known_pressures()
    assert pressures.preview_s == pytest.approx(0.005 + 0.005 + (0.052 + 0.0025) / 2.6 + late_s)


def test_a_file_of_before_is_valid_and_says_what_its_scene_says_otherwise(tmp_path):
    copies = {
        "controller.pressures": {"minimum_pa": 0.0, "maximum_pa": 90e3, "rise_pa_s": 200e3, "lag_s": 0.052}
    }
    pressures, lines = load_scene("track_circle", copies).controller_node().known_pressures()
    assert (pressures.lag_s, lines) == (0.052, [])
    changed = load_scene(
        "track_circle", {**copies, "limits.rise_pa_s": 100e3, "platform": platform(tmp_path)}
    )
    pressures, lines = changed.controller_node().known_pressures()
    assert (pressures.rise_pa_s, pressures.maximum_pa) == (100e3, 50e3)
    assert lines == [
        "pressures.maximum_pa 90000 is beyond the limits: 50000 is used",
        "pressures.rise_pa_s 200000 is beyond the limits: 100000 is used",
        "pressures.lag_s 0.052 is used, but the platform's regulators have 0.2 (tau_s)",
    ]


def test_a_controller_that_is_started_alone_takes_them_from_platform_and_limits(tmp_path):
    given = {"platform": platform(tmp_path), "limits": {"rise_pa_s": 100e3}, "rate_hz": 100.0}
    pressures, _ = parse(given, ControllerNodeConfig, "parameters of controller").known_pressures()
    assert values(pressures, FROM_LIMITS) == [0.0, 50e3, 100e3, 400e3]
    assert pressures.preview_s == pytest.approx(0.0605)
    usual, _ = ControllerNodeConfig().known_pressures()
    assert values(usual, (*FROM_LIMITS, "lag_s")) == [0.0, 90e3, 200e3, 400e3, 0.052]


@pytest.mark.parametrize("name", ["tue_three_bellow", "wrist_muscle", "antagonistic_joint", "two_links"])
def test_bending_has_the_greater_weight_whatever_strains_an_arm_has(name):
    robot = load_scene("two_links").loaded_robot if name == "two_links" else load_robot(name)
    weight = Controller(
        robot, ControllerConfig(reference=ReferenceConfig(kind="hold"))
    ).setpoints.force_weight
    bends = ["bending" in coordinate for coordinate in robot.coordinate_names]
    np.testing.assert_array_equal(weight, np.where(bends, 1.0, 0.3))
