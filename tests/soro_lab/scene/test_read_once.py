"""A process reads each file that a scene names once, and each node finds its section in one file."""

from collections import Counter
from pathlib import Path
from unittest.mock import Mock

import pytest
import typer
import yaml

from soro_core.robot import Discretisation
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of
from soro_lab.scene.model import ModelSection
from soro_lab.trade.closed_loop import drive
from soro_ros.commands import run as command
from soro_ros.run import compose, loop_nodes, processes
from tests.counted import counted


@pytest.fixture
def reads(monkeypatch):
    """How often each file is read, by name."""
    counts: Counter[str] = Counter()
    read_text = Path.read_text

    def counted(path, *args, **kwargs):
        counts[path.name] += 1
        return read_text(path, *args, **kwargs)

    monkeypatch.setattr(Path, "read_text", counted)
    return counts


def test_a_run_reads_scene_robot_and_platform_once(reads, tmp_path, monkeypatch):
    monkeypatch.setattr(command, "execute", lambda *_: command.End(0, ""))
    with pytest.raises(typer.Exit) as ended:
        command.run("track_circle", [], None, None, None, tmp_path, False)
    assert ended.value.exit_code == 0
    names = ("track_circle.yaml", "tue_three_bellow.yaml", "emulated_canopen.yaml")
    assert [reads[name] for name in names] == [1, 1, 1]


def test_a_run_checks_its_controller_once_for_all_nodes(tmp_path, monkeypatch):
    def execute(scene, *_):
        loop_nodes.control_loop(scene)
        return command.End(0, "")

    monkeypatch.setattr(command, "execute", execute)
    with counted() as found, pytest.raises(typer.Exit):
        command.run("track_circle", [], None, None, None, tmp_path, False)
    assert found.checks == 1
    named = ["track_circle.yaml", "emulated_canopen.yaml", "cia408.yaml", "tue_three_bellow.yaml"]
    assert found.files == named


def test_a_loop_in_one_process_does_not_check_again():
    with counted() as found:
        loop_of(load_scene("track_circle"))
    assert found.checks == 1
    assert len(found.files) == 4


def test_the_loop_and_another_model_use_what_is_read(reads):
    scene = load_scene("track_circle").with_keys(model=ModelSection(links=1))
    for _ in range(2):
        drive(scene, Discretisation(), 0.01)
    assert reads["tue_three_bellow.yaml"] == reads["emulated_canopen.yaml"] == 1


def test_each_node_gets_its_section_as_one_file(tmp_path, monkeypatch):
    started = {}
    log = tmp_path / "log"
    log.write_text("ready: somewhere")

    def start(name, line, *_, **__):
        started[name] = line
        return processes.Child(name, Mock(**{"poll.return_value": None}), log)

    monkeypatch.setattr(processes, "start", start)
    monkeypatch.setattr(processes, "stop", lambda *_: (0, False))
    run = compose.Run(load_scene("track_circle", {"mode": "lockstep"}), tmp_path, print)
    run.start(Mock())
    run.end()
    assert set(started) == {"valves", "recorder", "twin", "estimator", "controller", "regulator"}
    del started["valves"]  # no node
    for name, line in started.items():
        assert line.count("--params-file") == 1
        file = Path(line[line.index("--params-file") + 1])
        assert (file.stem, file.parent) == (name, tmp_path / "parameters")
        (section,) = yaml.safe_load(file.read_text()).values()
        assert set(section) == {"ros__parameters"}
