"""`soro identify-fem` from a coarse part to a robot file, a report and an exit status."""

import csv
import json
import re
import shutil

import numpy as np
import pytest
import typer
import yaml
from typer.testing import CliRunner

from soro_core.config import with_changes
from soro_core.errors import ConfigError
from soro_core.robot import load_robot
from soro_core.twin import Twin
from soro_design.commands.fem import app as fem
from soro_design.commands.identify_fem import identify_fem
from soro_design.robot_of_part import joint
from soro_lab.identification.fit import fit
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of
from soro_ros.recordings.report import summarise
from soro_ros.recordings.verdict import judge
from soro_ros.study.closed_loop import run_in_process
from tests.soro_design.fem.small_parts import ROD, TUBE, written

app = typer.Typer()
app.add_typer(fem, name="fem")
app.command("identify-fem")(identify_fem)
HOOPS = {"stiffness_n": 8.0, "spacing_m": 3e-3}
WOUND = {**ROD, "geometry": {**ROD["geometry"], "hoops": HOOPS}}
SWEEPS = [
    {"name": "pull", "force_n": [0.0, 0.0, 3.0], "states": 4},
    {"name": "side", "force_n": [0.02, 0.0, 0.0], "states": 1},
    {"name": "all", "pressures_pa": [15e3, 15e3, 15e3], "states": 4},
    {"name": "one", "pressures_pa": [12e3, 0.0, 0.0], "states": 4},
    {"name": "mixed", "pressures_pa": [6e3, 10e3, 0.0], "states": 1, "held_out": True},
]


def call(*arguments):
    return CliRunner().invoke(app, [str(one) for one in arguments], env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A part, the folder of its run, and the first call of the command."""
    folder = tmp_path_factory.mktemp("part")
    part = written(folder, WOUND, sweeps=SWEEPS, viscosity_pa_s=100.0)
    out = folder / "arm.yaml"
    done = call("identify-fem", part, "--out", out, "--report", folder / "report")
    return folder, part, out, done


@pytest.mark.slow
def test_a_part_becomes_a_robot_file_that_moves_like_it(made):
    _, _, out, done = made
    assert done.exit_code == 0, done.output
    robot = load_robot(out)
    link = robot.links[0]
    assert (robot.name, robot.n_u, link.length) == ("arm", 3, 0.06)
    assert robot.pressure_range_pa == (0.0, 15e3)
    # 3 eta A L, of the area of rubber.
    assert link.damping[0] == pytest.approx(3.0 * 100.0 * 3.016e-4 * 0.06, rel=1e-3)
    assert link.mass == pytest.approx(1.9e-2, rel=0.01)
    found = re.search(r"length: .*greatest ([\d.]+) fitted, mean [\d.]+, greatest ([\d.]+) held", done.output)
    fitted, held_out = found.groups()
    assert 0.0 < float(fitted) < 1.0
    assert 0.0 < float(held_out) < 1.0
    assert "Mesh: " in done.output
    # What it asks of its material stands in the file too.
    assert re.search(r"# Greatest stretch of an element: 1\.\d+ in sweep (all|one|pull); ", out.read_text())


@pytest.mark.slow
def test_its_scene_runs_good_as_it_is_written(made):
    """No pressure of the end is at a bound: the reference is within reach of the sweeps."""
    _, _, out, _ = made
    scene = load_scene(out.with_name("arm_scene.yaml"))
    assert (scene.mode, scene.loaded_robot.name) == ("lockstep", "arm")
    assert scene.controller.reference.kind == "circle"
    short = with_changes(scene, duration_s=8.0)
    recording, end = run_in_process(short)
    summary = summarise(recording, short)
    assert str(judge(summary, short, end, recording)) == "good"
    assert summary.saturated_last_part == 0.0
    assert 15e3 > summary.pressure_max_pa > 7.5e3


def test_errors_are_told_over_the_motion_too(made):
    """That of the one held-out state, whose tip the table of the sweeps has."""
    folder, _, _, done = made
    content = json.loads((folder / "report" / "report.json").read_text(encoding="utf-8"))
    with (folder / "arm_fem" / "table.csv").open(encoding="utf-8") as stream:
        row = next(row for row in csv.DictReader(stream) if row["sweep"] == "mixed")
    motion = np.linalg.norm([float(row[f"tip_{axis}_m"]) for axis in "xyz"] - np.array([0.0, 0.0, 0.06]))
    error = content["errors"]["held_out"]
    assert error["most_of_motion"] == pytest.approx(error["most"] * 0.06 / motion, rel=1e-6)
    assert f"{100.0 * error['most_of_motion']:.2f} held out" in done.output.split("its motion")[1]
    mesh, page = content["mesh"], (folder / "report" / "index.html").read_text(encoding="utf-8")
    assert mesh["of_motion"] == pytest.approx(mesh["error"] / mesh["motion"], rel=1e-9)
    # The verdict of the page has all four.
    for share in (error["most"], error["most_of_motion"], mesh["error"], mesh["of_motion"]):
        assert f"{100.0 * share:.2g} %" in page


@pytest.mark.slow
def test_the_mesh_counts_in_the_verdict(made, tmp_path):
    """A limit between the error of the link and that with the mesh."""
    folder, part, _, _ = made
    content = json.loads((folder / "report" / "report.json").read_text(encoding="utf-8"))
    limit = 100.0 * (content["errors"]["held_out"]["most"] + 0.5 * content["mesh"]["error"])
    call_ = ("identify-fem", part, "--run", folder / "arm_fem", "--accept", limit)
    without = call(*call_, "--out", tmp_path / "a.yaml", "--no-mesh-check")
    checked = call(*call_, "--out", tmp_path / "b.yaml")
    assert (without.exit_code, checked.exit_code) == (0, 1)
    assert "the mesh by some" in checked.output.split("not accepted")[1]
    assert (tmp_path / "a_scene.yaml").is_file()
    assert not (tmp_path / "b_scene.yaml").exists()


@pytest.mark.slow
def test_chambers_that_balloon_are_no_link(tmp_path):
    """Without hoops walls bulge and pull the rod short: an area that grows with the length cannot do that."""
    out = tmp_path / "arm.yaml"
    done = call("identify-fem", written(tmp_path, ROD, sweeps=SWEEPS), "--out", out, "--no-mesh-check")
    assert done.exit_code == 1
    assert "not accepted: " in done.output
    assert "area_m2" in done.output.split("not accepted: ")[1]
    assert out.is_file()


@pytest.mark.slow
def test_the_tip_follows_a_circle_under_control(made, tmp_path):
    _, _, out, _ = made
    circle = {"kind": "circle", "period_s": 4.0, "curvature_per_m": 0.7}
    reference = {**circle, "choose_elongation": True, "mean_pressure_pa": 7e3}
    scene = {"robot": str(out), "platform": "", "mode": "lockstep", "controller": {"reference": reference}}
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(scene), encoding="utf-8")
    loaded = load_scene(path)
    loop, twin = loop_of(loaded), Twin(loaded.loaded_robot, loaded.twin_node())
    ticks = list(loop.run(twin, round(3.0 * loaded.rate_hz), 1.0 / loaded.rate_hz))
    far = [np.linalg.norm(t.seen.tip[:3, 3] - t.command.tip_reference[:3, 3]) for t in ticks]
    assert np.sqrt(np.mean(np.square(far[-round(loaded.rate_hz) :]))) < 0.005 * 0.06
    # The radius of the circle is four times that.
    sides = np.array([t.seen.tip[:2, 3] for t in ticks[-round(loaded.rate_hz) :]])
    assert np.hypot(*sides.T).min() > 0.3 * 0.7 * 0.06**2


def test_the_report_needs_no_network_and_has_the_numbers(made):
    folder, _, out, _ = made
    page = (folder / "report" / "index.html").read_text(encoding="utf-8")
    content = json.loads((folder / "report" / "report.json").read_text(encoding="utf-8"))
    assert not re.findall(r'(?:src|href)="(?:https?:)?//', page)
    assert page.count("data:image/svg+xml") == 3
    assert len(list((folder / "report" / "pictures").iterdir())) == 3
    law = yaml.safe_load(out.read_text(encoding="utf-8"))["links"][0]["k_b"]
    assert law[0] - law[1] == pytest.approx(content["numbers"]["k_b_rest"], rel=1e-5)
    assert content["mesh"]["coarse_elements"] < content["mesh"]["elements"]
    # Plugs are stiff: shape functions that know them keep more than constant strains.
    assert content["modes"][2][0]["strain"] < content["modes"][0][0]["strain"] / 3.0


@pytest.mark.slow
def test_what_exists_is_refused_and_a_run_is_used_again(made, tmp_path):
    folder, part, out, _ = made
    old = ("--run", folder / "arm_fem", "--no-mesh-check")
    again = call("identify-fem", part, "--out", out, *old)
    assert isinstance(again.exception, ConfigError)
    assert again.exception.key == "--out"
    shutil.copy(out.with_name("arm_scene.yaml"), tmp_path / "new_scene.yaml")
    again = call("identify-fem", part, "--out", tmp_path / "new.yaml", *old)
    assert str(again.exception.got).endswith("new_scene.yaml")
    text = out.read_text(encoding="utf-8")
    strict = call("identify-fem", part, "--out", out, *old, "--force", "--accept", 0.0)
    assert strict.exit_code == 1
    assert "not accepted" in strict.output
    body = [line for line in text.splitlines() if not line.startswith("#")]
    assert [line for line in out.read_text(encoding="utf-8").splitlines() if not line.startswith("#")] == body
    other = written(tmp_path, WOUND, sweeps=SWEEPS)
    refused = call("identify-fem", other, "--out", tmp_path / "x.yaml", "--run", folder / "arm_fem")
    assert isinstance(refused.exception, ConfigError)
    assert not (tmp_path / "x.yaml").exists()


def test_modes_stand_beside_the_robot_file(made, tmp_path, monkeypatch):
    folder, part, _, _ = made
    # Which files there are does not depend on how good the fit is.
    monkeypatch.setattr(
        joint, "fit", lambda unknown, residuals, *_, **__: fit(unknown, residuals, "linear", 1)
    )
    out = tmp_path / "arm.yaml"
    done = call(
        "identify-fem", part, "--out", out, "--run", folder / "arm_fem", "--modes", 1, "--no-mesh-check"
    )
    assert done.exit_code == 0, done.output
    assert load_robot(out).coordinate_names == (
        "link0/elongation_0",
        "link0/bending_x_0",
        "link0/bending_y_0",
    )
    assert {path.name for path in tmp_path.glob("*.npy")} == {"arm_elongation.npy", "arm_bending.npy"}


@pytest.mark.parametrize(
    ("part", "changes", "key"),
    [(TUBE, {}, "geometry.kind"), (ROD, {"sweeps": SWEEPS[:1]}, "sweeps")],
)
def test_what_makes_no_robot(tmp_path, part, changes, key):
    done = call("identify-fem", written(tmp_path, part, **changes), "--out", tmp_path / "x.yaml")
    assert isinstance(done.exception, ConfigError)
    assert done.exception.key == key
    assert [path.name for path in tmp_path.iterdir()] == ["part.yaml"]
