"""Each test of studies runs in a folder of its own, with a short scene and what varies."""

import pytest

from tests.soro_ros.study.short_study import write


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path)
    return tmp_path
