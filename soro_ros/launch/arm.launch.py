"""One arm: emulated, or with real valves; `ros2 launch soro_ros arm.launch.py --show-args` explains it.

The nodes are configured and activated by lifecycle events, the driver of the valves after the controller;
those of a composed arm, in one process, start by themselves.
"""

import tempfile
from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    ExecuteProcess,
    OpaqueFunction,
    RegisterEventHandler,
    Shutdown,
)
from launch.event_handlers import OnProcessIO
from launch.events import matches_action
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import LifecycleNode, Node
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare
from lifecycle_msgs.msg import Transition

from soro_ros.process.arm_nodes import LAST, parameters_of, valves_command

PACKAGE = "soro_ros"
# The driver empties the chambers before it ends.
END_S = "10"


def generate_launch_description():
    """Return the arguments, and what starts the arm when they are known."""
    shipped = PathJoinSubstitution([FindPackageShare(PACKAGE), "params", "arm.yaml"])
    arguments = (
        ("robot", "tue_three_bellow", "robot file, or the name of a shipped one"),
        ("platform", "emulated_canopen", "platform file or name; '' for a twin in the place of valves"),
        ("device", "", "port or address of real valves; '' for emulated ones"),
        ("namespace", "", "namespace of the arm"),
        ("params", shipped, "parameter file; robot, platform and device override it"),
    )
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in arguments
    ]
    switches = [
        DeclareLaunchArgument(name, default_value="false", choices=["true", "false"], description=text)
        for name, text in (
            ("composed", "all nodes in one process"),
            ("use_rviz", "start RViz, and the node that draws the arm"),
        )
    ]
    return LaunchDescription([*declared, *switches, OpaqueFunction(function=_arm)])


def _arm(context):
    """Return the actions that start the arm."""
    given = context.launch_configurations
    robot, platform, device = given["robot"], given["platform"], given["device"]
    folder = Path(tempfile.mkdtemp(prefix="soro-"))
    parameters = parameters_of(robot, platform, device, folder)
    started = (_composed if given["composed"] == "true" else _separate)(given, parameters, folder)
    if given["use_rviz"] == "true":
        started += _pictures(robot, given)
    return _after_valves(platform, folder, started) if platform and not device else started


def _composed(given, parameters, folder):
    """Return the action that starts all nodes in one process, which ends if one of them fails."""
    file = folder / "parameters.yaml"
    sections = {
        f"/**/{name}": {"ros__parameters": {"end_on_failed_start": True, **own}}
        for name, own in parameters.items()
    }
    file.write_text(yaml.safe_dump(sections), encoding="utf-8")
    arm = Node(
        package=PACKAGE,
        executable="arm",
        namespace=given["namespace"],
        arguments=list(parameters),
        parameters=[given["params"], str(file)],
        output="screen",
        sigterm_timeout=END_S,
        on_exit=Shutdown(reason="the arm ended"),
    )
    return [arm]


def _separate(given, parameters, folder):
    """Return the actions that start each node as a process."""
    nodes = {
        name: LifecycleNode(
            name=name,
            namespace=given["namespace"],
            package=PACKAGE,
            executable=name,
            parameters=[given["params"], {"autostart": False, **_as_text(own)}],
            output="screen",
            sigterm_timeout=END_S,
            on_exit=Shutdown(reason=f"{name} ended"),
        )
        for name, own in parameters.items()
    }
    started = [action for name, node in nodes.items() for action in _start(node, configure=name != LAST)]
    if LAST in nodes:
        commands = OnStateTransition(
            target_lifecycle_node=nodes["controller"],
            start_state="activating",
            goal_state="active",
            entities=[_change(nodes[LAST], Transition.TRANSITION_CONFIGURE)],
        )
        started.insert(0, RegisterEventHandler(commands))
    return started


def _pictures(robot, given):
    """Return the actions that show the arm; the arm goes on without them."""
    shown = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "rviz", "soro.rviz"])
    # RViz in the namespace of the arm, because the topics of its configuration are relative.
    namespace, parameters = given["namespace"], [given["params"], _as_text({"robot": robot})]
    return [
        Node(package=PACKAGE, executable="markers", namespace=namespace, parameters=parameters),
        Node(package="rviz2", executable="rviz2", namespace=namespace, arguments=["-d", shown]),
    ]


def _as_text(parameters):
    """Return parameters that stay texts, whatever YAML would make of them."""
    return {name: ParameterValue(value, value_type=str) for name, value in parameters.items()}


def _start(node, configure):
    """Return the actions that start a node, and activate it once it is configured."""
    activate = OnStateTransition(
        target_lifecycle_node=node,
        start_state="configuring",
        goal_state="inactive",
        entities=[_change(node, Transition.TRANSITION_ACTIVATE)],
    )
    refused = [
        OnStateTransition(
            target_lifecycle_node=node,
            start_state=begin,
            goal_state=end,
            entities=[Shutdown(reason="a node refused its configuration or its start")],
        )
        for begin, end in (("configuring", "unconfigured"), ("activating", "inactive"))
    ]
    actions = [RegisterEventHandler(handler) for handler in (activate, *refused)]
    actions.append(node)
    return [*actions, _change(node, Transition.TRANSITION_CONFIGURE)] if configure else actions


def _change(node, transition):
    event = ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition)
    return EmitEvent(event=event)


def _after_valves(platform, folder, actions):
    """Return the actions that start emulated valves, and the others once these answer."""
    waiting = list(actions)

    def on_stdout(event):
        if b"ready:" not in event.text:
            return None
        now, waiting[:] = list(waiting), []
        return now

    valves = ExecuteProcess(
        cmd=[
            ExecutableInPackage(executable="emulate", package=PACKAGE),
            *valves_command(platform, folder),
        ],
        name="valves",
        output="screen",
        additional_env={"PYTHONUNBUFFERED": "1"},
        on_exit=Shutdown(reason="the emulated valves ended"),
    )
    return [RegisterEventHandler(OnProcessIO(target_action=valves, on_stdout=on_stdout)), valves]
