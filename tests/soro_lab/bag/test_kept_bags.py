"""The bags of the repository are whole and readable by other tools."""

from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from soro_core.config import find_config
from soro_core.robot import load_robot
from soro_lab.bag import BagReader
from soro_lab.scene import check_gains, check_model, load_scene

BAGS = Path(__file__).parents[3] / "bags"
KEPT = sorted(folder for folder in BAGS.iterdir() if folder.is_dir())


@pytest.mark.parametrize("folder", KEPT, ids=lambda folder: folder.name)
def test_a_kept_bag_is_whole_and_the_readme_says_what_made_it(folder):
    with BagReader(folder) as reader:
        assert not reader.problems
        ours = {topic.name: count for topic, count in zip(reader.topics, reader.counts, strict=True)}
        assert sum(1 for _ in reader.messages()) == sum(ours.values())
    with Reader(folder) as theirs:
        assert {name: info.msgcount for name, info in theirs.topics.items()} == ours
    assert f"`{folder.name}`" in (BAGS / "README.md").read_text()


@pytest.mark.parametrize("folder", KEPT, ids=lambda folder: folder.name)
def test_the_scene_of_a_kept_bag_can_be_run(folder):
    scene = load_scene(folder / "scene.yaml")
    robot = load_robot(find_config(scene.robot, "robots"))
    check_gains(scene, robot, "scene.yaml")
    check_model(scene, robot, "scene.yaml")
    scene.controller_node().known_pressures()


def test_the_lockstep_run_has_every_tick():
    with BagReader(BAGS / "track_circle_lockstep_2s") as reader:
        counts = {topic.name: count for topic, count in zip(reader.topics, reader.counts, strict=True)}
    # 2 s at 200 Hz, from 0 on, and until the arm is empty.
    assert counts["/track_circle/truth/tip"] == counts["/clock"] >= 401
