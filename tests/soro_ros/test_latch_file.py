"""The note of why devices are vented, for the driver after the one that vented them."""

import pytest

from soro_ros.host.latch_file import LatchFile


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path / "soro" / "latched"


def test_a_note_is_of_one_device_until_it_is_cleared():
    note = LatchFile("/dev/ttyUSB0")
    assert note.cause() is None
    note.write("vent requested")
    note.write("leak: link0/chamber1")
    assert LatchFile("/dev/../dev/ttyUSB0").cause() == "leak: link0/chamber1"
    assert LatchFile("192.168.4.3:8889").cause() is None
    note.clear()
    note.clear()
    assert note.cause() is None


def test_an_empty_note_counts(folder):
    note = LatchFile("can0")
    note.write("vent requested")
    (file,) = folder.iterdir()
    file.write_bytes(b"")
    assert note.cause() == "the last driver left them vented"
    file.write_bytes(b"\xff\xfe")
    assert note.cause()
    file.unlink()
    file.mkdir()
    assert "cannot be read" in note.cause()


def test_a_bare_pseudo_terminal_has_none(folder):
    note = LatchFile("/dev/pts/7")
    note.write("vent requested")
    assert note.cause() is None
    note.clear()
    assert not folder.exists()
