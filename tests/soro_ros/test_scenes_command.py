"""`soro scenes`: lists what `soro run` finds, and prints one to copy."""

import pytest
from typer.testing import CliRunner

from soro_core.config import find_config
from soro_ros.cli import application


@pytest.fixture
def soro():
    def call(*arguments):
        done = CliRunner().invoke(application(), ["scenes", *map(str, arguments)])
        assert done.exception is None, done.output
        return done.output

    return call


def test_the_shipped_scenes_are_listed_with_how_they_end(soro):
    lines = soro().splitlines()
    for name, words in (
        ("set_points", ("emulated_canopen", "15 s", "good")),
        ("valve_fails", ("6 s", "vented")),
    ):
        (line,) = [line for line in lines if f" {name} " in line]
        assert all(word in line for word in words)


def test_the_scenes_of_a_folder_are_listed_too_and_faults_named(soro, tmp_path):
    (tmp_path / "mine.yaml").write_text("description: a scene of mine\nrobot: six_link\nduration_s: 3\n")
    (tmp_path / "wrong.yaml").write_text("duration_s: -3\n")
    (tmp_path / "arm.yaml").write_text("links: []\n")
    text = soro("--folder", tmp_path)
    assert all(word in text for word in ("track_circle", "a scene of mine", "six_link", "none: the twin"))
    assert "wrong.yaml: duration_s: got -3" in text
    assert "no scenes: arm.yaml" in text


def test_a_scene_is_printed_as_it_is(soro, tmp_path):
    shipped = find_config("set_points", "scenes").read_text()
    assert soro("set_points") == shipped
    (tmp_path / "set_points.yaml").write_text("robot: six_link\n")
    assert soro("set_points", "--folder", tmp_path) == "robot: six_link\n"


def test_a_name_that_is_none_is_refused():
    done = CliRunner().invoke(application(), ["scenes", "nobody"])
    assert "nobody" in str(done.exception)
    assert "set_points" in str(done.exception)
