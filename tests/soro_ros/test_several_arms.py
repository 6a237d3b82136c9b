"""Several arms in one run: a tick for all, one bag, a verdict by arm; shared valves vent them all."""

import numpy as np
import pytest

from soro_lab.bag import BagReader
from soro_ros.recordings.recording import arms, read
from tests.patience import patient_platform
from tests.soro_ros.running import payloads, run, summary

FINGERS = ("thumb", "index", "middle")
SCENE = "three_fingers"


@pytest.mark.process
def test_a_fault_of_one_finger_vents_all_that_share_its_air(domain, tmp_path):
    platform = patient_platform(tmp_path, real_time=False, name="emulated_three_fingers")
    fault = "faults=[{at: 1.5, fault: burst, chamber: index/link0/chamber1}]"
    changes = ("mode=lockstep", "duration_s=3", f"platform={platform}", fault)
    status, output, folder = run(tmp_path / "runs", *changes, scene=SCENE)
    assert status == 1, output
    figures = summary(folder)
    assert (figures["verdict"], list(figures["arms"])) == ("vented", list(FINGERS))
    assert {one["verdict"] for one in figures["arms"].values()} == {"vented"}
    assert all("index/link0/chamber1" in one["reason"] for one in figures["arms"].values())
    with BagReader(folder / "bag") as reader:
        assert arms(reader) == tuple(sorted(f"{SCENE}/{name}" for name in FINGERS))
    recordings = {name: read(folder / "bag", f"{SCENE}/{name}") for name in FINGERS}
    clock = payloads(folder / "bag")["/clock"]
    for name, recording in recordings.items():
        (trip,) = (event.t_s for event in recording.events if event.kind == "trip")
        assert 1.5 < trip < 2.5, name
        pressed_s = recording.reading.t[np.any(np.abs(recording.reading.value) >= 5e3, axis=1)][-1]
        assert trip - 0.2 < pressed_s < trip + 1.0, name  # the arm of the burst is nearly empty before it
        assert recording.faults == recordings["thumb"].faults
        assert len(recording.reading.t) <= len(clock)
        # Each at its place, on its own reference.
        assert np.abs(recording.true_tip.value[0] - recording.wanted_tip.value[0]).max() < 5e-3, name
    places = [recording.true_tip.value[0] for recording in recordings.values()]
    apart = [np.linalg.norm(places[k] - places[k - 1]) for k in range(3)]
    assert np.allclose(apart, 0.052, atol=2e-3)


@pytest.mark.process
def test_arms_without_valves_share_their_time(domain, tmp_path):
    """Two arms of a scene of one's own; the run of one of them alone has the same numbers, to the bit."""
    scene = tmp_path / "pair.yaml"
    scene.write_text(
        "mode: lockstep\nduration_s: 1.0\ncontroller: {reference: {curvature_per_m: 6.0}}\n"
        "arms:\n  left: {base_position: [-0.1, 0.0, 0.0]}\n  right: {seed: 1}\n"
    )
    alone = tmp_path / "alone.yaml"
    alone.write_text("mode: lockstep\nduration_s: 1.0\ncontroller: {reference: {curvature_per_m: 6.0}}\n")
    _, output, folder = run(tmp_path / "pair", "rate_hz=100", scene=str(scene))
    assert summary(folder)["verdict"] == "good", output
    _, output, other = run(tmp_path / "alone", "rate_hz=100", scene=str(alone))
    assert summary(other)["verdict"] == "good", output
    both, one = payloads(folder / "bag"), payloads(other / "bag")
    for topic in ("truth/state", "truth/chambers", "chambers/state", "arm/covariance"):
        found, wanted = both[f"/pair/right/{topic}"], one[f"/alone/{topic}"]
        ticks = min(len(found), len(wanted))  # time goes on until the last arm is empty
        assert ticks >= 100
        assert found[:ticks] == wanted[:ticks], topic
        assert len(both[f"/pair/left/{topic}"]) == len(found)
