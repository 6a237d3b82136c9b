"""Limits that a scene does not state are those of its robot, within what platform and valves allow."""

from __future__ import annotations

import re

import pytest

from soro_core.config import find_config
from soro_core.errors import ConfigError
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
        ((-40e3, 90e3), None, None, (0.0, 90e3)),
    ],
)
def test_the_range_of_the_robot_counts_within_that_of_the_platform(tmp_path, robot, platform, valves, limits):
    found = scene(tmp_path, robot, platform, valves).limits
    assert (found.minimum_pa, found.maximum_pa) == limits


def test_a_twin_that_can_draw_takes_the_vacuum_of_the_robot(tmp_path):
    found = scene(tmp_path, (-40e3, 90e3), **{"twin.regulator": {"minimum_pa": -30e3}})
    assert found.limits.minimum_pa == -30e3


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
    alone = check_scene(scene(tmp_path, (-40e3, 90e3)), "scene")
    assert len(alone) == 1
    assert alone[0].endswith("but twin.regulator (0 to 90 kPa) allows less")
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
