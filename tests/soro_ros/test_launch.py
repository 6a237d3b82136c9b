"""The launch file and the shipped parameter files, without starting processes."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
import yaml
from lifecycle_msgs.msg import Transition

from soro_ros.host import middleware
from soro_ros.nodes import arm
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.nodes.regulator import RegulatorNode
from soro_ros.nodes.twin import TwinNode
from soro_ros.process import parameters
from soro_ros.process.arm_nodes import parameters_of
from tests.soro_ros import launch_api as api

ROOT = Path(__file__).parents[2]
FILE = ROOT / "soro_ros/launch/arm.launch.py"
SHIPPED = ROOT / "params/arm.yaml"
NODES = {node.node_name: node for node in (TwinNode, EstimatorNode, ControllerNode, RegulatorNode)}
CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE


class Launched:
    """What the launch file starts, and the transitions that it has asked for."""

    def __init__(self, **arguments):
        description = api.load(FILE).generate_launch_description()
        *declared, arm = description.entities
        self.arguments = {one.name for one in declared}
        given = {one.name: one.default_value for one in declared} | arguments
        self.nodes, self.asked, self.handlers, self.others, self.ended = {}, [], [], [], []
        self.visit(arm.function(SimpleNamespace(launch_configurations=given)))

    def visit(self, actions):
        for action in actions or ():
            if isinstance(action, api.LifecycleNode):
                self.nodes[action.name] = action
            elif isinstance(action, api.RegisterEventHandler):
                self.handlers.append(action.event_handler)
            elif isinstance(action, api.EmitEvent):
                (name,) = (n for n, node in self.nodes.items() if action.event.lifecycle_node_matcher(node))
                self.asked.append((name, action.event.transition_id))
            elif isinstance(action, api.Shutdown):
                self.ended.append(action.reason)
            else:
                self.others.append(action)

    def reaches(self, name, start, goal):
        for one in [h for h in self.handlers if isinstance(h, api.OnStateTransition)]:
            if (one.target_lifecycle_node.name, one.start_state, one.goal_state) == (name, start, goal):
                self.visit(one.entities)

    def prints(self, text):
        for one in [h for h in self.handlers if isinstance(h, api.OnProcessIO)]:
            self.visit(one.on_stdout(SimpleNamespace(text=text)))


def test_emulated_valves_come_first_and_their_driver_last():
    arm = Launched()
    assert arm.arguments == {"robot", "platform", "device", "namespace", "params", "composed", "use_rviz"}
    (valves,) = arm.others
    assert valves.cmd[:2] == [api.ExecutableInPackage("emulate", "soro_ros"), "emulated_canopen"]
    arm.prints(b"soro emulate: no real-time priority\n")
    assert not arm.nodes
    arm.prints(b"ready: /dev/pts/1\n")
    arm.prints(b"ready: /dev/pts/1\n")
    assert list(arm.nodes) == ["twin", "estimator", "controller", "regulator"]
    assert arm.asked == [("twin", CONFIGURE), ("estimator", CONFIGURE), ("controller", CONFIGURE)]
    arm.reaches("controller", "configuring", "inactive")
    arm.reaches("controller", "activating", "active")
    arm.reaches("regulator", "configuring", "inactive")
    assert arm.asked[3:] == [("controller", ACTIVATE), ("regulator", CONFIGURE), ("regulator", ACTIVATE)]
    arm.reaches("controller", "deactivating", "inactive")
    assert len(arm.asked) == 6
    assert not arm.ended
    arm.reaches("estimator", "configuring", "unconfigured")
    arm.reaches("regulator", "activating", "inactive")
    assert len(arm.ended) == 2


def test_the_links_of_emulated_valves_are_those_of_driver_and_twin():
    arm = Launched()
    command = arm.others[0].cmd
    arm.prints(b"ready: x")
    given = {name: node.parameters[1] for name, node in arm.nodes.items()}
    assert given["regulator"]["device"].value == command[command.index("--device-link") + 1]
    assert given["twin"]["plant_link"].value == command[command.index("--plant-link") + 1]


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        ({"platform": ""}, ["twin", "estimator", "controller"]),
        ({"device": "/dev/ttyACM0"}, ["estimator", "controller", "regulator"]),
    ],
)
def test_without_emulated_valves_the_nodes_start_at_once(arguments, names):
    arm = Launched(**arguments, namespace="left", use_rviz="true")
    assert list(arm.nodes) == names
    assert {node.namespace for node in arm.nodes.values()} == {"left"}
    markers, rviz = arm.others
    assert (markers.executable, rviz.package) == ("markers", "rviz2")
    assert markers.namespace == rviz.namespace == "left"
    assert markers.parameters[1]["robot"].value == "tue_three_bellow"
    assert ROOT.joinpath(*rviz.arguments[1].substitutions[1:]).is_file()


@pytest.mark.parametrize("platform", ["emulated_canopen", ""])
def test_a_composed_arm_is_one_process_whose_nodes_have_their_parameters(domain, platform):
    launched = Launched(composed="true", platform=platform, namespace="left", params=str(SHIPPED))
    launched.prints(b"ready: x")
    one = launched.others[-1]
    assert (one.executable, one.namespace, bool(launched.nodes)) == ("arm", "left", False)
    assert one.on_exit is not None
    classes, rest = arm.chosen(one.arguments)
    assert (sorted(node.node_name for node in classes), rest) == (sorted(one.arguments), [])
    files = [word for file in one.parameters for word in ("--params-file", str(file))]
    middleware.init(["--ros-args", *files, "-r", "__ns:=/left"])
    try:
        configs = {node.node_name: parameters.read(node(), node.config_model) for node in classes}
    finally:
        rclpy.shutdown()
    assert all(config.end_on_failed_start for config in configs.values())
    assert configs["controller"].platform == platform
    assert configs["controller"].control.law == "composite"
    assert configs["twin"].payload_kg == 0.02
    assert bool(configs["twin"].plant_link) is bool(platform)
    assert ("regulator" in configs) is bool(platform)


@pytest.mark.parametrize("file", sorted((ROOT / "params").glob("*.yaml")), ids=lambda file: file.stem)
@pytest.mark.parametrize("device", ["", "/dev/ttyACM0"])
@pytest.mark.parametrize("platform", ["emulated_canopen", ""])
def test_every_node_takes_the_shipped_files_and_the_arguments(domain, tmp_path, file, platform, device):
    sections = parameters_of("tue_three_bellow", platform, device, tmp_path)
    shipped = {key.rpartition("/")[2] for key in yaml.safe_load(file.read_text())}
    assert shipped <= NODES.keys()
    for name, given in sections.items():
        own = tmp_path / f"{name}.yaml"  # as launch_ros writes it
        own.write_text(yaml.safe_dump({"/**": {"ros__parameters": {**given, "autostart": False}}}))
        middleware.init(["--ros-args", "--params-file", str(file), "--params-file", str(own)])
        try:
            node = NODES[name]()
            config = parameters.overrides(parameters.read(node, node.config_model))
        finally:
            rclpy.shutdown()
        assert given.items() <= config.items()
        if name == "controller":
            assert config["control.law"] == "composite"


def test_the_launch_file_suits_an_installed_launch():
    pytest.importorskip("launch_ros", reason="launch_ros comes with a conventional ROS 2 installation")
    from launch import LaunchContext
    from launch.launch_description_sources import get_launch_description_from_python_launch_file

    description = get_launch_description_from_python_launch_file(str(FILE))
    context = LaunchContext()
    for name in ("robot", "platform", "device", "namespace", "params"):
        context.launch_configurations[name] = ""
    context.launch_configurations["use_rviz"] = "true"
    for composed in ("false", "true"):
        context.launch_configurations["composed"] = composed
        assert description.entities[-1].execute(context)
