"""The recorded runs of bags/ through the code of today, and what `soro replay` says of a difference."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from soro_lab.bag import BagMessage, BagReader, BagWriter
from soro_lab.scene import load_scene
from soro_ros.recordings.replay import replay

BAGS = Path(__file__).parents[2] / "bags"
KEPT = sorted(folder for folder in BAGS.iterdir() if folder.is_dir())
SMALL = BAGS / "imu_and_outliers"
STATE = "/imu_and_outliers/arm/state"


@pytest.mark.parametrize("folder", KEPT, ids=lambda folder: folder.name)
def test_a_recorded_run_is_the_same_today(folder):
    found = replay(folder, load_scene(folder / "scene.yaml"))
    firsts = "\n".join(str(topic.first) for topic in found.topics if topic.first is not None)
    assert found.same, (
        f"{firsts}\nName the change in CHANGELOG.md and make the bag anew with: bags/make.sh {folder.name}"
    )
    assert min(topic.compared for topic in found.topics if "arm/tip" in topic.topic) >= 200


def rewritten(folder: Path, target: Path, change: Callable[[list[BagMessage]], list[BagMessage]]) -> Path:
    """A bag with other messages, in the order of the list, and the same scene."""
    with BagReader(folder) as reader, BagWriter(target) as writer:
        for topic in reader.topics:
            writer.add_topic(topic)
        for number, message in enumerate(change(list(reader.messages()))):
            writer.write(message.topic, message.data, number)
    (target / "scene.yaml").write_bytes((folder / "scene.yaml").read_bytes())
    return target


def test_the_order_in_which_topics_were_noted_does_not_matter(tmp_path):
    """Each answer before the reading that it answers, and each command before all that it answers."""
    folder = BAGS / "two_links"

    def turned(found: list[BagMessage]) -> list[BagMessage]:
        by_topic: dict[str, list[BagMessage]] = {}
        for message in found:
            by_topic.setdefault(message.topic, []).append(message)
        places = [(k, name) for name, of_topic in by_topic.items() for k in range(len(of_topic))]
        return [by_topic[name][k] for k, name in sorted(places)]  # "arm/learned" before "chambers/state"

    other = rewritten(folder, tmp_path / "bag", turned)
    scene = load_scene(folder / "scene.yaml")
    assert replay(other, scene).same


def test_an_input_that_was_not_recorded_is_named(soro, tmp_path):
    scene = load_scene(SMALL / "scene.yaml")
    with BagReader(SMALL) as reader, BagWriter(tmp_path / "bag") as writer:
        kept = [topic for topic in reader.topics if not topic.name.endswith("sensors/pose0")]
        for topic in kept:
            writer.add_topic(topic)
        for message in reader.messages([topic.name for topic in kept]):
            writer.write(message.topic, message.data, message.log_time_ns)
    ended = soro(
        "replay", str(tmp_path / "bag"), "--scene", str(SMALL / "scene.yaml"), "--nodes", "estimator"
    )
    assert ended.status == 1
    assert f"/{scene.name}/sensors/pose0: not recorded; a tick that waits" in ended.out
    assert "no such message now" in ended.out


def _one_value(found: list[BagMessage]) -> list[BagMessage]:
    """The state at the 100th tick is another."""
    seen, result = 0, []
    for message in found:
        if message.topic == STATE:
            seen += 1
            if seen == 100:
                state: Any = deserialize_message(message.data, JointState)
                state.velocity[1] += 0.1
                times = message.log_time_ns, message.publish_time_ns, message.sequence
                message = BagMessage(message.topic, message.type, serialize_message(state), *times)
        result.append(message)
    return result


def _one_message(found: list[BagMessage]) -> list[BagMessage]:
    states = [message for message in found if message.topic == STATE]
    return [message for message in found if message is not states[100]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_one_value, ("0.495 s", f"{STATE} velocity.link0/bending_x: recorded")),
        (_one_message, ("0.500 s", f"{STATE}: a message that was not recorded")),
    ],
)
def test_the_first_difference_is_shown(soro, tmp_path, change, words):
    bag = str(rewritten(SMALL, tmp_path / "bag", change))
    ended = soro("replay", bag, "--nodes", "estimator")
    assert ended.status == 1, ended
    (line,) = [line for line in ended.out.splitlines() if line.startswith("first difference")]
    assert all(word in line for word in words)
    assert soro("replay", bag, "--nodes", "estimator", "--ignore", "arm/state").status == 0


def test_a_changed_filter_differs_and_the_controller_beside_it_does_not():
    scene = load_scene(SMALL / "scene.yaml", {"estimator.pose.position_std_m": 0.001})
    found = {topic.topic.split("/", 2)[2]: topic for topic in replay(SMALL, scene).topics}
    assert found["arm/state"].differing > 100
    assert found["arm/state"].first.stamp_ns == found["arm/tip"].first.stamp_ns
    assert not found["chambers/command"].differing
    assert not replay(SMALL, scene, ["estimator"], ignore=["arm/*"]).topics[0].differing


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("gone",), "gone: no such file or folder"),
        ((str(SMALL), "--tolerance", "inf"), "--tolerance: got inf; allowed: a finite number"),
        ((str(SMALL), "--nodes", "twin"), "--nodes: got 'twin'; allowed: of estimator, controller"),
        ((str(SMALL), "--set", "mode=real_time"), "mode: got 'real_time'; allowed: lockstep"),
        ((str(SMALL), "--set", "name=other"), "/other/arm/covariance"),
        ((str(SMALL), "--set", "estimator.pose.std=1"), "estimator.pose.std"),
        ((str(BAGS),), "neither scene_used.yaml nor scene.yaml"),
    ],
)
def test_wrong_use_is_one_line(soro, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    ended = soro("replay", *arguments)
    assert ended.status == 2
    assert words in ended.err
    assert len(ended.err.splitlines()) == 1


def test_a_damaged_file_is_one_line(soro, tmp_path):
    (tmp_path / "bag.mcap").write_bytes(b"no bag")
    (tmp_path / "scene.yaml").write_bytes((SMALL / "scene.yaml").read_bytes())
    ended = soro("replay", str(tmp_path))
    assert ended.status == 2
    assert len(ended.err.splitlines()) == 1
