"""What a whole run shows of wiring and chambers, where no probe came before it and the law names nothing."""

import re

import pytest
import yaml

from benchmarks import mismatched_arms
from benchmarks.judged_loop import outcome
from soro_core.config import find_config, read_yaml, with_changes
from soro_lab.scene import load_scene


def plant(folder, change):
    """A file of the standing arm with other chambers."""
    robot = read_yaml(find_config("tue_three_bellow", "robots"))
    link = robot["links"][0]
    link["chambers"] = change(link["chambers"])
    file = folder / "plant.yaml"
    file.write_text(yaml.safe_dump(robot))
    return str(file)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda all_: [all_[0], all_[2], all_[1]], "swapped: link0/chamber1 acts as link0/chamber2"),
        (lambda all_: [*all_[1:], all_[0]], "rotated: link0/chamber0 acts as link0/chamber1"),
    ],
    ids=["swapped", "rotated"],
)
def test_a_run_with_other_wiring_is_lost_and_its_cause_named(tmp_path, change, words):
    keys = {"mode": "lockstep", "platform": "", "duration_s": 8, "twin.payload_kg": 0.0, "twin.refine": 1}
    found = outcome(load_scene("track_circle", {**keys, "twin.plant": plant(tmp_path, change)})).verdict
    assert found.word == "lost"
    assert f"probable cause: chambers are {words}" in found.reason
    assert "next: swap the tubes" in found.reason


@pytest.mark.slow
def test_uneven_chambers_that_the_law_does_not_name_are_the_cause(tmp_path):
    """A standing arm that they hold on one side: to a law without a probe this looks like a force."""
    one = mismatched_arms.scene_of(mismatched_arms.drawn(3), 3, tmp_path)
    control = with_changes(one.controller, probe_at_enable="off")
    found = outcome(with_changes(one, controller=control)).verdict
    assert found.word in ("poor", "lost")
    (ratio,) = re.findall(r"gives ([\d.]+) of the force", found.reason)
    first, second, strong = mismatched_arms.drawn(3).gain
    assert "probable cause: link0/chamber2 gives" in found.reason
    assert float(ratio) == pytest.approx(2.0 * strong / (first + second), abs=0.3)
