"""Parts of two and four chambers, tapered, with tendons: which become robots that run, and which do not."""

import copy
import re

import pytest
import typer
from typer.testing import CliRunner

from soro_core.config import with_changes
from soro_core.errors import ConfigError
from soro_core.robot import load_robot
from soro_design.commands.identify_fem import identify_fem
from soro_design.parts.file import load_part
from soro_lab.scene import load_scene
from soro_ros.recordings.report import summarise
from soro_ros.recordings.verdict import judge
from soro_ros.study.closed_loop import run_in_process
from tests.soro_design.fem.small_parts import ROD, written

app = typer.Typer()
app.command()(identify_fem)
NARROW = {"chamber_radius_m": 0.0035, "chamber_offset_m": 0.0075}
TENDON = {"along_m": [[0.0105, 0.0, 0.0], [0.0105, 0.0, 0.06]]}


def identified(folder, chambers, tendons=(), **geometry):
    """Identify a coarse rod; return the call and the robot file."""
    part = copy.deepcopy(ROD)
    part["geometry"] |= {"chambers": chambers, "hoops": {"stiffness_n": 8.0, "spacing_m": 3e-3}, **geometry}
    idle = [0.0] * (chambers - 2)
    sweeps = [
        {"name": "pull", "force_n": [0.0, 0.0, 3.0], "states": 3},
        {"name": "side", "force_n": [0.02, 0.0, 0.0], "states": 1},
        {"name": "all", "pressures_pa": [15e3] * chambers, "states": 3},
        {"name": "one", "pressures_pa": [12e3, 0.0, *idle], "states": 3},
        {"name": "mixed", "pressures_pa": [6e3, 10e3, *idle], "states": 1, "held_out": True},
    ]
    file = written(folder, part, sweeps=sweeps, viscosity_pa_s=100.0, tendons=list(tendons))
    out = folder / "arm.yaml"
    done = CliRunner().invoke(app, [str(file), "--out", str(out), "--no-mesh-check"], env={"COLUMNS": "200"})
    return done, out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("chambers", "geometry", "kind"),
    [(2, {}, "set_point"), (4, {**NARROW, "taper": 0.7}, "circle")],
    ids=["two", "four, tapered"],
)
def test_their_scenes_run_good(tmp_path, chambers, geometry, kind):
    """Two chambers bend in one plane alone, so that the tip goes to a place."""
    done, out = identified(tmp_path, chambers, **geometry)
    assert done.exit_code == 0, done.output
    assert load_robot(out).n_u == chambers
    scene = with_changes(load_scene(out.with_name("arm_scene.yaml")), duration_s=8.0)
    assert scene.controller.reference.kind == kind
    recording, end = run_in_process(scene)
    assert str(judge(summarise(recording, scene), scene, end, recording)) == "good"


@pytest.mark.slow
def test_a_pneunet_becomes_a_link_that_bends_and_its_scene_runs_good(tmp_path):
    """Sweeps that judge it have forces across that no fit has seen."""
    part = load_part("silicone_pneunet")
    part = with_changes(part, geometry=with_changes(part.geometry, chambers=3, across=1))
    out = tmp_path / "finger.yaml"
    data = part.model_dump(mode="json", exclude_unset=True, exclude={"name"})
    file = written(tmp_path, data)
    done = CliRunner().invoke(app, [str(file), "--out", str(out), "--no-mesh-check"], env={"COLUMNS": "200"})
    assert done.exit_code == 0, done.output
    robot = load_robot(out)
    assert (robot.n_u, robot.n_q) == (1, 1)
    assert robot.links[0].chambers[0].area_m2 == pytest.approx(12.8e-3 * 11.4e-3)
    held_out = re.search(r"length: .* fitted, mean ([\d.]+), greatest ([\d.]+) held", done.output)
    mean, greatest = (float(share) for share in held_out.groups())
    assert 0.0 < mean < 2.0
    assert mean < greatest < 4.0
    scene = with_changes(load_scene(tmp_path / "finger_scene.yaml"), duration_s=8.0)
    recording, end = run_in_process(scene)
    assert str(judge(summarise(recording, scene), scene, end, recording)) == "good"


@pytest.mark.slow
def test_a_tendon_on_one_side_is_no_link_and_is_named(tmp_path):
    """Its tip is off by little of the length, and by half of the motion."""
    done, out = identified(tmp_path, 3, [{**TENDON, "stiffness_n": 20.0}])
    assert done.exit_code == 1
    refused = done.output.split("not accepted: ")[1]
    assert "% of its motion; a tendon with stiffness_n on one side bends it" in " ".join(refused.split())
    assert not out.with_name("arm_scene.yaml").exists()


@pytest.mark.slow
def test_a_tendon_that_slides_is_no_load_of_a_link(tmp_path):
    done, _ = identified(tmp_path, 3, [TENDON])
    assert done.exit_code == 0, done.output


def test_a_sweep_of_tendons_is_refused_before_it_is_computed(tmp_path):
    drawn = [{"name": "drawn", "tensions_n": [0.3]}]
    part = written(tmp_path, ROD, tendons=[TENDON], sweeps=drawn)
    done = CliRunner().invoke(app, [str(part), "--out", str(tmp_path / "arm.yaml")])
    assert isinstance(done.exception, ConfigError)
    assert "gives a robot chambers alone" in str(done.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["part.yaml"]
