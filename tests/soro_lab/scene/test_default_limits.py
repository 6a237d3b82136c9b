"""Limits that a scene does not state are those of its robot, within what platform and valves allow."""

from __future__ import annotations

import re

import numpy as np
import pytest
import yaml

from soro_core.config import find_config
from soro_core.control import Controller, ControllerConfig
from soro_core.control.config import AllocationConfig
from soro_core.errors import ConfigError
from soro_core.safety import Limiter
from soro_lab.scene import check_scene, load_scene
from tests.refused import fails


def scene(folder, robot, platform=None, valves=(-100e3, 90e3), **keys):
    """A scene of a robot of a range [Pa], and of a platform and its emulated valves with theirs."""
    text = find_config("tue_three_bellow", "robots").read_text()
    text, count = re.subn(
        r"pressure_range_pa: .*", f"pressure_range_pa: [{robot[0]:.1f}, {robot[1]:.1f}]", text
    )
    assert count == 1
    (folder / "arm.yaml").write_text(text)
    lines = ["robot: arm.yaml"]
    if platform is not None:
        text = find_config("emulated_canopen", "platforms").read_text()
        wanted = f"{{minimum_pa: {platform[0]:.1f}, maximum_pa: {platform[1]:.1f}}}"
        text, count = re.subn(r"range: \{.*\}", f"range: {wanted}", text)
        text = text.replace("minimum_pa: 0.0\n", f"minimum_pa: {valves[0]:.1f}\n")
        text = text.replace("maximum_pa: 90e3\n", f"maximum_pa: {valves[1]:.1f}\n")
        assert count == 1
        (folder / "valves.yaml").write_text(text)
        lines.append("platform: valves.yaml")
    (folder / "scene.yaml").write_text("\n".join(lines) + "\n")
    return load_scene(folder / "scene.yaml", keys)


@pytest.mark.parametrize(
    ("robot", "platform", "valves", "limits"),
    [
        ((-40e3, 90e3), (-60e3, 90e3), (-100e3, 90e3), (-40e3, 90e3)),
        ((-40e3, 90e3), (-20e3, 90e3), (-100e3, 90e3), (-20e3, 90e3)),
        ((-40e3, 90e3), (-60e3, 90e3), (-10e3, 90e3), (-10e3, 90e3)),
        ((-40e3, 90e3), (0.0, 90e3), (-100e3, 90e3), (0.0, 90e3)),
        ((0.0, 60e3), (-60e3, 90e3), (-100e3, 90e3), (0.0, 60e3)),
        ((0.0, 110e3), (0.0, 95e3), (0.0, 200e3), (0.0, 90e3)),
        ((10e3, 60e3), (0.0, 90e3), (0.0, 90e3), (0.0, 60e3)),
        ((0.0, 110e3), (0.0, 50e3), (0.0, 90e3), (0.0, 50e3)),
        # Without a platform the robot's range alone; on one a higher limit is stated with its trips.
        ((-40e3, 90e3), None, None, (-40e3, 90e3)),
        ((0.0, 200e3), None, None, (0.0, 200e3)),
        ((0.0, 110e3), None, None, (0.0, 110e3)),
        ((10e3, 40e3), None, None, (0.0, 40e3)),
        ((-101e3, 2e6), None, None, (-100e3, 900e3)),
    ],
)
def test_the_range_of_the_robot_counts_within_that_of_the_platform(tmp_path, robot, platform, valves, limits):
    found = scene(tmp_path, robot, platform, valves).limits
    assert (found.minimum_pa, found.maximum_pa) == limits


def test_a_twin_that_can_draw_takes_the_vacuum_of_the_robot(tmp_path):
    found = scene(tmp_path, (-40e3, 90e3), **{"twin.regulator": {"minimum_pa": -30e3}})
    assert found.limits.minimum_pa == -30e3


def test_the_trips_of_a_range_above_the_default_lie_above_it(tmp_path):
    """In the proportions of the default; those of a lower range stay, and so does what is stated."""
    loaded = scene(tmp_path, (0.0, 180e3), **{"limits.monitors": {"leak_s": 2.0}})
    found = loaded.limits
    trips = found.over_pressure_pa, found.burst_pressure_pa, found.monitors.short_circuit_pa
    assert trips == pytest.approx((200e3, 220e3, 300e3))
    assert (found.monitors.model_pa, found.monitors.leak_s) == (16e3, 2.0)
    assert (loaded.regulator.minimum_pa, loaded.regulator.maximum_pa) == (0.0, 180e3)
    assert loaded.twin_node().regulator == loaded.controller_node().regulator == loaded.regulator
    assert scene(tmp_path, (0.0, 40e3)).limits.over_pressure_pa == 100e3
    held = scene(tmp_path, (0.0, 180e3), **{"limits.burst_pressure_pa": 120e3})
    assert (held.limits.maximum_pa, held.limits.burst_pressure_pa) == (90e3, 120e3)
    assert "limits.maximum_pa is 90 kPa, but robot and valves allow 180 kPa" in check_scene(held, "scene")[-1]


def test_the_range_of_the_robot_is_the_bound_of_a_limiter_without_a_platform(tmp_path):
    """No set point beyond it is sent, and a pressure beyond its trips vents."""
    limits = scene(tmp_path, (0.0, 180e3)).limits
    limiter = Limiter(limits, ("a",))
    assert "out of range" in str(limiter.offer(np.array([181e3]), 0, 0))
    assert limiter.offer(np.array([179e3]), 0, 0) is None
    limiter.slew(0)
    assert limiter.slew(10**7)[0] <= 0.01 * limits.rise_pa_s
    limiter.judge(np.array([225e3]), True, 10**7)
    assert "over-pressure" in str(limiter.cause)
    # Limits beyond the range, as of a scene or of the parameters of the twin.
    wide = {"maximum_pa": 250e3, "over_pressure_pa": 260e3, "burst_pressure_pa": 270e3}
    wide["monitors"] = {"short_circuit_pa": 300e3}
    with fails(ConfigError, key="limits.maximum_pa"):
        scene(tmp_path, (0.0, 180e3), limits=wide)


def test_a_scene_that_a_run_leaves_has_the_same_range(tmp_path):
    for number, keys in enumerate(({}, {"twin.regulator": {"tau_s": 0.1}})):
        loaded = scene(tmp_path, (0.0, 180e3), **keys)
        used = tmp_path / f"used{number}.yaml"
        used.write_text(yaml.safe_dump(loaded.to_dict() | {"robot": str(tmp_path / "arm.yaml")}))
        again = load_scene(used)
        assert (again.limits, again.regulator) == (loaded.limits, loaded.regulator)


def test_a_controller_without_limits_has_the_range_of_its_robot(tmp_path):
    robot = scene(tmp_path, (-20e3, 180e3)).loaded_robot
    controller = Controller(robot)
    assert (controller.minimum_pa[0], controller.maximum_pa[0]) == (-20e3, 180e3)
    stated = Controller(robot, ControllerConfig(pressures=AllocationConfig(maximum_pa=50e3)))
    assert stated.maximum_pa[0] == 50e3


def test_what_a_scene_states_stays(tmp_path):
    stated = {"limits.minimum_pa": -5e3, "limits.maximum_pa": 20e3}
    found = scene(tmp_path, (-40e3, 90e3), (-60e3, 90e3), **stated).limits
    assert (found.minimum_pa, found.maximum_pa) == (-5e3, 20e3)
    assert found.rise_pa_s == 200e3


def test_a_range_that_another_part_does_not_allow_is_named(tmp_path):
    found = scene(tmp_path, (-40e3, 90e3), (0.0, 90e3), (0.0, 90e3))
    assert check_scene(found, "scene") == [
        "pressure_range_pa of arm is -40 to 90 kPa, but range of valves (0 to 90 kPa) and "
        "regulator of valves (0 to 90 kPa) allow less"
    ]
    assert check_scene(scene(tmp_path, (0.0, 90e3), (0.0, 90e3), (0.0, 90e3)), "scene") == []
    alone = check_scene(scene(tmp_path, (-40e3, 90e3), **{"twin.regulator": {"minimum_pa": 0.0}}), "scene")
    assert len(alone) == 1
    assert alone[0].endswith("but twin.regulator (0 to 90 kPa) allows less")
    assert check_scene(scene(tmp_path, (0.0, 180e3)), "scene") == []
    (held,) = check_scene(scene(tmp_path, (0.0, 180e3), (0.0, 95e3), (0.0, 180e3)), "scene")[1:]
    assert "limits.maximum_pa is 90 kPa, but robot and valves allow 95 kPa" in held
    wide = scene(tmp_path, (-40e3, 90e3), (-40e3, 90e3), **{"limits.minimum_pa": -60e3})
    assert check_scene(wide, "scene") == [
        "limits are -60 to 90 kPa, but range of valves (-40 to 90 kPa) allows less"
    ]


def test_ranges_that_do_not_meet_are_refused(tmp_path):
    allowed = "overlaps range of valves (0 to 50 kPa) and regulator of valves"
    with fails(ConfigError, "60 to 90 kPa", allowed, where=str(tmp_path / "scene.yaml"), key="robot"):
        scene(tmp_path, (60e3, 90e3), (0.0, 50e3))


def test_no_limit_passes_the_rating(tmp_path):
    """The robot and the platform's range may be wide; the rating of the platform holds."""
    with fails(ConfigError, "rating"):
        scene(tmp_path, (-200e3, 90e3), (-101e3, 90e3))
    assert scene(tmp_path, (-100e3, 200e3), (-100e3, 99e3), (-101e3, 200e3)).limits.maximum_pa == 90e3
