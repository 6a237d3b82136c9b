"""The probe before control between nodes: a run in lockstep that it refuses, and the node in real time."""

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseStamped

from soro_core.config import find_config, read_yaml
from soro_ros.conversion import messages
from soro_ros.nodes.controller import ControllerNode
from soro_ros.recordings.recording import read
from soro_ros.topics.diagnostics import ERROR
from tests.soro_ros.direct import active, captured, receive, request
from tests.soro_ros.running import run

CHAMBERS = ["link0/chamber0", "link0/chamber1", "link0/chamber2"]
NAMES = ["link0/elongation", "link0/bending_x", "link0/bending_y"]
SWAPPED = "link0/chamber1 acts as link0/chamber2"


def wired_wrong(folder):
    """A robot file of the standing arm with two chambers swapped."""
    robot = read_yaml(find_config("tue_three_bellow", "robots"))
    link = robot["links"][0]
    link["chambers"] = [link["chambers"][k] for k in (0, 2, 1)]
    file = folder / "wired_wrong.yaml"
    file.write_text(yaml.safe_dump(robot))
    return file


@pytest.mark.process
def test_a_run_in_lockstep_names_swapped_chambers_before_its_law_begins(domain, tmp_path):
    """With `warn` the law begins: `test_probing.py`."""
    changes = ("platform=", "mode=lockstep", "duration_s=8.5", "twin.refine=2", "twin.payload_kg=0.0")
    changes += (f"twin.plant={wired_wrong(tmp_path)}", "controller.probe_at_enable=refuse")
    status, output, _ = run(tmp_path / "runs", *changes)
    assert status == 1
    assert f"probe: chambers are swapped: {SWAPPED}" in output
    assert "tip error" not in output  # the law has not moved the tip


@pytest.mark.process
def test_the_time_of_a_run_in_lockstep_begins_behind_its_probe(domain, tmp_path):
    changes = ("platform=", "mode=lockstep", "duration_s=2", "controller.probe_at_enable=refuse")
    status, output, folder = run(tmp_path / "runs", *changes)
    assert status == 0, output
    recording = read(folder / "bag", "track_circle")
    under_control_s = recording.wanted_tip.t
    assert under_control_s[-1] == pytest.approx(2.0, abs=0.02)
    probed = (recording.command.t < 0.0) & (recording.command.value.max(axis=1) > 0.0)
    assert np.ptp(recording.command.t[probed]) > 1.0
    pressed = np.any(recording.reading.value > 5e3, axis=1)
    assert recording.reading.t[-1] > recording.reading.t[pressed][-1] + 0.1, "recorded until it is empty"


def give(node, age_s, pressure_pa=0.0):
    stamp_ns = node.get_clock().now().nanoseconds - round(1e9 * age_s)
    receive(node, "chambers/state", messages.chambers(CHAMBERS, np.full(3, pressure_pa), stamp_ns))
    receive(node, "arm/state", messages.arm_state(NAMES, *np.zeros((3, 3)), stamp_ns))


def test_in_real_time_the_probe_is_on_and_a_doubt_ends_control_with_the_reason(domain):
    with active(ControllerNode, "rate_hz:=200.0") as node:
        commands = captured(node, "chambers/command")
        desired = captured(node, "arm/desired/tip")
        give(node, 0.0)
        assert request(node, "~/enable").success
        give(node, 0.08)
        assert "probing" in node.diagnostics.message
        give(node, -0.06)  # 0.14 s later
        assert "no estimate of the arm for 0.1" in node.diagnostics.message
        assert node.diagnostics.level == ERROR
        give(node, -0.065)
        assert all(list(one.effort) == [0.0, 0.0, 0.0] for one in commands)
        assert desired == []
        # Enabled anew it begins anew.
        assert request(node, "~/enable_anyway").success
        assert node.diagnostics.level != ERROR
        assert node.state.probe.lenient
        assert not node.state.probe.done


@pytest.mark.parametrize("setting", ["mode:=lockstep", "control.probe_at_enable:='off'"])
def test_without_the_key_in_lockstep_and_with_off_the_law_begins_at_once(domain, setting):
    with active(ControllerNode, setting) as node:
        assert node.controller.probe is None


def test_what_can_be_no_pose_is_not_noted(domain):
    with active(ControllerNode, "rate_hz:=200.0") as node:
        for place, noted in ((1e200, 0), (np.nan, 0), (0.1, 1)):
            sample = PoseStamped(pose=messages.pose([place, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]))
            node._ticks.note_pose("sensors/pose", sample)
            assert len(node._ticks._seen) == noted
