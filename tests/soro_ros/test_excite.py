"""`soro excite`: through the real nodes, valves and limiter in lockstep, its stop, its refusals, Ctrl-C."""

import json
import os
import signal
import subprocess

import numpy as np
import pytest
import rclpy
import yaml
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soro_lab.bag import BagReader
from soro_ros.conversion import messages
from soro_ros.nodes.exciter import ExciterNode
from soro_ros.run.compose import Run
from soro_ros.run.loop_nodes import excitation_loop
from soro_ros.run.run_processes import END_ORDER
from tests.patience import COMPILED_S, LIMIT_S, patient_platform
from tests.refused import refused_keys
from tests.soro_ros.direct import captured, receive, request, values
from tests.soro_ros.running import SORO, ClockListener, only_run
from tests.warm import Popen, completed

NAMES = ["link0/chamber0", "link0/chamber1", "link0/chamber2"]
# Three chambers, one level: some 7 s of arm time.
SHORT = ("--stages", "singles", "--levels", "1", "--hold", "0.5", "--set", "excite.rest_s=0.5")
SHORT += ("--set", "excite.shortest_hold_s=0.4", "--set", "excite.ramp_s=0.2")


def command(folder, *options):
    platform = patient_platform(folder, real_time=False)
    changes = ("--set", "mode=lockstep", "--set", f"platform={platform}")
    return [*SORO, "excite", "track_circle", *changes, "--folder", str(folder / "runs"), *options]


def excited(folder, *options):
    """Exit status, output and folder of a run."""
    done = completed(command(folder, *options), 250)
    return done.returncode, done.stderr, only_run(folder / "runs")


class Bag:
    """Topics of a run as arrays over time."""

    def __init__(self, folder):
        rows = {"chambers/command": [], "chambers/state": [], "exciter/section": [], "sensors/pose0": []}
        with BagReader(folder / "bag") as reader:
            assert not reader.problems
            for item in reader.messages():
                name = item.topic.removeprefix("/track_circle/")
                if name not in rows:
                    continue
                kind = PoseStamped if name == "sensors/pose0" else JointState
                message = deserialize_message(item.data, kind)
                rows[name].append((messages.to_ns(message.header.stamp) * 1e-9, message))
        self.sections = [(t, m.header.frame_id, m.name[0]) for t, m in rows["exciter/section"]]
        self.command, self.reading = (
            np.array([(t, *m.effort) for t, m in rows[name]])
            for name in ("chambers/command", "chambers/state")
        )
        self.pose = np.array([(t, *messages.pose_arrays(m.pose)[0]) for t, m in rows["sensors/pose0"]])


@pytest.mark.process
def test_an_excitation_on_emulated_valves_is_done_and_recorded(domain, tmp_path, figure):
    status, output, folder = excited(tmp_path, *SHORT)
    assert status == 0, output
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["verdict"], summary["reason"]) == ("done", "")
    assert summary["sections_done"] == summary["sections"] == 7
    bag, plan = Bag(folder), yaml.safe_load((folder / "plan.yaml").read_text())["sections"]
    assert [name for _, _, name in bag.sections] == [
        *(f"{one['stage']}: {one['name']}" for one in plan),
        "venting",
        "over",
    ]
    begins = [t for t, _, _ in bag.sections]
    for one, t, end in zip(plan, begins, begins[1:], strict=False):
        # Each section holds its set points at its end; each chamber is alone at its level.
        held = bag.command[(bag.command[:, 0] > end - 0.3) & (bag.command[:, 0] < end), 1:]
        assert len(held) > 50
        assert np.ptp(held, axis=0).max() == 0.0
        up = [90e3 if f"{name} up" in one["name"] else 0.0 for name in NAMES]
        assert held[0].tolist() == up
        read = bag.reading[(bag.reading[:, 0] > end - 0.1) & (bag.reading[:, 0] < end), 1:]
        assert np.abs(read.mean(axis=0) - up).max() < 2e3
        assert end - t <= one["longest_s"] * 3.0
    assert len(bag.pose) >= 100 * begins[-1] - 1  # the vent at the end has some more
    assert not bag.command[bag.command[:, 0] >= begins[-2], 1:].any()
    assert bag.reading[-1, 1:].max() < 2e3
    assert summary["duration_s"] == pytest.approx(begins[-1], abs=0.01)
    rates = np.diff(bag.command[:, 1:], axis=0) / np.diff(bag.command[:, :1], axis=0)
    assert rates.max() <= 200e3
    assert rates.min() >= -400e3
    figure(
        f"excitation: tip moves {1e3 * np.ptp(bag.pose[:, 1:], axis=0).max():.0f} mm in {begins[-1]:.1f} s"
    )
    assert np.ptp(bag.pose[:, 1:], axis=0).max() > 0.02


@pytest.mark.process
def test_a_trip_of_the_limiter_ends_the_excitation(domain, tmp_path):
    fault = "faults=[{fault: mute, chamber: link0/chamber2, at: 1.5}]"
    status, output, folder = excited(tmp_path, *SHORT, "--set", fault)
    assert status == 1, output
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["verdict"] == "stopped"
    assert "link0/chamber2" in summary["reason"]
    assert 1.5 < summary["duration_s"] < 6.0
    assert summary["sections_done"] < summary["sections"]
    bag = Bag(folder)
    first = bag.command[bag.command[:, 1:].any(axis=1), 0][0]
    assert first < 1.5


@pytest.mark.process
def test_an_interrupt_vents_closes_the_bag_and_is_no_error(domain, tmp_path):
    clock = ClockListener()
    direct = command(tmp_path, "--set", "platform=")
    process = Popen(direct, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        clock.wait(2.0, COMPILED_S)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=LIMIT_S)
    finally:
        process.kill()
        clock.close()
    assert process.returncode == 130, err
    folder = only_run(tmp_path / "runs")
    assert "vented; bag closed" in err
    assert json.loads((folder / "summary.json").read_text())["verdict"] == "interrupted"
    assert Bag(folder).command[-1, 0] >= 2.0 - 0.005  # the clock is a tick ahead of the commands


@pytest.mark.parametrize(
    ("options", "key", "names"),
    [
        (("--set", "twin.pose.enabled=false"), "twin.pose.enabled", ("twin.imu",)),
        (
            ("--set", "twin.pose.enabled=false", "--set", "twin.imu.enabled=true", "--box", "40mm"),
            "excite.motion.box_m",
            ("bend_rad",),
        ),
        (("--box", "wide"), "--box", ()),
        (("--box", "0"), "excite.motion.box_m", ()),
        (("--duration", "20"), "excite.duration_s", ("3 chambers",)),
        (("--max", "95kPa"), "excite.maximum_pa", ("90000",)),
        (("--levels", "0"), "excite.levels", ()),
        (("--stages", "jumps"), "excite.stages[0]", ("singles",)),
        (("--release",), "excite.release", ("arm: real",)),
        (("--set", "recorder.enabled=false"), "recorder.enabled", ("bag",)),
        (("--device", ""), "--device", ()),
    ],
)
def test_what_cannot_be_excited_is_one_line(soro, tmp_path, options, key, names):
    status, _, err = soro("excite", "track_circle", "--folder", str(tmp_path / "runs"), *options)
    assert status == 2, err
    (line,) = err.splitlines()
    assert refused_keys(line) == [key]
    assert all(name in line for name in names), line
    assert not (tmp_path / "runs").exists()


def test_a_folder_that_is_a_file_is_refused(soro, tmp_path):
    (tmp_path / "runs").write_text("")
    status, _, err = soro("excite", "track_circle", "--folder", str(tmp_path / "runs"))
    assert status == 2
    assert refused_keys(err.splitlines()[-1]) == ["--folder"]


def test_every_option_is_explained(soro):
    status, out, _ = soro("excite", "--help")
    assert status == 0
    for option in (
        "--set",
        "--valves",
        "--device",
        "--arm",
        "--folder",
        "--levels",
        "--duration",
        "--release",
    ):
        assert option in out


@pytest.fixture
def exciter(domain):
    """Make an active exciter node with parameters."""
    nodes = []

    def made(**parameters):
        arguments = [f"{key}:={value}" for key, value in {"pose_rate_hz": 100.0, **parameters}.items()]
        rclpy.init(args=["--ros-args", *(part for one in arguments for part in ("-p", one))])
        node = ExciterNode()
        nodes.append(node)
        node.trigger_configure()
        node.trigger_activate()
        assert node.failure is None
        return node

    yield made
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()


def pose(t, x=0.0):
    transform = np.eye(4)
    transform[:3, 3] = x, 0.0, 0.064
    return messages.pose_stamped(transform, round(t * 1e9), "world")


def reading(t):
    return messages.chambers(NAMES, np.zeros(3), round(t * 1e9))


def test_in_lockstep_a_tick_waits_for_its_samples_and_the_time_stands_at_the_end(exciter):
    node = exciter(mode="lockstep", pose_delay_s=0.005)
    sent = captured(node, "chambers/command")
    assert request(node, "~/enable").success
    receive(node, "chambers/state", reading(0.0))
    assert len(sent) == 1
    receive(node, "chambers/state", reading(0.005))
    assert len(sent) == 1
    receive(node, "sensors/pose0", pose(0.0))
    assert [messages.to_ns(one.header.stamp) for one in sent] == [0, 5_000_000]
    k = 1
    while values(node).get("phase") != "over":
        k += 1
        receive(node, "chambers/state", reading(0.005 * k))
        if k % 2:
            # The tip leaves its box after 1.6 s.
            receive(node, "sensors/pose0", pose(0.005 * (k - 1), 0.3 * (k > 320)))
    assert "the tip left its box" in values(node)["reason"]
    assert len(sent) == k  # the last tick has no answer
    pressed = [tick for tick, one in enumerate(sent) if any(one.effort)]
    assert pressed[-1] + 1 == 325  # the third sample beyond the box, which is known a tick later


def test_in_real_time_the_arm_must_have_been_seen_and_zero_is_commanded_before_and_after(exciter):
    node = exciter()
    sent = captured(node, "chambers/command")
    receive(node, "chambers/state", reading(1000.0))
    assert not request(node, "~/enable").success
    receive(node, "sensors/pose0", pose(999.99))
    receive(node, "chambers/state", reading(1000.005))
    assert request(node, "~/enable").success
    k = 0
    while values(node).get("phase") != "over":
        receive(node, "sensors/pose0", pose(1000.005 + 0.005 * k, 0.3 * (k > 320)))
        k += 1
        receive(node, "chambers/state", reading(1000.005 + 0.005 * k))
    assert "the tip left its box" in values(node)["reason"]
    assert any(any(one.effort) for one in sent)
    count = len(sent)
    receive(node, "chambers/state", reading(1000.005 + 0.005 * (k + 1)))
    assert len(sent) == count + 1
    assert not any(sent[-1].effort)
    assert sent[-1].header.frame_id.endswith(f"exciter #{os.getpid()}")


def test_a_sample_from_before_the_begin_does_not_count(exciter):
    """Its time is that of another epoch, so that the arm would never seem to be still."""
    node = exciter()
    receive(node, "sensors/pose0", pose(999.99))
    receive(node, "chambers/state", reading(1000.0))
    request(node, "~/enable")
    k = 0
    while int(values(node).get("section", 0)) < 2:
        receive(node, "sensors/pose0", pose(1000.0 + 0.005 * k))
        k += 1
        receive(node, "chambers/state", reading(1000.0 + 0.005 * k))
    # The rest, a ramp and the shortest time at a level.
    assert 0.005 * k == pytest.approx(1.5 + 0.2 + 1.1, abs=0.02)


def test_a_vent_ends_the_excitation(exciter):
    node = exciter(mode="lockstep")
    sent = captured(node, "chambers/command")
    request(node, "~/enable")
    for k in range(350):
        if k % 2 == 0:
            receive(node, "sensors/pose0", pose(0.005 * k))
        receive(node, "chambers/state", reading(0.005 * k))
    assert any(sent[-1].effort)
    assert request(node, "~/vent").success
    receive(node, "sensors/pose0", pose(0.005 * 350))
    receive(node, "chambers/state", reading(0.005 * 350))
    assert not any(sent[-1].effort)
    assert values(node)["reason"] == "vent requested"


def test_the_exciter_takes_the_place_of_estimator_and_controller_and_no_shadow_runs(tmp_path):
    from soro_lab.scene import load_scene

    real = {"valves": "real", "device": "/dev/x", "arm": "real"}
    for changes, nodes in (({}, ["exciter"]), (real, ["exciter"])):
        scene = load_scene("track_circle", changes)
        loop = excitation_loop(scene)
        assert list(loop.nodes) == nodes
        assert not loop.shadow
        assert set(loop.nodes) <= set(END_ORDER)
        Run(scene, tmp_path, print, loop=loop).end()
