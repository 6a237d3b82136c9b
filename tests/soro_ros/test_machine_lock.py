"""The locks of the test runs: whatever somebody else has put in their place."""

import os
import tempfile

import pytest

from tests.machine_lock import machine_lock


@pytest.fixture(autouse=True)
def shared(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_one_at_a_time():
    first = machine_lock("x", waits=False)
    assert first is not None
    assert machine_lock("x", waits=False) is None
    first.close()
    again = machine_lock("x", waits=False)
    assert again is not None
    again.close()


def test_a_link_is_not_followed_and_what_it_names_stays(shared):
    (shared / "precious").write_text("kept")
    (shared / "soro-test-x.lock").symlink_to(shared / "precious")
    assert machine_lock("x", waits=True) is None
    assert (shared / "precious").read_text() == "kept"


def test_a_file_of_another_is_locked_as_it_is(shared):
    file = shared / "soro-test-x.lock"
    file.write_text("theirs")
    file.chmod(0o444)
    with machine_lock("x", waits=False):
        assert machine_lock("x", waits=False) is None
    assert file.read_text() == "theirs"


@pytest.mark.parametrize("make", [os.mkdir, os.mkfifo])
def test_what_is_no_file_holds_nothing_up(shared, make):
    make(shared / "soro-test-x.lock")
    assert machine_lock("x", waits=True) is None
