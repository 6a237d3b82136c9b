"""Definitions and hashes of installed packages against recordings and an independent implementation."""

import json
import sys
from pathlib import Path

import pytest
from bag_samples import STORE

from soro_core.errors import BagError
from soro_lab.bag import BagReader, Definition, find_definition
from tests.refused import fails

SHARE = Path(sys.prefix) / "share"
TYPES = (
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Imu",
    "std_msgs/msg/Float64MultiArray",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "geometry_msgs/msg/PoseArray",
    "visualization_msgs/msg/MarkerArray",
    "trajectory_msgs/msg/JointTrajectory",
    "diagnostic_msgs/msg/DiagnosticArray",
    "rosgraph_msgs/msg/Clock",
    "rcl_interfaces/msg/Log",
)


@pytest.fixture(scope="module")
def share() -> Path:
    if not (SHARE / "sensor_msgs" / "msg").is_dir():
        pytest.skip(f"no message packages in {SHARE}")
    return SHARE


@pytest.mark.parametrize("name", TYPES)
def test_hashes_agree_with_rosbags(share, name):
    found = find_definition(name, [share])
    assert found.encoding == "ros2msg"
    assert found.type_hash == STORE.hash_rihs01(name)


def test_texts_agree_with_a_real_recording(share, data):
    with BagReader(data / "mcap_compat" / "data" / "cub_stabilize_2025_11_13.mcap") as reader:
        for topic in reader.topics:
            assert find_definition(topic.type, [share]).text == topic.definition


def test_what_a_type_refers_to_stands_once_and_in_depth_first_order(tmp_path):
    write(
        tmp_path,
        "a_msgs/msg/Top",
        "b_msgs/Inner[] many # list\nLocal<=3 x\nstring<=10 name\nint32 K=3\nb_msgs/Inner one\n",
    )
    write(tmp_path, "a_msgs/msg/Local", "bool[2] flags\n")
    write(tmp_path, "b_msgs/msg/Inner", "a_msgs/Local again\nwstring text\n")
    text = find_definition("a_msgs/msg/Top", [tmp_path]).text
    assert [line for line in text.splitlines() if line.startswith("MSG:")] == [
        "MSG: a_msgs/Local",
        "MSG: b_msgs/Inner",
    ]
    assert text.count("=" * 80) == 2


def write(share: Path, name: str, text: str, ending: str = ".msg") -> None:
    file = share / f"{name}{ending}"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)


def test_idl_serves_where_there_is_no_msg(tmp_path):
    write(tmp_path, "a_msgs/msg/Top", '#include "b_msgs/msg/Inner.idl"\nstruct Top {};\n', ".idl")
    write(tmp_path, "b_msgs/msg/Inner", "struct Inner {};\n", ".idl")
    found = find_definition("a_msgs/msg/Top", [tmp_path])
    assert found.encoding == "ros2idl"
    assert found.text.startswith("=" * 80 + "\nIDL: a_msgs/msg/Top\n#include")
    assert "\nIDL: b_msgs/msg/Inner\nstruct Inner" in found.text


def test_the_first_folder_wins_and_what_is_missing_stays_empty(tmp_path):
    write(tmp_path / "one", "a_msgs/msg/Top", "int8 x\n")
    write(tmp_path / "two", "a_msgs/msg/Top", "int16 x\n")
    hashes = {"type_hashes": [{"type_name": "a_msgs/msg/Top", "hash_string": "RIHS01_00"}]}
    write(tmp_path / "two", "a_msgs/msg/Top", json.dumps(hashes), ".json")
    shares = [tmp_path / "one", tmp_path / "two"]
    assert find_definition("a_msgs/msg/Top", shares) == Definition("int8 x\n", "ros2msg", "RIHS01_00")
    assert find_definition("a_msgs/msg/Other", shares) == Definition("", "", "")
    write(tmp_path / "one", "a_msgs/msg/Top", "no json", ".json")
    assert find_definition("a_msgs/msg/Top", shares).type_hash == ""


@pytest.mark.parametrize("name", ["JointState", "", "a/b/c/d", "a_msgs/message/Top", "../../etc/passwd"])
def test_wrong_type_names(name, tmp_path):
    with fails(BagError, repr(name), "package/msg/Name", code="value"):
        find_definition(name, [tmp_path])
