"""The folder of a run stands for its bag, in every command and function that takes one."""

import shutil
from pathlib import Path

import pytest

from soro_core.config import find_config
from soro_core.robot import load_robot
from soro_lab.bag import BagReader, repair
from soro_lab.identification.recording import read_bag
from soro_lab.scene import load_scene
from soro_ros.recordings.convert import to_tables
from soro_ros.recordings.recording import read
from soro_ros.recordings.replay import replay
from soro_ros.recordings.selection import fields_of
from soro_ros.view.recorded import read as moments

KEPT = Path(__file__).parents[2] / "bags/two_links"


@pytest.fixture
def run(tmp_path):
    """The folder of a run, as `soro run` leaves it."""
    folder = tmp_path / "run"
    shutil.copytree(KEPT, folder / "bag")
    (folder / "bag/scene.yaml").rename(folder / "scene_used.yaml")
    return folder


@pytest.mark.parametrize(
    "arguments",
    [
        ("bag", "info"),
        ("bag", "repair"),
        ("bag", "convert", "TARGET"),
        ("plot", "--topic", "/two_links/arm/tip"),
        ("report",),
        ("plot", "--film", "TARGET.png"),
        ("replay", "--nodes", "controller"),
        ("play", "--rate", "0", "--topic", "/clock"),
    ],
    ids=lambda arguments: " ".join(arguments[:2]),
)
def test_a_command_takes_a_run(soro, domain, run, tmp_path, arguments):
    words = arguments[:2] if arguments[0] == "bag" else arguments[:1]
    target = str(tmp_path / "target")
    more = [word.replace("TARGET", target) for word in arguments[len(words) :]]
    assert soro(*words, str(run), *more).status == 0
    (empty := tmp_path / "empty").mkdir()
    (empty / "scene.yaml").write_text((run / "scene_used.yaml").read_text())
    refused = soro(*words, str(empty), *more)
    assert refused.status == 2, refused
    assert (
        refused.err.strip()
        .splitlines()[-1]
        .endswith("not a bag: no .mcap or .db3 file in it, and no folder bag")
    )


@pytest.mark.slow
def test_a_function_takes_a_run(run, tmp_path):
    robot = load_robot(find_config("asu_two_segment", "robots"))
    tip = "/two_links/arm/tip"
    with BagReader(run) as reader:
        assert reader.path == run / "bag"
    assert not repair(run)[0].rewritten
    assert read_bag(run, robot).pressure.t.size
    assert read(run, "two_links").reading.t.size
    assert moments(run, "", None, 20.0)
    assert fields_of(run, [tip], [], print)
    assert to_tables(run, tmp_path / "tables", "csv", [tip], print)
    assert replay(run, load_scene(run / "scene_used.yaml"), ["controller"]).same
