"""The log of trips, resets and changed parameters: what is in it, its bounds, and a disk that refuses."""

from __future__ import annotations

import os
import stat
import threading
import time

import pytest
import rclpy
from rclpy.parameter import Parameter

from soro_ros.host import event_log, middleware
from soro_ros.host.event_log import EventLog
from soro_ros.nodes.player import Player
from soro_ros.nodes.twin import TwinNode
from tests.refused import refused_keys
from tests.soro_ros.direct import request


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "soro" / "log"


def test_an_event_is_one_line_of_this_user_alone(folder):
    log = EventLog("/left", "regulator", pytest.fail)
    log.note("vented", "leak:\tlink0/chamber1\nopen the dump valve")
    log.note("reset refused", "not empty")
    for _ in range(3):
        log.note("reset refused", "not empty")  # a button that is held
    log.note("reset")
    log.note("parameter", "name: \udc80")  # bytes of a file name that are no UTF-8
    log.close()
    found = [(one.arm, one.node, one.event, one.text) for one in event_log.entries()]
    assert found == [
        ("/left", "regulator", "vented", "leak: link0/chamber1 open the dump valve"),
        ("/left", "regulator", "reset refused", "not empty"),
        ("/left", "regulator", "reset", "[left out before: 3 repeated]"),
        ("/left", "regulator", "parameter", r"name: \udc80"),
    ]
    assert all(one.time.endswith("Z") for one in event_log.entries())
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert {stat.S_IMODE(file.stat().st_mode) for file in folder.iterdir()} == {0o600}


def test_the_log_is_bounded_whoever_writes_and_keeps_the_newest(folder, monkeypatch):
    monkeypatch.setattr(event_log, "LARGEST", 20_000)
    logs = [EventLog("/", f"node{k}", pytest.fail) for k in range(3)]

    def write(log):
        for k in range(300):
            log.note("parameter", f"{k} {'x' * 50}")

    writers = [threading.Thread(target=write, args=[log]) for log in logs]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    for log in logs:
        log.close()
    sizes = {file.name: file.stat().st_size for file in folder.iterdir()}
    assert sizes.keys() == {"arms.log", "arms.1.log", "lock"}
    assert max(sizes.values()) <= 20_000
    found = list(event_log.entries())
    assert len(found) > 200
    for log in ("node0", "node1", "node2"):
        numbers = [int(one.text.split()[0]) for one in found if one.node == log]
        assert numbers == list(range(300 - len(numbers), 300))  # of one that was early nothing may be left


@pytest.mark.parametrize(
    "obstacle", ["a file in the place of the folder", "a link in the place of the file", "a full disk"]
)
def test_a_log_that_cannot_be_written_is_one_warning(folder, monkeypatch, obstacle):
    folder.parent.mkdir(parents=True)
    if obstacle == "a full disk":
        monkeypatch.setattr(event_log.os, "write", lambda *of: 3)
    elif "folder" in obstacle:
        folder.write_text("")
    else:
        folder.mkdir(mode=0o700)
        (folder / "arms.log").symlink_to(folder / "elsewhere")
    warnings: list[str] = []
    log = EventLog("/", "regulator", warnings.append)
    log.note("vented", "leak")
    log.note("reset")
    log.close()
    (line,) = warnings
    assert str(folder) in line


def test_repeats_up_to_the_end_of_a_node_are_counted(folder):
    log = EventLog("/", "regulator", pytest.fail)
    for _ in range(4):
        log.note("vented", "leak")
    log.close()
    log.note("vented", "leak")  # of the next life of the node
    log.close()
    found = [(one.event, one.text) for one in event_log.entries()]
    assert found == [("vented", "leak"), ("end", "[left out before: 3 repeated]"), ("vented", "leak")]


def test_events_that_a_full_disk_refuses_are_counted(folder, monkeypatch):
    write, is_full = os.write, [True, True, False]
    monkeypatch.setattr(event_log.os, "write", lambda *of: 3 if is_full.pop(0) else write(*of))
    log = EventLog("/", "regulator", [].append)
    for k in range(3):
        log.note("parameter", str(k))
    log.close()
    assert [one.text for one in event_log.entries()] == ["2 [left out before: 2 refused by the disk]"]


def test_events_that_a_slow_disk_loses_are_counted(folder, monkeypatch):
    append, goes_on, started = event_log._append, threading.Event(), threading.Event()

    def slow(line):
        started.set()
        assert goes_on.wait(60)
        append(line)

    monkeypatch.setattr(event_log, "_append", slow)
    monkeypatch.setattr(event_log, "_WAITING", 4)
    log = EventLog("/", "regulator", pytest.fail)
    log.note("parameter", "first")
    assert started.wait(60)
    for k in range(10):
        log.note("parameter", str(k))  # four wait
    goes_on.set()
    deadline = time.monotonic() + 60
    while log._waiting.qsize():
        assert time.monotonic() < deadline
        time.sleep(0.001)
    log.note("parameter", "9")  # the last one that was lost, again
    log.close()
    found = [one.text for one in event_log.entries()]
    assert found == ["first", "0", "1", "2", "3", "9 [left out before: 6 lost because the disk was slow]"]


def test_a_disk_that_stands_still_holds_up_nobody(folder, monkeypatch):
    still, monkeypatched = threading.Event(), []
    monkeypatch.setattr(event_log, "_append", lambda line: monkeypatched.append(line) or still.wait(60))
    monkeypatch.setattr(event_log, "_CLOSE_S", 0.1)
    log = EventLog("/", "regulator", pytest.fail)
    for k in range(3000):
        log.note("parameter", str(k))
    log.close()
    assert len(monkeypatched) == 1
    still.set()
    log._waiting.put(None, timeout=60)  # its thread must not write into the folder of another test
    for thread in threading.enumerate():
        if thread.name == "event log":
            thread.join(60)


@pytest.fixture
def twin(domain):
    middleware.init(["--ros-args", "-r", "__ns:=/left"])
    node = TwinNode()
    try:
        yield node
    finally:
        node.make_safe()
        node.destroy_node()
        rclpy.try_shutdown()


def test_a_node_logs_its_trips_resets_and_changed_parameters(twin):
    twin.set_parameters([Parameter("payload_kg", value=0.02)])
    twin.trigger_configure()
    twin.set_parameters(
        [Parameter("limits.maximum_pa", value=5e4), Parameter("limits.minimum_pa", value=0.0)]
    )
    twin.set_parameters([Parameter("payload_kg", value=0.03)])  # refused: of the next configuration
    request(twin, "~/vent")
    request(twin, "~/reset")
    twin.destroy_node()
    # Other tests of this process may have left lines of other arms.
    found = [(one.event, one.text) for one in event_log.entries() if (one.arm, one.node) == ("/left", "twin")]
    assert found[0] == ("parameter", "payload_kg: 0.0 -> 0.02")
    assert found[1] == ("parameter", "limits.maximum_pa: 90000.0 -> 50000.0")
    assert found[2] == ("vented", "vent requested (twin of tue_three_bellow)")
    assert [event for event, _ in found[3:]] in (["reset"], ["reset refused"])


def test_what_looks_on_logs_nothing(domain):
    middleware.init()
    node = Player()
    node.set_parameters([Parameter("rate", value=2.0)])
    node.destroy_node()
    rclpy.try_shutdown()
    assert list(event_log.entries()) == []


def test_soro_log_prints_the_lines_of_an_arm_the_newest_last(soro, folder):
    assert soro("log", "left").status == 2
    for arm in ("/left", "/right", "/left"):
        log = EventLog(arm, "regulator", pytest.fail)
        log.note("vented", f"leak of {arm}")
        log.close()
    assert soro("log", "left").out.count("leak of /left") == 2
    assert soro("log", "/right").out.splitlines()[0].endswith("regulator  vented  leak of /right")
    ended = soro("log", "middle")
    assert (ended.status, refused_keys(ended.err)) == (2, ["ARM"])
    assert "/left, /right" in ended.err
