"""Without the program that runs an arm, which may be stopped, killed or hang, the arm is vented."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import JointState

from soro_ros.conversion import qos
from soro_ros.host import middleware, pulse
from soro_ros.host.pulse import LIMIT_S, Listener, Pulse
from soro_ros.run import processes
from tests.patience import COMPILED_S
from tests.patience import LIMIT_S as PATIENCE_S
from tests.soro_ros.running import SORO, end, only_run, summary, wait_until


def test_a_silence_of_a_second_is_trouble_and_the_end_of_the_pipe_at_once():
    now_s = [0.0]
    ours, theirs = os.pipe()
    heard = Listener(ours, lambda: now_s[0])
    now_s[0] = 100.0
    assert heard.failure() is None  # none has come yet: nothing moves before the first one
    os.write(theirs, b"...")
    assert heard.failure() is None
    now_s[0] += LIMIT_S
    assert heard.failure() is None
    now_s[0] += 0.01
    assert "stopped or hangs" in heard.failure()
    os.write(theirs, b".")
    assert heard.failure() is None
    os.close(theirs)
    assert "has ended" in heard.failure()
    assert "has ended" in heard.failure()
    os.close(ours)


def test_a_program_that_hangs_gives_no_signs_after_the_end_of_its_run(monkeypatch):
    monkeypatch.setattr(pulse, "PERIOD_S", 0.01)
    given = Pulse()
    try:
        given.begin(longest_s=0.1)
        time.sleep(0.3)
        os.set_blocking(given.pipe, False)
        assert 1 <= len(os.read(given.pipe, 1000)) <= 11
        with pytest.raises(BlockingIOError):
            os.read(given.pipe, 1000)
        given.renew(60.0)
        wait_until(lambda: os.read(given.pipe, 1000) if readable(given.pipe) else b"", "a sign")
        assert given.stood_still_s == 0.0
    finally:
        given.close()


def readable(pipe: int) -> bool:
    return bool(select.select([pipe], [], [], 0.0)[0])


def test_a_process_without_a_pipe_listens_to_nobody(monkeypatch):
    for text in ("", "words", "9999", str(os.open(os.devnull, os.O_RDONLY))):
        monkeypatch.setenv(pulse.VARIABLE, text)
        assert pulse.listener() is None
    monkeypatch.delenv(pulse.VARIABLE)
    assert pulse.listener() is None


class ArmListener:
    """Hears commands and latch of the arm of a run, in the domain of this process."""

    def __init__(self, namespace: str) -> None:
        middleware.init()
        self._node = Node("watcher", namespace=namespace)
        self.pressure_pa, self.latch = 0.0, ""
        self._node.create_subscription(JointState, "chambers/state", self._hear, qos.SENSOR)
        self._node.create_subscription(DiagnosticStatus, "chambers/latch", self._note, qos.LATCHED)

    def _hear(self, message: JointState) -> None:
        self.pressure_pa = max(message.effort)

    def _note(self, message: DiagnosticStatus) -> None:
        self.latch = message.message

    def until(self, condition, what: str, limit_s: float = PATIENCE_S) -> float:
        """Receive messages until a condition holds; return how long it took [s]."""
        begin = time.monotonic()

        def holds() -> bool:
            rclpy.spin_once(self._node, timeout_sec=0.1)
            return condition()

        wait_until(holds, what, limit_s, every_s=0.0)
        return time.monotonic() - begin

    def close(self) -> None:
        self._node.destroy_node()
        rclpy.shutdown()


# Deadlines of the loop that a busy machine keeps.
AGES = ("limits.command_age_s=0.5", "limits.reading_age_s=0.5")
PATIENT = ("platform=", "duration_s=600", "rate_hz=50", "twin.pose.rate_hz=50", *AGES)
PATIENT += ("controller.probe_at_enable=off",)  # it takes seconds


@pytest.fixture
def moving(domain, tmp_path):
    """A run in real time whose arm is under pressure, its listener, and the folder of its runs."""
    options = [part for change in PATIENT for part in ("--set", change)]
    command = [*SORO, "run", "track_circle", "--no-figure", "--folder", str(tmp_path), *options]
    # A group of its own in this session: the terminal stops such a group with Ctrl-Z.
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, process_group=0
    )
    arm = ArmListener("track_circle")
    try:
        arm.until(lambda: arm.pressure_pa > 10e3 or process.poll() is not None, "pressure", COMPILED_S)
        assert process.poll() is None, process.communicate()
        yield process, arm, tmp_path
    finally:
        arm.close()
        process.send_signal(signal.SIGCONT)
        end(process)


@pytest.mark.process
@pytest.mark.real_time
def test_a_stopped_run_is_vented_and_says_so_when_it_goes_on(moving):
    """By the terminal's Ctrl-Z, which stops whatever is in its group."""
    process, arm, folder = moving
    os.killpg(process.pid, signal.SIGTSTP)
    took_s = arm.until(lambda: arm.latch.startswith("vented"), "vent")
    assert "stopped or hangs" in arm.latch
    assert took_s > LIMIT_S / 2
    arm.until(lambda: arm.pressure_pa < 2e3, "empty chambers")
    os.kill(process.pid, signal.SIGCONT)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1, err
    found = summary(only_run(folder))
    assert found["verdict"] == "vented"
    assert "stopped or hangs" in found["reason"]
    assert "Traceback" not in err


@pytest.mark.process
@pytest.mark.real_time
@pytest.mark.parametrize("how", ["stopped or hangs", "has ended"])
def test_the_nodes_of_one_process_vent_without_the_program_that_started_it(domain, tmp_path, how):
    settings = ("rate_hz:=50.0", "controller:platform:=''", "controller:enabled:=true")
    settings += ("controller:control.reference.kind:=circle", "twin:pose.rate_hz:=50.0")
    kept = ("twin:limits.command_age_s:=0.5", "twin:limits.reading_age_s:=0.5")
    options = [part for one in (*settings, *kept) for part in ("-p", one)]
    command = [sys.executable, "-m", "soro_ros.nodes.arm", "--ros-args", "-r", "__ns:=/one", *options]
    given = Pulse()
    process = processes.start("arm", command, tmp_path, pipe=given.pipe)
    arm = ArmListener("one")
    try:
        given.begin(longest_s=600.0)
        arm.until(lambda: arm.latch == "open" and arm.pressure_pa > 1e3, "control", COMPILED_S)
        assert process.process.poll() is None
        if how == "has ended":
            given.close()
        else:
            given.renew(0.0)
        arm.until(lambda: how in arm.latch, "vent")
    finally:
        arm.close()
        given.close()
        assert processes.stop(process, PATIENCE_S) == (0, False), process.log.read_text()
