"""A scene of several arms: each has the keys of the scene where it states none of its own."""

import numpy as np
import pytest
import yaml

from soro_core.errors import ConfigError
from soro_core.robot import load_robot, save_robot
from soro_hardware import load_platform
from soro_lab.scene import check_scene, load_scene, require_one_arm, with_robot_files
from soro_ros.run.loop_nodes import control_loop

TWO = {
    "mode": "lockstep",
    "seed": 5,
    "controller": {"adapt": False, "reference": {"kind": "circle", "curvature_per_m": 6.0}},
    "arms": {
        "left": {"base_position": [-0.1, 0.0, 0.0], "controller": {"reference": {"period_s": 3.0}}},
        "right": {
            "base_quaternion": [1.0, 0.0, 0.0, 0.0],
            "twin": {"payload_kg": 0.01},
            "controller": {"reference": {"kind": "hold"}},
        },
    },
}
FINGERS = "emulated_three_fingers"


@pytest.fixture
def scene_of(tmp_path):
    """Write a scene and read it."""

    def scene(keys, changes=None):
        file = tmp_path / "hand.yaml"
        file.write_text(yaml.safe_dump(keys))
        return load_scene(file, changes)

    return scene


@pytest.fixture
def platform_of(tmp_path):
    """Write the platform of the fingers with other valves."""

    def platform(change):
        keys = yaml.safe_load((load_file(FINGERS)).read_text())
        change(keys["valves"])
        file = tmp_path / "valves.yaml"
        file.write_text(yaml.safe_dump(keys))
        return str(file)

    return platform


def load_file(name):
    from soro_core.config import find_config

    return find_config(name, "platforms")


def test_an_arm_has_the_keys_of_the_scene_and_its_own(scene_of):
    scene = scene_of(TWO, {"controller.law": "adaptive", "arms.right.twin.payload_kg": 0.02})
    left, right = scene.each
    assert (left.name, left.prefix, right.name) == ("hand/left", "left/", "hand/right")
    assert left.controller.reference.curvature_per_m == 6.0
    assert left.controller.reference.period_s == 3.0
    assert right.controller.reference.kind == "hold"  # a reference of another kind has its own keys alone
    assert [arm.controller.law for arm in scene.each] == ["adaptive"] * 2
    assert [arm.twin.payload_kg for arm in scene.each] == [0.0, 0.02]
    assert [arm.seed for arm in scene.each] == [5, 6]
    assert left.loaded_robot.base_position == (-0.1, 0.0, 0.0)
    assert right.loaded_robot.base_quaternion == (1.0, 0.0, 0.0, 0.0)
    assert check_scene(scene, "hand.yaml") == []


def test_one_arm_is_a_scene_of_itself():
    scene = load_scene("no_devices")
    assert scene.each == (scene,)
    assert (scene.prefix, scene.place, scene.platforms) == ("", {}, ())
    assert require_one_arm(scene, "") is scene


def test_the_keys_in_use_describe_the_same_arms(scene_of, tmp_path):
    scene = scene_of(TWO)
    used = tmp_path / "scene_used.yaml"
    used.write_text(yaml.safe_dump(scene.to_dict(), sort_keys=False))
    assert load_scene(used).each == scene.each


def test_files_of_an_arm_stand_beside_the_scene(scene_of, tmp_path):
    save_robot(load_robot("tue_three_bellow").replace(tip_mass=0.003), tmp_path / "mine.yaml")
    scene = scene_of({"mode": "lockstep", "arms": {"left": {"robot": "mine.yaml"}, "right": None}})
    assert [arm.loaded_robot.tip_mass for arm in scene.each] == [0.003, 0.0]


def test_arms_on_one_platform_have_its_limits_and_their_valves():
    scene = load_scene("three_fingers", {"limits.maximum_pa": 60e3})
    assert [one.name for one in scene.platforms] == ["three_fingers"]
    assert {arm.limits.maximum_pa for arm in (scene, *scene.each)} == {60e3}
    assert [arm.twin_node("a", "b").plant_chambers for arm in scene.each] == [(0, 1, 2), (3, 4, 5), (6, 7, 8)]
    assert check_scene(scene, "three_fingers") == []


def test_each_arm_may_have_valves_of_its_own(scene_of):
    scene = scene_of(TWO | {"platform": "emulated_canopen"})
    assert [one.name for one in scene.platforms] == ["hand/left", "hand/right"]
    assert [arm.twin_node("a", "b").plant_chambers for arm in scene.each] == [(), ()]
    check_scene(scene, "hand.yaml")


def test_valves_in_another_order_than_the_chambers_feed_the_right_ones(platform_of):
    def turned(valves):
        valves[:] = [{**valve, "chamber": valve["chamber"].partition("/")[2]} for valve in valves[2::-1]]

    scene = load_scene("track_circle", {"platform": platform_of(turned)})
    check_scene(scene, "track_circle")
    assert scene.twin_node("a", "b").plant_chambers == (2, 1, 0)


STILL = {"adapt": False, "gains": {"k_p": [0.0] * 3, "k_d": [0.0] * 3}, "reference": {"kind": "hold"}}
CARRIED = {
    "mode": "lockstep",
    "robot": "tue_three_bellow",
    "arms": {
        "upper": {"base_quaternion": [1.0, 0.0, 0.0, 0.0]},
        "lower": {"mounted_on": "upper", "base_position": [0.01, 0.0, 0.0]},
    },
}


def test_what_a_carried_arm_calls_the_world_is_the_tip_of_its_carrier(scene_of, tmp_path):
    scene = scene_of(CARRIED)  # whose file has the carrier last
    upper, lower = scene.each
    assert (scene.mounts, scene.carried_by(upper)) == ({"lower": "upper"}, [lower])
    assert lower.frames.world == "hand/upper/tip"
    assert upper.frames.world == "world"
    np.testing.assert_allclose(lower.loaded_robot.gravity, [0.0, 0.0, 9.81], atol=1e-12)  # it hangs on
    assert upper.loaded_robot.gravity == (0.0, 0.0, -9.81)
    assert [arm.twin_node().mounted_on for arm in scene.each] == ["", "upper"]
    assert check_scene(scene, "hand.yaml") == []
    used = tmp_path / "scene_used.yaml"
    used.write_text(yaml.safe_dump(scene.to_dict(), sort_keys=False))
    assert load_scene(used).each == scene.each
    assert load_scene(used).each[1].loaded_robot == lower.loaded_robot
    files = with_robot_files(scene, tmp_path).each  # what the nodes read
    assert load_robot(files[1].robot).gravity == lower.loaded_robot.gravity
    # What the scene says of its world is not that of a carried arm, what this says itself is.
    assert scene_of(CARRIED | {"frames": {"world": "lab"}}).each[1].frames.world == "hand/upper/tip"
    assert load_scene(used, {"name": "other"}).each[1].frames.world == "other/upper/tip"
    own = scene_of(CARRIED, {"arms.lower.frames": {"world": "palm"}})
    assert own.each[1].frames.world == "palm"
    used.write_text(yaml.safe_dump(own.to_dict()))
    assert load_scene(used).each == own.each


def test_a_real_arm_may_carry_a_real_one(scene_of):
    real = {"valves": "real", "arm": "real", "mode": "real_time", "platform": FINGERS}
    assert scene_of(CARRIED | real).each[1].frames.world == "hand/upper/tip"
    with pytest.raises(ConfigError, match="no mounted_on with real valves but arm: real"):
        scene_of(CARRIED | real | {"arm": "simulated"})


def test_the_fingers_of_a_hand_on_an_arm_are_the_carried_arms():
    scene = load_scene("hand_on_an_arm")
    nodes = control_loop(scene).nodes
    assert nodes["hand"].fingers == ("thumb", "index", "middle")
    assert (nodes["hand"].carrier, nodes["hand"].carrier_robot) == ("upper", "asu_two_segment")
    assert [nodes[f"{arm.prefix}controller"].hand for arm in scene.each] == [False, True, True, True]
    assert scene.arms["upper"].controller.adapt
    assert control_loop(load_scene("grasp_ball")).nodes["hand"].carrier == ""


def arms(**keys):
    return TWO | {"arms": TWO["arms"] | keys}


WRONG = {
    "no mapping": (TWO | {"arms": ["left"]}, "arms: got"),
    "no name": (arms(**{"Left-1": {}}), "arms: got 'Left-1'; allowed: names of"),
    "no keys": (arms(left=3), "arms.left: got 3; allowed: a mapping"),
    "key of the run": (arms(left={"duration_s": 3}), "arms.left.duration_s: got 3; allowed: at the top"),
    "arms in an arm": (arms(left={"arms": {"a": {}}}), "arms.left.arms: got"),
    "unknown key": (arms(left={"twin": {"payload_g": 3}}), "arms.left: twin.payload_g: got"),
    "no robot": (arms(left={"robot": "nobody"}), "nobody"),
    "no place": (arms(left={"base_position": [0.0, 0.0]}), "arms.left: base_position"),
    "no rotation": (arms(left={"base_quaternion": [0.0, 0.0, 0.0, 0.0]}), "arms.left: base_quaternion"),
    "a carrier that is not there": (
        arms(right={"mounted_on": "nobody"}),
        "arms.right.mounted_on: got 'nobody'; allowed: an arm that no other one carries, before it: left",
    ),
    "a carrier that is carried": (
        arms(left={"mounted_on": "right"}, right={"mounted_on": "left"}),
        "arms.left.mounted_on: got 'right'; allowed: an arm that no other one carries, before it: there is",
    ),
    "a carrier of one arm": ({"mounted_on": "left"}, "mounted_on: got 'left'; allowed: an arm of a scene of"),
    "a finger elsewhere": (
        {"hand": {}, "controller": STILL, "arms": CARRIED["arms"] | {"a": {"mounted_on": "upper"}, "b": {}}},
        "arms.b: mounted_on: got 'nothing'; allowed: upper, which carries the other fingers of the hand",
    ),
    "contacts of a carried arm": (
        CARRIED
        | {"arms": CARRIED["arms"] | {"lower": {"mounted_on": "upper", "robot": "three_bellow_at_a_wall"}}},
        "arms.lower: robot: got 'contacts or tip_constraint'; allowed: none of them in the file of an arm",
    ),
    "an arm on itself": (arms(right={"mounted_on": "right"}), "arms.right.mounted_on: got 'right'"),
    "limits of one": (
        {
            "platform": FINGERS,
            "arms": {"thumb": {"limits": {"maximum_pa": 5e4}}, "index": {}, "middle": {}},
        },
        "arms.thumb.limits: got",
    ),
    "an arm that is not there": (
        {"platform": FINGERS, "arms": {"thumb": {}, "index": {}}},
        "9 valves: middle/link0/chamber0, which the group index, thumb does not have",
    ),
    "an arm without a channel": (
        {"platform": FINGERS, "arms": {"thumb": {}, "index": {}, "middle": {}, "ring": {}}},
        "9 valves: no ring/link0/chamber0",
    ),
    "shared valves of another one": (
        {"arms": {"thumb": {"platform": FINGERS}, "index": {}}},
        "arms.thumb: platform: got 'emulated_three_fingers'; allowed: that of the scene, none",
    ),
    "shared air": (
        {"platform": FINGERS, "twin": {"air": "states"}, "arms": {"thumb": {}, "index": {}, "middle": {}}},
        "arms.index: twin.air: got 'states'; allowed: lag",
    ),
    "one device twice": (
        {
            "platform": "emulated_canopen",
            "valves": "real",
            "device": "/dev/ttyACM0",
            "arms": {"left": {}, "right": {}},
        },
        "arms.right: device: got '/dev/ttyACM0'",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_arm_is_refused_in_one_line(scene_of, name):
    keys, expected = WRONG[name]
    with pytest.raises(ConfigError) as caught:
        check_scene(scene_of(keys), "hand.yaml")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_arms_on_one_channel_are_refused(platform_of):
    def twice(valves):
        valves[3] |= {"node": 1, "channel": 0}

    with pytest.raises(ConfigError, match="once"):
        load_platform(platform_of(twice))


def test_a_platform_names_an_arm_before_each_chamber_or_none(platform_of):
    def half(valves):
        valves[0]["chamber"] = "link0/chamber0"

    with pytest.raises(ConfigError, match="the name of an arm in front of each chamber, or of none"):
        load_platform(platform_of(half))


def test_a_platform_of_several_arms_drives_no_single_one():
    with pytest.raises(ConfigError, match=r"9 valves: thumb/link0/chamber0, which robot .* does not have"):
        check_scene(load_scene("track_circle", {"platform": FINGERS}), "track_circle")


def test_what_knows_one_arm_refuses_several():
    with pytest.raises(ConfigError, match="arms: got 'thumb, index, middle'; allowed: a scene of one arm"):
        require_one_arm(load_scene("three_fingers"), "three_fingers")
