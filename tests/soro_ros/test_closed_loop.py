"""The main job in lockstep: real nodes, real topics, real frames on a pseudo-terminal."""

import os
import signal
import time

import numpy as np
import pytest

from soro_lab.bag import BagReader
from soro_lab.identification.recording import Place, read_bag
from soro_lab.scene import load_scene
from soro_ros.host.middleware import DELIVERY_S
from soro_ros.recordings.recording import read
from tests.patience import COMPILED_S, LIMIT_S, patient_platform
from tests.soro_ros.conftest import own_domain
from tests.soro_ros.in_process import lockstep
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


@pytest.mark.process
def test_the_controller_tracks_the_circle_on_emulated_valves(domain, tmp_path, figure):
    """The figures of the main job, with adaptation on and off in otherwise the same run."""
    results = {}
    platform = patient_platform(tmp_path, real_time=False)
    # What learns nothing is after the way up as it stays: its last 5 s are those of a longer run.
    for adapt, seconds in (("true", 11), ("false", 8)):
        changes = (
            "mode=lockstep",
            f"platform={platform}",
            f"duration_s={seconds}",
            f"controller.adapt={adapt}",
        )
        status, output, folder = run(tmp_path / adapt, *changes)
        # More than a tenth of the length away from the circle is lost.
        assert status == {"true": 0, "false": 1}[adapt], output
        results[adapt] = summary(folder)
        assert results[adapt]["faults"] == []
        assert results[adapt]["frames_lost"] == 0
        assert results[adapt]["frames_sent"] > 200 * seconds * 4
        assert results[adapt]["pressure_min_pa"] >= -500
        assert results[adapt]["pressure_max_pa"] <= 90.5e3
    on, off = results["true"], results["false"]
    assert (on["verdict"], off["verdict"]) == ("good", "lost")
    assert f"{1e3 * off['tip_error_last_rms_m']:.1f} mm" in off["reason"]
    last, first = 1e3 * on["tip_error_last_rms_m"], 1e3 * on["tip_error_first_rms_m"]
    without, estimator = 1e3 * off["tip_error_last_rms_m"], 1e3 * on["estimator_error_last_rms_m"]
    figure(f"main job: tip error RMS {first:.2f} mm at first, {last:.2f} mm in the last 5 s")
    figure(f"main job: {without:.2f} mm in the last 5 s without adaptation")
    figure(f"main job: estimator's tip error RMS {estimator:.2f} mm")
    assert on["tip_error_last_rms_m"] <= 0.3e-3
    assert on["tip_error_last_rms_m"] <= 0.5 * off["tip_error_last_rms_m"]
    assert on["tip_error_last_rms_m"] < on["tip_error_first_rms_m"] < off["tip_error_last_rms_m"]
    assert on["estimator_error_last_rms_m"] <= 1.0e-3


SHORT = (
    "mode=lockstep",
    "duration_s=1.5",
    "twin.air=states",
    "twin.imu.enabled=true",
    "twin.pose.locations=[1.0, 0.5]",
)
TICKS = 301  # 1.5 s at 200 Hz, from 0 on


@pytest.fixture(scope="module")
def held_up(tmp_path_factory):
    """The folder of a short run without valves whose recorder stood still for its second half."""
    folder = tmp_path_factory.mktemp("held_up")
    with own_domain(tmp_path_factory.mktemp("state")):
        clock = ClockListener()
        process = start_run(folder, "platform=", *SHORT)
        try:
            # Not longer: a node that says nothing for 8 s ends the run.
            clock.wait(0.7, COMPILED_S)
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
    assert len(found["/clock"]) == TICKS
    assert len(found["/track_circle/truth/tip"]) == TICKS
    assert len(found["/track_circle/chambers/command"]) >= TICKS - 1
    assert found["/track_circle/chambers/latch"]


@pytest.mark.process
@pytest.mark.parametrize("valves", [False, True], ids=["direct", "behind valves"])
def test_a_repeated_lockstep_run_is_the_same_to_the_bit(domain, tmp_path, request, valves):
    """Whatever the recorder did meanwhile."""
    platform = patient_platform(tmp_path, real_time=False) if valves else ""
    folders = [] if valves else [request.getfixturevalue("held_up")]
    while len(folders) < 2:
        status, output, folder = run(tmp_path / f"run{len(folders)}", f"platform={platform}", *SHORT)
        assert status == 0, output
        folders.append(folder)
    # Diagnostics carry wall times; nothing waits for a reader of the backbone; the latch names the devices,
    # whose path is another one in each run.
    without = ("/diagnostics", "_event", "/arm/backbone", "/chambers/latch")
    first, second = (payloads(folder / "bag", without=without) for folder in folders)
    assert first.keys() == second.keys()
    assert len(first["/track_circle/truth/tip"]) == TICKS
    for topic, messages in first.items():
        # From the first message on; how much of the last tick is heard is a matter of who ends first.
        ticks = min(len(messages), len(second[topic]))
        assert ticks >= max(len(messages), len(second[topic])) - 2, topic
        assert messages[:ticks] == second[topic][:ticks], topic
    for topic in ("pose0", "pose1"):
        assert len(set(first[f"/track_circle/sensors/{topic}"])) > 100


def test_the_nodes_compute_what_one_process_computes(held_up):
    """To the bit: topics, processes and their order change no number."""
    scene = load_scene(held_up / "scene_used.yaml")
    recorded = read(held_up / "bag", scene.name)
    steps = list(lockstep(scene, TICKS))
    for series, name, first in (
        (recorded.true_state, "true_q", 0),
        (recorded.estimated_state, "q", 1),
        (recorded.command, "setpoint_pa", 1),
    ):
        expected = np.array([getattr(step, name) for step in steps[first:]])
        assert len(series.value) >= TICKS - 2
        np.testing.assert_array_equal(series.value, expected[: len(series.value)], err_msg=name)
    assert np.ptp(recorded.command.value) > 10e3


def test_the_run_is_a_recording_for_identification(held_up):
    """Every sensor with the place that its scene states; the readings are those that ROS reads."""
    found = read_bag(held_up, load_scene(held_up / "scene_used.yaml").loaded_robot)
    assert [(plate.name, plate.place) for plate in found.plates] == [
        ("sensors/pose0", Place(0)),
        ("sensors/pose1", Place(0, 0.032)),
    ]
    assert [(imu.name, imu.place) for imu in found.imus] == [("sensors/imu0", Place(0))]
    recorded = read(held_up / "bag", "track_circle")
    pose, first_s = recorded.measured_tip, recorded.reading.t[0]
    np.testing.assert_array_equal(found.plates[0].position, pose.value)
    np.testing.assert_allclose(found.plates[0].t, pose.t - first_s, atol=1e-9)
    fresh = np.concatenate([[True], (np.diff(recorded.reading.value, axis=0) != 0.0).any(axis=1)])
    np.testing.assert_array_equal(found.pressure.values, recorded.reading.value[fresh])
    assert np.linalg.norm(found.imus[0].accel, axis=1).mean() == pytest.approx(9.81, abs=0.5)
    assert found.notes == ()


@pytest.mark.process
@pytest.mark.parametrize("platform", ["itv_serial", "veab_tcp", "vtem_modbus"])
def test_topics_types_and_rates_are_those_of_the_documentation(domain, tmp_path, platform):
    """On regulators that are slower than the loop, those behind TCP, and a platform of another rate."""
    file = patient_platform(tmp_path, platform, real_time=False)
    status, output, folder = run(tmp_path / "runs", "mode=lockstep", "duration_s=1", f"platform={file}")
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
        ("arm/covariance", "std_msgs/msg/Float64MultiArray", 199),
        ("arm/learned", "std_msgs/msg/Float64MultiArray", 199),
        ("controller/estimates", "sensor_msgs/msg/JointState", 199),
        ("controller/deviations", "sensor_msgs/msg/JointState", 199),
        ("controller/terms", "sensor_msgs/msg/JointState", 199),
        ("truth/tip", "geometry_msgs/msg/PoseStamped", 201),
    ):
        assert found[prefix + topic][0] == kind
        assert found[prefix + topic][1] >= least, topic
    assert found["/clock"][0] == "rosgraph_msgs/msg/Clock"
    assert "/diagnostics" in found
