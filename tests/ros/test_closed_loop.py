"""The main job in lockstep: real nodes, real topics, real frames on a pseudo-terminal."""

import pytest

from soro_core.bag import BagReader
from tests.ros.running import payloads, run, summary


@pytest.mark.timeout(600)
def test_the_adaptive_controller_tracks_the_circle_on_emulated_valves(domain, tmp_path, figure):
    """The figures of the main job, with adaptation on and off in otherwise the same run."""
    results = {}
    for adapt in ("true", "false"):
        status, output, folder = run(tmp_path / adapt, "mode=lockstep", f"controller.adapt={adapt}")
        assert status == 0, output
        results[adapt] = summary(folder)
        assert results[adapt]["faults"] == []
        assert results[adapt]["frames_lost"] == 0
        assert results[adapt]["frames_sent"] > 4000 * 4
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
    assert on["tip_error_last_rms_m"] < on["tip_error_first_rms_m"]
    assert on["estimator_error_last_rms_m"] <= 1.0e-3


@pytest.mark.parametrize("platform", ["emulated_canopen", ""], ids=["valves", "direct"])
def test_a_repeated_lockstep_run_is_the_same_to_the_bit(domain, tmp_path, platform):
    bags = []
    for name in ("first", "second"):
        status, output, folder = run(
            tmp_path / name,
            "mode=lockstep",
            "duration_s=1.5",
            f"platform={platform}",
            "twin.imu.enabled=true",
        )
        assert status == 0, output
        # Diagnostics carry wall times; the backbone is drawn at a wall-clock rate.
        bags.append(payloads(folder / "bag", without=("/diagnostics", "_event", "/arm/backbone")))
    first, second = ({topic: by_stamp(messages) for topic, messages in bag.items()} for bag in bags)
    assert first.keys() == second.keys()
    assert len(first["/track_circle/truth/tip"]) >= 250  # 1.5 s at 200 Hz; a recorder may join late
    for topic, messages in first.items():
        # Every stamp that both recorders have heard; what follows the last tick is not a part of the run.
        common = messages.keys() & second[topic].keys()
        assert len(common) >= 0.5 * min(len(messages), 301), topic
        assert all(messages[stamp] == second[topic][stamp] for stamp in common), topic
    assert len(set(first["/track_circle/sensors/pose0"].values())) > 100


def by_stamp(messages: list[bytes]) -> dict[bytes, bytes]:
    """Messages by the stamp that each begins with (after four bytes of encapsulation)."""
    return {data[4:12]: data for data in messages}


def test_topics_types_and_rates_are_those_of_the_documentation(domain, tmp_path):
    status, output, folder = run(tmp_path, "mode=lockstep", "duration_s=1")
    assert status == 0, output
    with BagReader(folder / "bag") as reader:
        found = {t.name: (t.type, n) for t, n in zip(reader.topics, reader.counts, strict=True)}
    prefix = "/track_circle/"
    for topic, kind, least in (
        ("chambers/command", "sensor_msgs/msg/JointState", 150),
        ("chambers/state", "sensor_msgs/msg/JointState", 150),
        ("sensors/pose0", "geometry_msgs/msg/PoseStamped", 70),
        ("arm/state", "sensor_msgs/msg/JointState", 150),
        ("arm/tip", "geometry_msgs/msg/PoseWithCovarianceStamped", 150),
        ("arm/desired/tip", "geometry_msgs/msg/PoseStamped", 150),
        ("controller/estimates", "sensor_msgs/msg/JointState", 150),
        ("truth/tip", "geometry_msgs/msg/PoseStamped", 150),
    ):
        assert found[prefix + topic][0] == kind
        assert found[prefix + topic][1] >= least, topic
    assert found["/clock"][0] == "rosgraph_msgs/msg/Clock"
    assert "/diagnostics" in found
