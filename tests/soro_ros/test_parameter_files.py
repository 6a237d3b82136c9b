"""What a scene states reaches each node through its parameter file as it is, empty lists and nothing too."""

import pytest
import rclpy
from pydantic import BaseModel

from soro_core.errors import ConfigError
from soro_lab.scene import load_scene
from soro_ros.host import middleware
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.nodes.player import Player
from soro_ros.nodes.recorder import Recorder
from soro_ros.nodes.regulator import RegulatorNode
from soro_ros.nodes.shadow import ShadowNode
from soro_ros.nodes.twin import TwinNode
from soro_ros.process import command_line, parameters
from soro_ros.process.parameter_files import given_by_name
from soro_ros.run import processes
from soro_ros.ticks.controller_ticks import ControllerTicks
from soro_ros.topics.ports import NodeOutputs
from tests.counted import counted
from tests.refused import fails

NODES = (RegulatorNode, EstimatorNode, ControllerNode, TwinNode, ShadowNode, Recorder, Player)


def through_a_file(node_class, config, folder):
    """The configuration that a node reads where `config` was written."""
    arguments = processes.node_command(node_class.node_name, config, "scene", folder)
    middleware.init(arguments[arguments.index("--ros-args") :])
    try:
        node = node_class()
        found = parameters.read(node, node_class.config_model)
        node.destroy_node()
    finally:
        rclpy.shutdown()
    return found


def emptied(config):
    """The same with every list empty and None wherever it is allowed; not checked again."""
    changes = {}
    for name, field in type(config).model_fields.items():
        value = getattr(config, name)
        if isinstance(value, BaseModel):
            changes[name] = emptied(value)
        elif isinstance(value, tuple):
            changes[name] = ()
        elif "None" in str(field.annotation):
            changes[name] = None
    return config.model_copy(update=changes)


@pytest.mark.parametrize("node_class", NODES, ids=lambda node_class: node_class.node_name)
def test_every_empty_list_arrives_empty(domain, tmp_path, monkeypatch, node_class):
    monkeypatch.setattr(parameters, "parse", lambda values, *_, **__: values)  # some may not be empty
    config = emptied(node_class.config_model())
    found = through_a_file(node_class, config, tmp_path)
    assert found == parameters.nested(parameters.overrides(config))


def test_a_scene_that_adapts_nothing_has_a_controller_that_adapts_nothing(domain, tmp_path):
    none = {f"controller.adaptation.{key}": [] for key in ("parameters", "gain", "lower", "upper")}
    config = load_scene("track_circle", {"controller.law": "adaptive", **none}).controller_node()
    found = through_a_file(ControllerNode, config, tmp_path)
    assert found == config
    assert found.control.adaptation.parameters == ()


def test_keys_of_a_law_arrive_as_they_are(domain, tmp_path):
    keys = {"forget_s": 3.0, "noise": 0.2}
    config = load_scene("track_circle", {"controller.law_options": keys}).controller_node()
    found = through_a_file(ControllerNode, config, tmp_path)
    assert found == config
    assert found.control.law_options == keys


def test_a_controller_node_checks_its_section_once(domain, tmp_path):
    config = load_scene("track_circle").controller_node()
    line = processes.node_command("controller", config, "scene", tmp_path)
    with counted() as found:
        command_line.initialise(
            command_line.of_node(ControllerNode.node_name, ControllerNode.config_model),
            line[line.index("--ros-args") :],
        )
        try:
            node = ControllerNode()
            read = parameters.read(node, ControllerNode.config_model)
            ControllerTicks(read, "/scene/controller", NodeOutputs(print))
            node.destroy_node()
        finally:
            rclpy.shutdown()
    assert found.checks == 1
    assert found.files == ["controller.yaml", "tue_three_bellow.yaml", "emulated_canopen.yaml", "cia408.yaml"]


@pytest.mark.parametrize(
    ("node_class", "former"), [(EstimatorNode, "imu_location"), (TwinNode, "pose.location")]
)
def test_a_place_under_its_former_name_is_read_as_a_list(domain, node_class, former):
    middleware.init(["--ros-args", "-p", f"{former}:=0.5"])
    try:
        node = node_class()
        found = parameters.overrides(parameters.read(node, node_class.config_model))
        node.destroy_node()
    finally:
        rclpy.shutdown()
    assert found[f"{former}s"] == [0.5]


def test_a_place_under_both_names_is_refused(domain):
    middleware.init(["--ros-args", "-p", "pose_location:=0.5", "-p", "pose_locations:=[0.5]"])
    try:
        with fails(ConfigError, key="pose_location"):
            EstimatorNode()
    finally:
        rclpy.shutdown()


SHARED = "/**: {ros__parameters: {robot: six_link, rate_hz: 100.0, camera: {exposure: 3}}}\n"


def made_with(node_class, folder, text):
    """The configuration of a node that is started with a parameter file."""
    file = folder / "given.yaml"
    file.write_text(text)
    middleware.init(["--ros-args", "--params-file", str(file)])
    try:
        return parameters.read(node_class(), node_class.config_model)
    finally:
        rclpy.shutdown()


@pytest.mark.parametrize("node_class", NODES, ids=lambda node_class: node_class.node_name)
def test_an_entry_for_all_nodes_stops_none_that_lacks_a_key(domain, tmp_path, capfd, node_class):
    found = parameters.overrides(made_with(node_class, tmp_path, SHARED))
    assert found.get("robot", "six_link") == "six_link"
    assert found.get("rate_hz", 100.0) == 100.0
    assert "camera.exposure" in capfd.readouterr().err


@pytest.mark.parametrize("entry", ["regulator", "/regulator", "/**/regulator"])
def test_an_entry_of_the_own_name_with_a_wrong_key_is_refused(domain, tmp_path, entry):
    with fails(ConfigError, key="robot"):
        made_with(RegulatorNode, tmp_path, f"{SHARED}{entry}: {{ros__parameters: {{robot: six_link}}}}\n")


def test_what_is_given_by_name_is_found_in_every_form(tmp_path):
    file = tmp_path / "given.yaml"
    file.write_text(
        "/**: {ros__parameters: {a: 1}}\n"
        "left: {arm: {ros__parameters: {b: {c: 1}}}, '*': {ros__parameters: {d: 1}}}\n"
        "/left/arm: {ros__parameters: {e: 1}}\nother: {ros__parameters: {f: 1}}\n"
    )
    given = ["-p", "g:=1", "--param", "arm:h.i:=2", "--params-file", str(file), "-r", "__ns:=/left"]
    assert given_by_name(given, "arm") == {"b.c", "e", "g", "h.i"}
