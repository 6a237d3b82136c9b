"""The examples: short, and they do what they say."""

import importlib
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
    "own_arm.py": r"8\.47e-04 and 4\.24e-04 N m\^3\nread again: True",
    "shape.py": r"x  135\.70  y   61\.72  z -196\.06 mm",
    "place_the_tip.py": r"x  15\.0 mm: .* missed by 0\.000 mm after [1-9]\d? iterations",
    "pressures_over_time.py": r"tip at the end \[mm\]: \[-?0\. +-?0\. +63\.7\]",
    "fit_two_numbers.py": r"load: 0\.0050\d+ \+- 2e-05, true 0\.005",
    "thousand_variations.py": r"20 of 20 runs are ok\ntip x -1\d\.\d\d mm",
    "estimator_on_csv.py": r"2\.00 s .* ok\nthe tip is 0\.\d\d mm off",
    "part_to_robot.py": r"largest error of a tip that the fit did not see: [0-6]\.\d %",
    "under_pressure.py": r"30 kPa in chamber 0, 5 g at the tip: x -2\d\.\d\d mm",
    "closed_loop.py": r"0\.99 s  tip error +[01]\.\d\d mm",
    "another_truth.py": r"tip error  0\.[0-4]\d mm, Tick\(2\.495 s: .*kPa, \d+% of them at a bound",
    "read_a_bag.py": r"839  /track_circle/truth/tip  geometry_msgs/msg/PoseStamped",
}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_an_example_has_at_most_40_lines(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 40


# Words behind the name; a file is made by the program.
ARGUMENTS = {
    "own_arm.py": ("arm.yaml",),
    "pressures_over_time.py": ("run.png",),
    "thousand_variations.py": ("20",),
    "closed_loop.py": ("1", "loop.png"),
    "another_truth.py": ("3",),
}
SLOW = ("part_to_robot.py",)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in PRINTED]
)
def test_an_example_prints_its_result(name, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(ROOT if name == "read_a_bag.py" else tmp_path)
    words = ARGUMENTS.get(name, ())
    monkeypatch.setattr(sys, "argv", [name, *words])
    runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")
    assert re.search(PRINTED[name], capsys.readouterr().out)
    assert all((tmp_path / word).stat().st_size > 0 for word in words if "." in word)


def test_the_estimator_has_the_step_of_its_file(monkeypatch, tmp_path):
    rows = [f"{0.02 * k},0,0,0,0,0,0.063,0,0,0,1" for k in range(5)]
    (tmp_path / "seen.csv").write_text("\n".join(["head", *rows]))
    monkeypatch.setattr(sys, "argv", ["estimator_on_csv.py", str(tmp_path / "seen.csv")])
    found = runpy.run_path(str(ROOT / "examples" / "estimator_on_csv.py"))
    assert found["dt"] == pytest.approx(0.02)


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


def test_the_page_has_each_program_and_its_python_runs():
    page = (ROOT / "docs/library.md").read_text(encoding="utf-8")
    assert len(re.findall(r"^- \[\w+\.py\]", page, re.M)) == 10
    assert {path.name for path in EXAMPLES} == set(re.findall(r"examples/(\w+\.py)", page))
    scope = {}
    exec(re.search(r"```python\n(.*?)```", page, re.S)[1], scope)
    assert scope["backbone"].shape == (50, 3)
    assert scope["result"].status.ok
    for module, names in re.findall(r"^\| `(soro_\w+(?:\.\w+)*)` \| (.*) \|$", page, re.M):
        found = importlib.import_module(module)
        named = re.findall(r"`(\w+)`", names)
        assert named
        assert [name for name in named if not hasattr(found, name)] == []


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
