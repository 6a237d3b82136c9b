"""The examples: short, and they do what they say."""

import json
import re
import runpy
import sys

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest
import rclpy

from docs.run_notebook import executed
from tests.docs.test_pages import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
# What a word of the output must be; the numbers are those of the model, which other tests check.
PRINTED = {
    "free_swing.py": r"1\.0 s  tip at x +-?0\.00 mm",
    "under_pressure.py": r"30 kPa in chamber 0, 5 g at the tip: x -2\d\.\d\d mm",
    "closed_loop.py": r"0\.99 s  tip error +0\.\d\d mm",
    "read_a_bag.py": r"401  /track_circle/truth/tip  geometry_msgs/msg/PoseStamped",
}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_an_example_has_at_most_40_lines(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 40


@pytest.mark.parametrize("name", PRINTED)
def test_an_example_prints_its_result(name, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "argv", [name, "1"] if name == "closed_loop.py" else [name])
    runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")
    assert re.search(PRINTED[name], capsys.readouterr().out)


def test_the_node_of_the_examples_leads_the_tip_along_the_square():
    module = runpy.run_path(str(ROOT / "examples" / "publish_reference.py"))
    rclpy.init(args=["--ros-args", "-r", "__ns:=/arm_of_the_test"])
    try:
        node, sent = module["Square"](), []
        node.publisher.publish = sent.append
        for _ in range(round(4 * module["SIDE_S"] * module["RATE_HZ"]) + 1):
            node.publish()
        assert node.publisher.topic_name == "/arm_of_the_test/arm/reference/tip"
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    places = [(pose.pose.position.x, pose.pose.position.y) for pose in sent]
    for corner in module["CORNERS_M"]:
        assert min(abs(x - corner[0]) + abs(y - corner[1]) for x, y in places) < 1e-9
    assert places[-1] == pytest.approx(places[0])
    assert {pose.header.frame_id for pose in sent} == {"world"}


def test_every_example_is_tried():
    # A law is tried in tests/soro_core/control/test_laws.py.
    assert {path.name for path in EXAMPLES} == {*PRINTED, "publish_reference.py", "spring_law.py"}


def numbers(text):
    return [float(number) for number in re.findall(r"-?\d+\.\d+", text)]


def printed(cell):
    return "".join("".join(output.get("text", ())) for output in cell["outputs"])


def test_a_figure_that_was_open_before_is_no_picture_of_the_first_cell():
    plt.figure()
    cell = {"cell_type": "code", "source": "print(1)"}
    [found] = executed({"cells": [cell]})["cells"]
    assert [output["output_type"] for output in found["outputs"]] == ["stream"]


def test_the_notebook_prints_what_is_kept_in_it():
    mpl.use("agg")
    kept = json.loads((ROOT / "examples" / "model.ipynb").read_text(encoding="utf-8"))
    again = executed(kept)
    assert sum(cell["cell_type"] == "code" for cell in kept["cells"]) > 5
    for before, after in zip(kept["cells"], again["cells"], strict=True):
        if before["cell_type"] == "code":
            assert re.sub(r"\d", "", printed(after)) == re.sub(r"\d", "", printed(before))
            assert numbers(printed(after)) == pytest.approx(numbers(printed(before)), rel=0.01, abs=2e-3)
            pictures = ["image/png" in output.get("data", {}) for output in before["outputs"]]
            assert pictures == ["image/png" in output.get("data", {}) for output in after["outputs"]]
