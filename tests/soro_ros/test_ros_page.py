"""docs/ros.md is what the nodes offer: topics, services and parameters; its lines to copy are accepted."""

import contextlib
import importlib
import re
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from soro_core.robot import load_robot
from soro_hardware import load_platform
from soro_lab.bag import BagWriter, Topic
from soro_ros.conversion import messages
from soro_ros.conversion.interfaces import message_class, type_name
from soro_ros.host import middleware
from soro_ros.nodes import regulator
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.nodes.exciter import ExciterNode
from soro_ros.nodes.player import Player
from soro_ros.nodes.recorder import Recorder
from soro_ros.nodes.shadow import ShadowNode
from soro_ros.nodes.twin import TwinNode
from soro_ros.process import parameters
from soro_ros.run import faults
from tests.soro_ros.direct import captured, receive
from tests.soro_ros.test_motion_topic import controller
from tests.soro_ros.test_nodes import Answering

PAGE = (Path(__file__).parents[2] / "docs" / "ros.md").read_text(encoding="utf-8")
NODES = {
    node.node_name: node
    for node in (
        regulator.RegulatorNode,
        EstimatorNode,
        ControllerNode,
        ExciterNode,
        TwinNode,
        ShadowNode,
        Recorder,
        Player,
    )
}
# Drawn by packages that an installation may lack.
OPTIONAL = {"markers": "MarkersNode"}
for _name, _class in OPTIONAL.items():
    with contextlib.suppress(ImportError):
        NODES[_name] = getattr(importlib.import_module(f"soro_ros.nodes.{_name}"), _class)
# Of every node in ROS, and of the bag that is played.
NOT_OURS = ("rosout", "parameter_events", "transition_event", "numbers")
ABSOLUTE = ("/diagnostics", "/clock", "/tf", "/tf_static")


def section(heading: str) -> str:
    """Text of a section, without those below it."""
    return re.split(r"\n#+ ", PAGE.partition(f"\n## {heading}\n")[2])[0]


def items(heading: str) -> list[dict[str, str]]:
    """Lines of the list of a section: - `NAME`, ... ([TYPE; ]NODE, ...): TEXT."""
    joined = re.sub(r"\n  +", " ", section(heading))
    lines = [line for line in joined.splitlines() if line.startswith("- ")]
    found = [re.fullmatch(r"- (`[^(]*`) \((?:(\S+); )?([^)]*)\)(?:: (.*))?", line) for line in lines]
    assert all(found), [line for line, one in zip(lines, found, strict=True) if not one]
    return [dict(zip(("name", "type", "by", "text"), one.groups(""), strict=True)) for one in found if one]


def named(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def of_node(row: dict[str, str], name: str) -> bool:
    return row["by"] == "all" or name in row["by"].split(", ")


def stated_quality(cell: str) -> str:
    """Quality of service at the end of a line; the page names that of all others."""
    found = re.search(r"(?:^|; )((?:reliable|best effort|latched) \d+)$", cell)
    return found[1] if found else "reliable 100"


def topics(heading: str, name: str, lockstep: bool) -> set[tuple[str, ...]]:
    """Topic, type and quality of service that the page states for a node."""
    return {
        (*named(row["name"]), row["type"], stated_quality(row["text"]))
        for row in items(heading)
        if of_node(row, name)
        and (lockstep or "in lockstep alone" not in str(row))
        and message_class(row["type"]) is not None  # tf2_msgs is not among the wheels
    }


def relative(topic: str) -> str:
    """The name as the page has it: with a slash in front only where no namespace counts."""
    return topic if topic in ABSOLUTE else topic.removeprefix("/")


def quality(profile: QoSProfile) -> str:
    assert profile.history is HistoryPolicy.KEEP_LAST
    if profile.durability is DurabilityPolicy.TRANSIENT_LOCAL:
        assert profile.reliability is ReliabilityPolicy.RELIABLE
        return f"latched {profile.depth}"
    reliable = profile.reliability is ReliabilityPolicy.RELIABLE
    return f"{'reliable' if reliable else 'best effort'} {profile.depth}"


@pytest.fixture
def offered(domain, tmp_path, monkeypatch):
    """Configure a node with its defaults and shut it down; returns what it published, took and served,
    and how much it takes and serves after its end.
    """
    monkeypatch.setattr(regulator, "open_regulator", lambda *_, **__: Answering())
    monkeypatch.setattr(faults, "ControlClient", lambda path: None)
    stopped = {**load_platform("emulated_canopen").model_dump(mode="json"), "stop_topic": "safety/stop"}
    platform = tmp_path / "platform.yaml"
    platform.write_text(yaml.safe_dump(stopped))
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(Topic("/numbers", "std_msgs/msg/UInt64"))
        writer.write("/numbers", bytes(12), 1)

    def offer(name: str, mode: str) -> tuple[set[Any], set[Any], set[str], int]:
        needed = {
            "regulator": ["device:=x", f"platform:={platform}"],
            "player": [f"bag:={tmp_path / 'bag'}"],
            "exciter": ["pose_rate_hz:=100.0"],
            "twin": ["base_by_topic:=true"],
        }
        own = needed.get(name, []) + ([f"mode:={mode}"] if mode != "real_time" else [])
        middleware.init(["--ros-args", *(part for one in own for part in ("-p", one))])
        try:
            node = NODES[name]()
            node.trigger_configure()
            assert node.failure is None
            if name == "twin":
                faults.FaultInterface(node, "")

            def found(items: Any) -> set[tuple[str, str, str]]:
                return {
                    (topic, type_name(one.msg_type), quality(one.qos_profile))
                    for one in items
                    if not (topic := relative(one.topic_name)).endswith(NOT_OURS)
                }

            def served() -> set[str]:
                triggers = (one for one in node.services if one.srv_type is Trigger)
                return {one.srv_name.replace(f"/{name}/", "~/") for one in triggers}

            offers = found(node.publishers), found(node.subscriptions), served()
            node.trigger_shutdown()
            result = *offers, len(found(node.subscriptions) | served())
            node.destroy_node()
        finally:
            rclpy.shutdown()
        return result

    return offer


@pytest.mark.parametrize("name", NODES)
def test_topics_and_services_are_those_of_the_nodes_until_their_end(offered, name):
    published, taken, services, left = offered(name, "real_time")
    assert published == topics("Published", name, lockstep=False)
    assert taken == topics("Taken", name, lockstep=False)
    stated = [one for row in items("Services") if of_node(row, name) for one in named(row["name"])]
    assert services == set(stated)
    assert left == 0


def test_every_row_is_of_nodes_that_are_checked():
    known = {"all", *NODES, *OPTIONAL}
    headings = ("Published", "Taken", "Services", "Parameters")
    rows = [row for heading in headings for row in items(heading)]
    assert len(rows) > 60
    assert {name for row in rows for name in row["by"].split(", ")} <= known


@pytest.mark.parametrize("name", ["twin", "regulator"])
def test_in_lockstep_the_topics_of_the_loop_are_latched_and_there_is_a_clock(offered, name):
    published, taken, _, _ = offered(name, "lockstep")
    clock = ("/clock", "rosgraph_msgs/msg/Clock", "latched 1000")
    assert clock in topics("Published" if name == "twin" else "Taken", name, lockstep=True)
    assert clock in (published if name == "twin" else taken)
    assert ("chambers/state", "sensor_msgs/msg/JointState", "latched 1000") in published
    assert ("chambers/command", "sensor_msgs/msg/JointState", "latched 1000") in taken


# Lines to copy ---------------------------------------------------------------------------------------
def filled(message: Any, values: dict[str, Any]) -> Any:
    """Set the fields of a message as `ros2 topic pub` does."""
    kinds = message.get_fields_and_field_types()
    for name, value in values.items():
        present = getattr(message, name)
        if value == "auto" and kinds[name] == "std_msgs/Header":
            present.stamp = messages.to_time(10**9)
        elif isinstance(value, dict):
            filled(present, value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            kind = re.fullmatch(r"sequence<(\w+)/(\w+)>", kinds[name])
            made = message_class(f"{kind[1]}/msg/{kind[2]}")
            setattr(message, name, [filled(made(), one) for one in value])
        else:
            setattr(message, name, value if isinstance(value, list) else type(present)(value))
    return message


def to_publish() -> dict[str, Any]:
    """Messages of the page by topic."""
    found = {}
    for topic, kind, text in re.findall(r'^ros2 topic pub [-\w ]*?/(\S+) (\S+) "(.*)"$', PAGE, re.MULTILINE):
        assert (topic, kind) in {(named(row["name"])[0], row["type"]) for row in items("Taken")}
        found[topic] = filled(message_class(kind)(), yaml.safe_load(text))
    assert len(found) == PAGE.count("ros2 topic pub")
    return found


def test_references_of_the_page_are_accepted(domain):
    references = {topic: one for topic, one in to_publish().items() if topic.startswith("arm/reference/")}
    assert len(references) == 3
    for topic, message in references.items():
        with controller() as it:
            answers = captured(it.node, "arm/motion")
            receive(it.node, topic, message)
            assert [one.name for one in answers][:1] in (["moving"], ["planning"]), answers[0].message


def test_set_points_of_the_page_are_those_of_the_arm():
    found, names = to_publish(), load_robot("tue_three_bellow").chamber_names
    given = messages.pressures(found["chambers/command"], names)
    assert found["chambers/commands"].data.tolist() == given.tolist()


def test_services_and_parameters_of_the_page_exist():
    calls = re.findall(r"^ros2 service call /(\w+)/(\w+) std_srvs/srv/Trigger$", PAGE, re.MULTILINE)
    assert len(calls) == PAGE.count("\nros2 service call")
    for node, service in calls:
        rows = [row for row in items("Services") if of_node(row, node)]
        assert any(f"~/{service}" in named(row["name"]) for row in rows), (node, service)
    for node, name, _ in re.findall(r"^ros2 param set /(\w+) (\S+) (\S+)$", PAGE, re.MULTILINE):
        assert name in {one for one, _, _ in parameters.described(NODES[node].config_model)}
    for row in items("Parameters"):
        (name,), (default, *_) = named(row["name"]), named(row["text"])
        for node in row["by"].split(", "):
            known = {one: value for one, value, _ in parameters.described(NODES[node].config_model)}
            assert known[name] == yaml.safe_load(default), (node, name)
