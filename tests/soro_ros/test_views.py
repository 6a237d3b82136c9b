"""The shipped views of RViz and PlotJuggler: every topic and field in them is one that the nodes publish."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soro_core.robot import load_robot
from soro_lab.bag import BagReader
from soro_lab.scene import MarkersConfig
from soro_ros.conversion.fields import flat
from soro_ros.conversion.interfaces import message_class
from soro_ros.pictures.plotjuggler import layout
from soro_ros.view.markers import TOPIC, ArmMarkers
from tests.soro_ros.test_markers import TYPE, drawn, recorded

ROOT = Path(__file__).parents[2]
BAG = ROOT / "bags" / "track_circle_lockstep_2s"
RVIZ = yaml.safe_load((ROOT / "config/rviz/soro.rviz").read_text())["Visualization Manager"]
LAYOUT = ROOT / "config/plotjuggler/track_circle.xml"
# Types of the messages that displays of RViz take.
TAKES = {
    "rviz_default_plugins/MarkerArray": "visualization_msgs/msg/MarkerArray",
    "rviz_default_plugins/Pose": "geometry_msgs/msg/PoseStamped",
    "rviz_default_plugins/PoseArray": "geometry_msgs/msg/PoseArray",
    "rviz_default_plugins/PoseWithCovariance": "geometry_msgs/msg/PoseWithCovarianceStamped",
}


@pytest.fixture(scope="module")
def published():
    """Types of the topics of a run, without its namespace."""
    with BagReader(BAG) as reader:
        found = {topic.name.removeprefix("/track_circle/"): topic.type for topic in reader.topics}
    return found | {TOPIC: TYPE}


@pytest.mark.parametrize("display", RVIZ["Displays"], ids=lambda display: display["Name"])
def test_a_display_takes_what_its_topic_has(display, published):
    if display["Class"] == "rviz_default_plugins/Grid":
        return
    assert published[display["Topic"]["Value"]] == TAKES[display["Class"]]
    assert display["Topic"]["Durability Policy"] == "Volatile"  # fits every publisher


def test_rviz_shows_the_namespaces_and_the_frame_of_the_markers():
    markers = ArmMarkers(load_robot("tue_three_bellow"), MarkersConfig())
    for topic, message in recorded(markers.inputs):
        markers.inputs[topic].take(message)
    markers._vented = "vented"
    found = drawn(markers).values()
    (display,) = [one for one in RVIZ["Displays"] if one["Class"].endswith("/MarkerArray")]
    assert {name for name, shown in display["Namespaces"].items() if shown} == {m.ns for m in found}
    assert {m.header.frame_id for m in found} == {RVIZ["Global Options"]["Fixed Frame"]}


def series():
    """Names that PlotJuggler gives the numbers of the recorded run."""
    found = set()
    with BagReader(BAG) as reader:
        for item in reader.messages():
            kind = message_class(item.type)
            message = deserialize_message(item.data, kind)
            if isinstance(message, JointState):
                for field in ("position", "velocity", "effort"):
                    if len(getattr(message, field)) == len(message.name):
                        found |= {f"{item.topic}/{name}/{field}" for name in message.name}
            elif isinstance(message, DiagnosticArray):
                for status in message.status:
                    begin = f"{item.topic}/{status.hardware_id}" if status.hardware_id else item.topic
                    found |= {f"{begin}/{status.name}/{pair.key}" for pair in status.values}
            else:
                found |= {f"{item.topic}/{path.replace('.', '/')}" for path in flat(message)}
    return found


def test_every_curve_is_a_series_of_the_run():
    root = ElementTree.parse(LAYOUT).getroot()
    made = {snippet.get("name") for snippet in root.iter("snippet")}
    curves = [curve.get("name") for curve in root.iter("curve")]
    sources = [element.text for element in root.iter() if element.tag == "linked_source"]
    sources += [element.text for group in root.iter("additional_sources") for element in group]
    known = series()
    assert {*curves, *sources} <= known | made
    assert made <= set(curves)
    text = " ".join(curves)
    for part in ("chambers/command", "chambers/state", "arm/tip", "tip error", "arm/state", "/diagnostics"):
        assert part in text
    for splitter in root.iter("DockSplitter"):
        assert len(splitter) == int(splitter.get("count")) == len(splitter.get("sizes").split(";"))


def test_the_shipped_layout_is_the_one_of_the_shipped_bag():
    assert LAYOUT.read_text() == layout(BAG, "track_circle")
