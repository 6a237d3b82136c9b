"""The main job in lockstep: real nodes, real topics, real frames on a pseudo-terminal."""

import os
import signal
import subprocess
import time

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soro_core.config import with_changes
from soro_lab.bag import BagReader
from soro_lab.identification.recording import Place, read_bag
from soro_lab.scene import load_scene
from soro_ros.conversion import messages
from soro_ros.host.middleware import DELIVERY_S
from soro_ros.recordings.recording import read
from soro_ros.recordings.report import summarise
from soro_ros.study.closed_loop import run_in_process
from tests.patience import COMPILED_S, LIMIT_S, patient_platform
from tests.soro_ros.conftest import own_domain
from tests.soro_ros.in_process import tip_error_rms_m
from tests.soro_ros.running import (
    ClockListener,
    alive,
    child,
    only_run,
    payloads,
    run,
    start_run,
    summary,
)

MAIN = ("mode=lockstep", "duration_s=11", "rate_hz=200")


@pytest.fixture(scope="module")
def main_job(tmp_path_factory):
    """The folder of the main job, its end a good one."""
    folder = tmp_path_factory.mktemp("main_job")
    platform = patient_platform(folder, real_time=False)
    with own_domain(tmp_path_factory.mktemp("state")):
        # Its own Python waits at the end until the arm rests, as it does for a user.
        changes = (*MAIN, f"platform={platform}")
        status, output, found = run(folder / "runs", *changes, popen=subprocess.Popen)
    assert status == 0, output
    return found


@pytest.mark.process
def test_the_controller_tracks_the_circle_on_emulated_valves(main_job, figure):
    """The figures of the main job, and without adaptation, in one process."""
    on = summary(main_job)
    assert (on["verdict"], on["faults"], on["frames_lost"]) == ("good", [], 0)
    assert on["frames_sent"] > 200 * 11 * 4
    assert on["pressure_min_pa"] >= -500
    assert on["pressure_max_pa"] <= 90.5e3
    # What learns nothing is after the way up as it stays: its last 5 s are those of a longer run.
    fixed = load_scene("track_circle", {"mode": "lockstep", "controller.adapt": False})
    off_m = tip_error_rms_m(fixed, 3.0, 8.0)
    last_m, first_m = on["tip_error_last_rms_m"], on["tip_error_first_rms_m"]
    figure(f"main job: tip error RMS {1e3 * first_m:.2f} mm at first, {1e3 * last_m:.2f} mm in the last 5 s")
    figure(f"main job: {1e3 * off_m:.2f} mm in the last 5 s without adaptation")
    figure(f"main job: estimator's tip error RMS {1e3 * on['estimator_error_last_rms_m']:.2f} mm")
    # More than a tenth of the length away from the circle is lost.
    assert off_m > fixed.verdict.tip_error_part * fixed.loaded_robot.length
    assert last_m <= 0.3e-3
    assert last_m <= 0.5 * off_m
    assert last_m < first_m < off_m
    assert on["estimator_error_last_rms_m"] <= 1.0e-3
    # Of the valves one process has the response alone: not their noise, their steps and their bus.
    scene = load_scene("track_circle", {"mode": "lockstep", "duration_s": 11})
    alone = summarise(run_in_process(scene)[0], scene)
    assert abs(alone.tip_error_last_rms_m - last_m) < 1e-3 * scene.loaded_robot.length


@pytest.mark.process
def test_a_run_in_lockstep_is_recorded_in_its_own_time_until_the_arm_is_empty(main_job):
    """Not in that of the machine; the chambers are empty for 2 s at the end, and nothing is an event."""
    with BagReader(main_job) as reader:
        begin_s, end_s = 1e-9 * reader.start_ns, 1e-9 * reader.end_ns
        noted = [
            (one.log_time_ns, messages.to_ns(deserialize_message(one.data, JointState).header.stamp))
            for one in reader.messages(["/track_circle/chambers/state"])
        ]
    late_ns = np.subtract(*np.transpose(noted))
    assert begin_s == 0.0
    assert {noted_ns % 5_000_000 for noted_ns, _ in noted} == {0}, (
        "times of ticks, at any load of the machine"
    )
    assert 13.0 < end_s < 15.5
    # Ticks of 5 ms that are on their way: a few; more where the recorder waits for the processor, as some do.
    assert np.median(np.abs(late_ns)) <= 20_000_000
    # A machine that gives the recorder no time for a second delays the few messages of that second.
    assert np.quantile(np.abs(late_ns), 0.95) <= 1_000_000_000
    recording = read(main_job, "track_circle")
    empty = np.all(np.abs(recording.reading.value) < 5e3, axis=1)
    pressed_s = recording.reading.t[~empty][-1]
    assert pressed_s > 10.9
    assert 1.99 <= recording.reading.t[-1] - pressed_s <= 2.05
    assert recording.wanted_tip.t[-1] == pytest.approx(10.995)
    assert recording.events == ()


SHORT = (
    "mode=lockstep",
    "rate_hz=200",
    "platform=",
    "duration_s=1.5",
    "twin.air=states",
    "twin.imu.enabled=true",
    "twin.pose.locations=[1.0, 0.5]",
    "twin.payload_changes.at_s=[0.4, 0.8]",
    "controller.reference.start_s=0.3",
    "controller.reference.pause_s=0.1",
)
TICKS = 301  # 1.5 s at 200 Hz, from 0 on


@pytest.fixture(scope="module")
def held_up(tmp_path_factory):
    """The folder of a short run of `set_points` without valves; its recorder stood still most of the time."""
    folder = tmp_path_factory.mktemp("held_up")
    with own_domain(tmp_path_factory.mktemp("state")):
        clock = ClockListener()
        process = start_run(folder, *SHORT, scene="set_points")
        try:
            # Not longer: a node that says nothing for 8 s ends the run.
            clock.wait(0.3, COMPILED_S)
            controller, recorder = (
                child(process.pid, f"nodes.{name}") for name in ("controller", "recorder")
            )
            os.kill(recorder, signal.SIGSTOP)
            clock.wait(1.5)
            # Half of the time that a node waits for its readers: one that does not wait is gone by then.
            deadline = time.monotonic() + DELIVERY_S / 2
            while alive(controller) and time.monotonic() < deadline:
                time.sleep(0.02)
            os.kill(recorder, signal.SIGCONT)
            out, err = process.communicate(timeout=2 * LIMIT_S)
        finally:
            process.kill()
            clock.close()
    assert process.returncode == 0, out + err
    return only_run(folder)


@pytest.mark.process
def test_what_a_node_published_before_it_ended_is_in_the_bag(held_up):
    """A recorder that is held up hears the rest of a run, for no node ends before its readers have it all."""
    found = payloads(held_up / "bag")
    assert TICKS < len(found["/clock"]) == len(found["/set_points/truth/tip"])  # and until the arm is empty
    assert len(found["/set_points/chambers/command"]) >= TICKS - 1
    assert found["/set_points/chambers/latch"]


@pytest.mark.process
@pytest.mark.parametrize("valves", [False, True], ids=["direct", "behind valves"])
def test_a_repeated_lockstep_run_is_the_same_to_the_bit(domain, tmp_path, request, valves):
    """Whatever the recorder did meanwhile, and whenever the run ends."""
    changes, scene = SHORT, "set_points"
    if valves:
        platform = patient_platform(tmp_path, real_time=False)
        changes, scene = (*MAIN, "duration_s=1.5", f"platform={platform}"), "track_circle"
    first = request.getfixturevalue("main_job" if valves else "held_up")
    status, output, second = run(tmp_path / "runs", *changes, scene=scene)
    assert status == 0, output
    # Diagnostics carry wall times; nothing waits for a reader of the backbone; the latch names the devices,
    # whose path is another one in each run.
    without = ("/diagnostics", "_event", "/arm/backbone", "/chambers/latch")
    first, second = (payloads(folder / "bag", without=without) for folder in (first, second))
    assert first.keys() == second.keys()
    ended = {len(found[f"/{scene}/truth/tip"]) for found in ((second,) if valves else (first, second))}
    assert len(ended) == 1
    assert min(ended) > TICKS
    for topic, bodies in second.items():
        # From the first message on; how much of the last tick is heard is a matter of who ends first. The
        # control of the main job goes on where that of the short one ends, whose part is compared.
        part = (TICKS - 3) / min(ended) if valves else 1.0
        ticks = min(int(part * len(bodies)), len(first[topic]))
        assert ticks >= int(part * len(bodies)) - 2, topic
        assert bodies[:ticks] == first[topic][:ticks], topic
    assert len(set(second[f"/{scene}/sensors/pose0"])) > 100
    assert valves or len(set(second[f"/{scene}/sensors/pose1"])) > 100


def test_the_nodes_compute_what_one_process_computes(held_up):
    """To the bit: topics, processes and their order change no number; path and load reach the nodes."""
    scene = load_scene(held_up / "scene_used.yaml")
    assert scene.twin.payload_changes.at_s == (0.4, 0.8)
    recorded = read(held_up / "bag", scene.name)
    alone, end = run_in_process(scene)
    assert end.status == 0
    # The bag has the truth from the tick before the first estimate on.
    for name in ("true_state", "true_tip", "wanted_tip", "estimated_state", "command"):
        series, own = (getattr(one, name) for one in (recorded, alone))
        first = int(np.searchsorted(series.t, -1e-9))
        assert len(own.value) >= TICKS - 2
        length = min(len(own.value), len(series.value) - first)
        assert length >= TICKS - 2
        np.testing.assert_array_equal(series.value[first:][:length], own.value[:length], err_msg=name)
        np.testing.assert_allclose(series.t[first:][:length], own.t[:length], atol=1e-9)
    assert np.ptp(recorded.command.value) > 10e3
    unchanged = scene.with_keys(twin=with_changes(scene.twin, payload_changes={})).with_keys(duration_s=0.81)
    constant, _ = run_in_process(unchanged)
    moved = 1e3 * np.linalg.norm(alone.true_tip.value[:161] - constant.true_tip.value[:161], axis=1)
    assert moved[:80].max() == 0.0
    assert moved[160] > 1.0


def test_the_run_is_a_recording_for_identification(held_up):
    """Every sensor with the place that its scene states; the readings are those that ROS reads."""
    found = read_bag(held_up, load_scene(held_up / "scene_used.yaml").loaded_robot)
    assert [(plate.name, plate.place) for plate in found.plates] == [
        ("sensors/pose0", Place(0)),
        ("sensors/pose1", Place(0, 0.032)),
    ]
    assert [(imu.name, imu.place) for imu in found.imus] == [("sensors/imu0", Place(0))]
    recorded = read(held_up / "bag", "set_points")
    pose, first_s = recorded.measured_tip, recorded.reading.t[0]
    np.testing.assert_array_equal(found.plates[0].position, pose.value)
    np.testing.assert_allclose(found.plates[0].t, pose.t - first_s, atol=1e-9)
    fresh = np.concatenate([[True], (np.diff(recorded.reading.value, axis=0) != 0.0).any(axis=1)])
    np.testing.assert_array_equal(found.pressure.values, recorded.reading.value[fresh])
    assert np.linalg.norm(found.imus[0].accel, axis=1).mean() == pytest.approx(9.81, abs=0.5)
    assert found.notes == ()


@pytest.mark.process
@pytest.mark.parametrize("platform", ["itv_serial", "vtem_modbus"])
def test_topics_types_and_rates_are_those_of_the_documentation(domain, tmp_path, platform):
    """On regulators that are slower than the loop, those behind TCP, and a platform of another rate."""
    file = patient_platform(tmp_path, platform, real_time=False)
    status, output, folder = run(
        tmp_path / "runs", "mode=lockstep", "duration_s=1", "rate_hz=200", f"platform={file}"
    )
    assert status == 0, output
    assert summary(folder)["faults"] == []
    assert summary(folder)["pressure_max_pa"] > 3e3
    with BagReader(folder / "bag") as reader:
        found = {t.name: (t.type, n) for t, n in zip(reader.topics, reader.counts, strict=True)}
    prefix = "/track_circle/"
    for topic, kind, least in (
        ("chambers/command", "sensor_msgs/msg/JointState", 199),
        ("chambers/state", "sensor_msgs/msg/JointState", 199),
        ("chambers/latch", "diagnostic_msgs/msg/DiagnosticStatus", 1),
        ("sensors/pose0", "geometry_msgs/msg/PoseStamped", 99),
        ("arm/state", "sensor_msgs/msg/JointState", 199),
        ("arm/tip", "geometry_msgs/msg/PoseWithCovarianceStamped", 199),
        ("arm/desired/tip", "geometry_msgs/msg/PoseStamped", 199),
        ("arm/covariance", "sensor_msgs/msg/JointState", 199),
        ("arm/learned", "sensor_msgs/msg/JointState", 199),
        ("controller/estimates", "sensor_msgs/msg/JointState", 199),
        ("controller/deviations", "sensor_msgs/msg/JointState", 199),
        ("controller/terms", "sensor_msgs/msg/JointState", 199),
        ("truth/tip", "geometry_msgs/msg/PoseStamped", 201),
    ):
        assert found[prefix + topic][0] == kind
        assert found[prefix + topic][1] >= least, topic
    assert found["/clock"][0] == "rosgraph_msgs/msg/Clock"
    assert "/diagnostics" in found
