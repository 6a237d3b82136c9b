"""The shipped view of RViz: every topic in it is one that the nodes publish, of the type that it takes."""

from pathlib import Path

import pytest
import yaml

from soro_core.robot import load_robot
from soro_lab.bag import BagReader
from soro_lab.scene import MarkersConfig
from soro_ros.view.markers import TOPIC, ArmMarkers
from tests.soro_ros.test_markers import TYPE, drawn, recorded

ROOT = Path(__file__).parents[2]
BAG = ROOT / "bags" / "track_circle_lockstep_2s"
RVIZ = yaml.safe_load((ROOT / "config/rviz/soro.rviz").read_text())["Visualization Manager"]
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
