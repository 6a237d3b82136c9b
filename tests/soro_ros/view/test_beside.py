"""The viewer beside a run: its process, and how its address comes to the user."""

import urllib.error
import urllib.request
from pathlib import Path

import pytest
import yaml

pytest.importorskip("viser", reason="the extra `view` is not installed")

from soro_core.errors import SoroError
from soro_lab.scene import load_scene
from soro_ros.view import beside
from tests.soro_ros.conftest import own_domain

pytestmark = pytest.mark.process


@pytest.fixture(autouse=True)
def _domain(tmp_path_factory):
    with own_domain(tmp_path_factory.mktemp("state")):
        yield


def test_the_address_comes_to_the_user_and_into_no_file_of_the_run(tmp_path):
    with beside.viewing(load_scene("track_circle"), tmp_path, []) as address:
        with urllib.request.urlopen(address) as page:
            assert b"<html" in page.read()
        parameters = yaml.safe_load((tmp_path / "parameters/viewer.yaml").read_text())["/**"]
        told = Path(parameters["ros__parameters"]["address_file"])
        assert [path.stat().st_mode & 0o777 for path in (told, told.parent)] == [0o600, 0o700]
        token = address.partition("=")[2]
        for file in tmp_path.rglob("*.*"):
            assert token not in file.read_text(), file
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(address)


def test_a_viewer_that_does_not_start_says_why(tmp_path, monkeypatch):
    command = ["/bin/sh", "-c", "echo no such robot; exit 2"]
    monkeypatch.setattr(beside.processes, "node_command", lambda *_: command)
    with (
        pytest.raises(SoroError, match="viewer ended with status 2: no such robot"),
        beside.viewing(load_scene("track_circle"), tmp_path, []),
    ):
        pass
