"""A key that several parts of a run share stands once, and reaches every node from there."""

import pytest

from soro_core.estimation import EstimatorConfig
from soro_core.run_keys import SHARED, Frames
from soro_core.safety import Limits
from soro_core.twin.config import TwinConfig, TwinSection
from soro_lab.scene import Scene, check_scene, load_scene
from tests.refused import refused

DECIDED = sorted(TwinConfig.model_fields.keys() - TwinSection.model_fields.keys())


@pytest.mark.parametrize("key", DECIDED)
def test_a_scene_refuses_under_twin_what_it_decides_itself(key):
    with refused("twin", names=(f"no {key} ",)):
        Scene(twin={key: getattr(TwinConfig(), key)})


def test_the_parameters_of_the_twin_node_are_no_section_of_a_scene():
    with refused("twin", names=(f"no {DECIDED[0]} ",)):
        Scene(twin=TwinConfig())


def test_every_shared_key_reaches_every_node_that_has_it():
    stated = {
        "robot": "six_link",
        "mode": "lockstep",
        "rate_hz": 100.0,
        "seed": 7,
        "limits": Limits(maximum_pa=50e3),
        "frames": Frames(world="map", pose="optitrack"),
    }
    assert set(stated) == {name for keys in SHARED for name in keys.model_fields}
    scene = Scene(**stated, platform="emulated_canopen")
    nodes = (scene.twin_node(), scene.estimator_node(), scene.controller_node(), scene.regulator_node())
    for name, value in stated.items():
        found = [getattr(node, name) for node in nodes if name in type(node).model_fields]
        assert found
        assert all(one == value for one in found)


def test_the_scene_and_the_twin_share_no_key_beside_those():
    """They differ in meaning: 0 is no end for a twin, a scene may leave its model to be chosen, and its arms
    are those that a twin finds in its process."""
    shared = {name for keys in SHARED for name in keys.model_fields}
    assert (Scene.model_fields.keys() & TwinConfig.model_fields.keys()) - shared == {
        "duration_s",
        "model",
        "mounted_on",
    }


def test_a_path_of_the_checkout_is_answered_elsewhere_by_the_name_that_works(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with refused("", "no such file", names=("or track_circle for",)):
        load_scene("config/scenes/track_circle.yaml")
    with refused("", "no such file") as caught:
        load_scene("config/scenes/mine.yaml")
    assert "mine" not in caught.value.allowed


def test_noise_that_a_scene_states_of_its_sensors_is_that_of_the_filter():
    keys = {"twin.pose.position_noise_m": 3e-3, "twin.imu.rate_noise_rad_s": 0.1}
    found = load_scene("hanging_arm", keys).estimator_node().filter
    assert (found.pose.position_std_m, found.imu.rate_std_rad_s) == (3e-3, 0.1)
    # That of accelerations is an allowance for the motion of the arm.
    still = load_scene("hanging_arm", {"twin.imu.acceleration_noise_m_s2": 1e-3}).estimator
    assert still.imu.acceleration_std_m_s2 == EstimatorConfig().imu.acceleration_std_m_s2
    stated = load_scene("hanging_arm", keys | {"estimator.pose.position_std_m": 1e-3}).estimator
    assert (stated.pose.position_std_m, stated.imu.rate_std_rad_s) == (1e-3, 0.1)
    assert load_scene("hanging_arm", {"twin.pose.position_noise_m": 0.0}).estimator.pose.position_std_m > 0.0
    # A scene is written with the numbers that are used.
    written = load_scene("hanging_arm", keys).to_dict()
    assert written["estimator"]["pose"]["position_std_m"] == 3e-3


@pytest.mark.parametrize("keys", [{"base_by_topic": True}, {"base_shake": {"amplitude_m": [0.01, 0.0, 0.0]}}])
def test_a_base_that_moves_and_that_nobody_is_told_of_is_a_line(keys):
    lines = [check_scene(load_scene("track_circle", {"twin": one}), "scene") for one in ({}, keys)]
    assert lines == [[], ["twin: the base moves; estimator and controller believe in one at rest"]]
