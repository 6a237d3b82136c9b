"""The main job in lockstep: real nodes, real topics, real frames on a pseudo-terminal."""

import os
import signal
import time

import pytest

from soro_core.bag import BagReader
from soro_ros.middleware import DELIVERY_S
from tests.ros.running import (
    ClockListener,
    alive,
    child,
    only_run,
    payloads,
    run,
    start_run,
    summary,
)


@pytest.mark.timeout(600)
def test_the_adaptive_controller_tracks_the_circle_on_emulated_valves(domain, tmp_path, figure):
    """The figures of the main job, with adaptation on and off in otherwise the same run."""
    results = {}
    # What learns nothing is after the way up as it stays: the last 5 of 10 s are those of 20 s.
    for adapt, seconds in (("true", 20), ("false", 10)):
        changes = ("mode=lockstep", f"duration_s={seconds}", f"controller.adapt={adapt}")
        status, output, folder = run(tmp_path / adapt, *changes)
        assert status == 0, output
        results[adapt] = summary(folder)
        assert results[adapt]["faults"] == []
        assert results[adapt]["frames_lost"] == 0
        assert results[adapt]["frames_sent"] > 200 * seconds * 4
        assert results[adapt]["pressure_min_pa"] >= -500
        assert results[adapt]["pressure_max_pa"] <= 90.5e3
    on, off = results["true"], results["false"]
    last, first = 1e3 * on["tip_error_last_rms_m"], 1e3 * on["tip_error_first_rms_m"]
    without, estimator = 1e3 * off["tip_error_last_rms_m"], 1e3 * on["estimator_error_last_rms_m"]
    figure(f"main job: tip error RMS {first:.2f} mm at first, {last:.2f} mm in the last 5 s")
    figure(f"main job: {without:.2f} mm in the last 5 s without adaptation")
    figure(f"main job: estimator's tip error RMS {estimator:.2f} mm")
    assert on["tip_error_last_rms_m"] <= 1.5e-3
    assert on["tip_error_last_rms_m"] <= 0.5 * off["tip_error_last_rms_m"]
    assert on["tip_error_last_rms_m"] < on["tip_error_first_rms_m"] < off["tip_error_last_rms_m"]
    assert on["estimator_error_last_rms_m"] <= 1.0e-3


@pytest.mark.parametrize(
    "changes",
    [
        ("platform=", "twin.air=states"),
        ("platform=emulated_canopen", "twin.air=states"),
    ],
    ids=["direct", "behind valves"],
)
def test_a_repeated_lockstep_run_is_the_same_to_the_bit(domain, tmp_path, changes):
    bags = []
    for name in ("first", "second"):
        status, output, folder = run(
            tmp_path / name,
            "mode=lockstep",
            "duration_s=1.5",
            *changes,
            "twin.imu.enabled=true",
        )
        assert status == 0, output
        # Diagnostics carry wall times; the backbone is drawn at a wall-clock rate.
        bags.append(payloads(folder / "bag", without=("/diagnostics", "_event", "/arm/backbone")))
    first, second = bags
    assert first.keys() == second.keys()
    assert len(first["/track_circle/truth/tip"]) == 301  # 1.5 s at 200 Hz, from 0 on
    for topic, messages in first.items():
        # From the first message on; how much of the last tick is heard is a matter of who ends first.
        ticks = min(len(messages), len(second[topic]))
        assert ticks >= max(len(messages), len(second[topic])) - 2, topic
        assert messages[:ticks] == second[topic][:ticks], topic
    assert len(set(first["/track_circle/sensors/pose0"])) > 100


@pytest.mark.timeout(120)
def test_what_a_node_published_before_it_ended_is_in_the_bag(domain, tmp_path):
    """A recorder that is held up hears the rest of a run, for no node ends before its readers have it all."""
    clock = ClockListener()
    process = start_run(tmp_path, "mode=lockstep", "duration_s=3", "platform=")
    try:
        # Not longer: a node that says nothing for 8 s ends the run.
        clock.wait(1.5, 60)
        controller, recorder = (child(process.pid, f"nodes.{name}") for name in ("controller", "recorder"))
        os.kill(recorder, signal.SIGSTOP)
        clock.wait(3.0, 60)
        clock.close()
        # Half of the time that a node waits for its readers: one that does not wait is gone by then.
        deadline = time.monotonic() + DELIVERY_S / 2
        while alive(controller) and time.monotonic() < deadline:
            time.sleep(0.02)
        os.kill(recorder, signal.SIGCONT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 0, out + err
    found = payloads(only_run(tmp_path) / "bag")
    assert len(found["/clock"]) == 601
    assert len(found["/track_circle/truth/tip"]) == 601
    assert len(found["/track_circle/chambers/command"]) >= 600


@pytest.mark.parametrize("platform", ["itv_serial", "veab_tcp"])
def test_topics_types_and_rates_are_those_of_the_documentation(domain, tmp_path, platform):
    """On regulators that are slower than the loop, and on those behind TCP."""
    status, output, folder = run(tmp_path, "mode=lockstep", "duration_s=1", f"platform={platform}")
    assert status == 0, output
    assert summary(folder)["faults"] == []
    assert summary(folder)["pressure_max_pa"] > 3e3
    with BagReader(folder / "bag") as reader:
        found = {t.name: (t.type, n) for t, n in zip(reader.topics, reader.counts, strict=True)}
    prefix = "/track_circle/"
    for topic, kind, least in (
        ("chambers/command", "sensor_msgs/msg/JointState", 199),
        ("chambers/state", "sensor_msgs/msg/JointState", 199),
        ("sensors/pose0", "geometry_msgs/msg/PoseStamped", 99),
        ("arm/state", "sensor_msgs/msg/JointState", 199),
        ("arm/tip", "geometry_msgs/msg/PoseWithCovarianceStamped", 199),
        ("arm/desired/tip", "geometry_msgs/msg/PoseStamped", 199),
        ("controller/estimates", "sensor_msgs/msg/JointState", 199),
        ("truth/tip", "geometry_msgs/msg/PoseStamped", 201),
    ):
        assert found[prefix + topic][0] == kind
        assert found[prefix + topic][1] >= least, topic
    assert found["/clock"][0] == "rosgraph_msgs/msg/Clock"
    assert "/diagnostics" in found
