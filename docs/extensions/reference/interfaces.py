"""Print topics, types, quality of service and services of every node, each configured as by its defaults.

A process of its own: the regulator drives emulated valves, and the player has a recording.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

PLATFORM = "emulated_canopen"
ROOT = Path(__file__).parents[3]
BAG = ROOT / "bags" / "track_circle_lockstep_2s"
# Parameters without which a node does not configure.
GIVEN = {
    "regulator": ("platform:={platform}", "device:={device}"),
    "exciter": ("platform:={platform}", "pose_rate_hz:=100.0"),
    "recorder": ("folder:={folder}/bag",),
    "player": ("bag:={bag}",),
}
FOLDER = ROOT / "soro_ros" / "nodes"
# What every node of ROS has.
_OF_ROS = ("/rosout", "/parameter_events", "/diagnostics", "/clock")


def node_classes() -> dict[str, Any]:
    """Return the class of each node by its name; a module that only puts nodes together has none."""
    from soro_ros.process.lifecycle import SoroNode

    found = {}
    for path in sorted(FOLDER.glob("[!_]*.py")):
        module = import_module(f"soro_ros.nodes.{path.stem}")
        for one in vars(module).values():
            if isinstance(one, type) and issubclass(one, SoroNode) and one.__module__ == module.__name__:
                found[path.stem] = one
    return found


def interfaces(name: str, node_class: Any, arguments: list[str]) -> dict[str, list[list[str]]]:
    """Return what a node has once it is configured.

    Parameters
    ----------
    name : str
    node_class : type
    arguments : list of str
        Its parameters, ``key:=value``.
    """
    import rclpy

    from soro_ros.host import middleware

    sys.argv = [
        name,
        *(["--ros-args"] if arguments else []),
        *(word for one in arguments for word in ("-p", one)),
    ]
    middleware.init(sys.argv)
    node = node_class()
    common = {one.srv_name for one in node.services}
    if name not in ("exciter", "hand"):  # what these make as they compile is needed; others only warm up
        node.compile = lambda warm_up: None
    node.trigger_configure()
    if node.failure is not None:
        raise SystemExit(str(node.failure))
    found = {
        "publishes": [_topic(one) for one in node.publishers if one.topic_name not in _OF_ROS],
        "subscribes to": [_topic(one) for one in node.subscriptions if one.topic_name not in _OF_ROS],
        "serves": [
            [one.srv_name, _type(one.srv_type)] for one in node.services if one.srv_name not in common
        ],
    }
    node.make_safe()
    node.destroy_node()
    rclpy.try_shutdown()
    return found


def _topic(one: Any) -> list[str]:
    kind, quality = one.msg_type, one.qos_profile
    words = (quality.reliability.name, quality.durability.name)
    return [one.topic_name, _type(kind), f"{', '.join(words).lower().replace('_', ' ')}, {quality.depth}"]


def _type(kind: type) -> str:
    package, group, *_ = kind.__module__.split(".")
    return f"{package}/{group}/{kind.__name__}"


def main() -> None:
    """Start emulated valves, configure the nodes one after the other, print."""
    with tempfile.TemporaryDirectory() as folder:
        device = f"{folder}/valves"
        command = [sys.executable, "-m", "soro_ros.cli", "emulate", PLATFORM, "--device-link", device]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as valves:
            try:
                assert valves.stdout is not None
                valves.stdout.readline()  # ready
                places = {"platform": PLATFORM, "device": device, "folder": folder, "bag": BAG}
                found = {
                    name: interfaces(name, one, [given.format(**places) for given in GIVEN.get(name, ())])
                    for name, one in node_classes().items()
                }
            finally:
                valves.terminate()
    print(json.dumps(found), flush=True)
    os._exit(0)  # threads of a node may still serve


if __name__ == "__main__":
    main()
