"""A player that is paused, moved and changed: by services, by parameters, by keys."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import termios
import threading
import time
from pathlib import Path

import pytest
import rclpy
from rclpy.parameter import Parameter

from soro_lab.bag import BagWriter, Topic
from soro_ros.nodes.player import Player
from soro_ros.recorder.playback import Playback
from soro_ros.recorder.player_controls import keys
from tests.patience import LIMIT_S
from tests.soro_ros.direct import request

COUNT, STEP_NS = 101, 100_000_000


def numbers(begin_ns: int):
    """Events 0, 1, ... 0.1 s apart."""
    return ((k * STEP_NS, k) for k in range(COUNT) if k * STEP_NS >= begin_ns)


def test_what_an_event_does_to_the_playback_counts_for_the_next_one():
    """Changes from the thread that plays: no clock decides the outcome."""
    seen: list[int] = []
    playback = Playback(numbers, 0, (COUNT - 1) * STEP_NS, rate=0.0, loop=True)

    def emit(stamp_ns: int, number: int) -> None:
        seen.append(number)
        if seen == [0, 1, 2]:
            playback.seek(9.8)
        if number == 100 and seen.count(100) == 2:
            playback.loop = False

    playback.run(emit)
    assert seen == [0, 1, 2, 98, 99, 100, *range(101)]
    playback.seek(-1.0)
    assert playback.position_s == 0.0
    playback.seek(99.0)
    assert playback.position_s == 10.0


def test_a_paused_playback_plays_nothing_until_it_goes_on():
    seen: list[int] = []
    playback = Playback(numbers, 0, (COUNT - 1) * STEP_NS, rate=0.0, loop=False)
    playback.pause()
    thread = threading.Thread(target=playback.run, args=(lambda stamp, number: seen.append(number),))
    thread.start()
    thread.join(0.2)
    assert thread.is_alive()
    assert seen == []
    playback.seek(9.9)
    playback.resume()
    thread.join(LIMIT_S)
    assert seen == [99, 100]


def test_a_stop_ends_a_pause():
    playback = Playback(numbers, 0, (COUNT - 1) * STEP_NS, rate=1e-6, loop=False)
    thread = threading.Thread(target=playback.run, args=(lambda stamp, number: None,))
    thread.start()
    playback.pause()
    playback.stop()
    thread.join(LIMIT_S)
    assert not thread.is_alive()


def test_keys_have_names():
    assert keys(" l\x1b[C\x1b[D\x1b[A\x1b[Bq") == ["space", "l", "right", "left", "up", "down", "q"]


@pytest.fixture
def bag(tmp_path) -> Path:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(Topic("/numbers", "std_msgs/msg/UInt64"))
        for stamp_ns, number in numbers(0):
            writer.write("/numbers", bytes(4) + number.to_bytes(8, "little"), stamp_ns)
    return tmp_path / "bag"


def test_services_and_parameters(domain, bag):
    rclpy.init(args=["--ros-args", "-p", f"bag:={bag}", "-p", "paused:=true", "-p", "start_s:=1.0"])
    try:
        player = Player()
        player.trigger_configure()
        player.trigger_activate()
        playback = player._playback
        assert playback.paused
        assert request(player, "~/resume").message.startswith("playing from 1.")
        assert not playback.paused
        assert request(player, "~/toggle_paused").message.startswith("paused at 1.")
        (done,) = player.set_parameters([Parameter("start_s", value=7.5)])
        assert done.successful
        assert playback.position_s == pytest.approx(6.5)
        for value, words in ((0.5, "allowed: 1 to 10"), (11.0, "allowed: 1 to 10"), (-1.0, "start_s")):
            (done,) = player.set_parameters([Parameter("start_s", value=value)])
            assert not done.successful
            assert words in done.reason
        (done,) = player.set_parameters([Parameter("rate", value=-2.0)])
        assert not done.successful
        assert all(one.successful for one in player.set_parameters([Parameter("rate", value=3)]))
        assert all(one.successful for one in player.set_parameters([Parameter("loop", value=True)]))
        assert (playback.rate, playback.loop) == (3.0, True)
        player.diagnose()
        player.trigger_deactivate()
        player.trigger_cleanup()
        player.trigger_configure()  # with the same services and parameters once more
        player.trigger_activate()
        assert player.failure is None
        assert request(player, "~/resume").success
        assert request(player, "~/pause").success
        player.trigger_shutdown()
    finally:
        rclpy.try_shutdown()


@pytest.mark.process
def test_keys_of_a_terminal(domain, bag):
    leader, terminal = pty.openpty()
    before = termios.tcgetattr(terminal)
    process = subprocess.Popen(
        ["setsid", "--ctty", "--wait", sys.executable, "-m", "soro_ros.cli", "play", str(bag), "--paused"],
        stdin=terminal,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    said: list[str] = []
    reader = threading.Thread(target=lambda: said.extend(iter(process.stderr.readline, "")))
    reader.start()

    def wait_for(words: str) -> None:
        limit = time.monotonic() + LIMIT_S
        while words not in "".join(said):
            assert process.poll() is None, said
            assert time.monotonic() < limit, said
            time.sleep(0.01)

    try:
        wait_for("keys: space pauses")
        for sent, words in ((b"\x1b[C", "at 5.000 s"), (b"\x1b[A", "rate 2"), (b"l", "loop on")):
            os.write(leader, sent)
            wait_for(words)
        os.write(leader, b" ")
        wait_for("playing from 5.")
        assert termios.tcgetattr(terminal) != before
        os.write(leader, b"q")
        assert process.wait(LIMIT_S) == 0
        assert termios.tcgetattr(terminal) == before
    finally:
        process.kill()
        process.wait()
        reader.join(LIMIT_S)
        process.stderr.close()
        os.close(leader)
        os.close(terminal)
