"""`soro design`: run, Ctrl-C and --resume, check, export; and what they refuse."""

import json

import numpy as np
import pytest
import yaml
from PIL import Image
from typer.testing import CliRunner

from soro_core.config import config_folder
from soro_core.errors import ConfigError, ModelError
from soro_design.commands import design
from soro_design.fem import read_stl
from soro_design.fem.meshes.surface import is_closed, volume
from soro_design.topology.domain import analysis, make_domain
from soro_design.topology.task import load_task
from soro_ros.cli import application
from tests.soro_design.topology.small import bellow


@pytest.fixture
def soro(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    task = json.loads(bellow().model_dump_json(exclude_none=True))
    (tmp_path / "small.yaml").write_text(yaml.safe_dump(task))
    return lambda *arguments: CliRunner().invoke(application(), ["design", *arguments])


@pytest.mark.slow
def test_a_run_is_interrupted_resumed_checked_and_exported(soro, tmp_path, monkeypatch):
    line = design._line

    def interrupted(state):
        if len(state.rows) == 3:
            raise KeyboardInterrupt
        return line(state)

    with monkeypatch.context() as patch:
        patch.setattr(design, "_line", interrupted)
        stopped = soro("run", "small.yaml")
    assert stopped.exit_code == 130
    assert "--resume" in stopped.output
    for name in ("film.gif", "design.png"):
        with Image.open(tmp_path / "small_design" / name) as drawn:
            assert drawn.width > 400
    with pytest.raises(ConfigError, match="resume"):
        raise soro("run", "small.yaml").exception
    done = soro("run", "small.yaml", "--resume")
    folder = tmp_path / "small_design"
    numbers = [text.split()[0] for text in done.output.splitlines() if text.strip()[:1].isdigit()]
    assert numbers[:11] == [str(k) for k in range(4, 15)]
    rows = (folder / "iterations.csv").read_text().splitlines()
    assert len(rows) == 15
    assert rows[0].startswith("iteration,objective,motion_m,volume,greyness,residual")
    with Image.open(folder / "film.gif") as film:
        assert film.n_frames >= 12  # frames that do not differ become one
    assert (folder / "design.png").stat().st_size > 20_000
    assert done.exit_code == 0, done.output
    assert "iterations, greyness" not in done.output
    checked = soro("check", "small_design")
    assert checked.exit_code == 0, checked.output
    for word in ("leak", "thinnest wall", "least wall or hinge", "least gap", "own mesh"):
        assert word in checked.output
    with monkeypatch.context() as patch:
        patch.setattr("soro_design.topology.widths.PRINTABLE_M", 0.1)
        thin = soro("check", "small_design")
    assert thin.exit_code == 0, thin.output
    assert "a wall or hinge of" in thin.output
    assert "at least 100 mm" in thin.output
    written = soro("export", "small_design", "--stl", "small.stl", "--extrude", "4mm")
    assert written.exit_code == 0, written.output
    points, triangles = read_stl(tmp_path / "small.stl")
    assert is_closed(triangles)
    # Mirrored on both axes, 4 mm high, a quarter of the grid of 20 x 10 mm.
    assert volume(points, triangles) == pytest.approx(4 * 2e-4 * 0.25 * 4e-3, rel=0.1)
    assert np.ptp(points[:, 2]) == pytest.approx(4e-3)


@pytest.mark.slow
def test_a_part_that_leaks_ends_with_a_reason(soro, tmp_path):
    """One iteration from grey: below the threshold everywhere, so the final part has no wall."""
    task = yaml.safe_load((tmp_path / "small.yaml").read_text())
    task["schedule"] |= {"iterations": 1, "ramp": 0}
    (tmp_path / "short.yaml").write_text(yaml.safe_dump(task))
    done = soro("run", "short.yaml")
    assert done.exit_code == 1
    assert "not sealed" in done.output
    refused = soro("export", "short_design", "--stl", "leak.stl", "--extrude", "4").exception
    assert isinstance(refused, ModelError)
    assert refused.key == "leak"
    assert not (tmp_path / "leak.stl").exists()


def test_what_does_not_belong_to_a_part_is_refused_and_an_unfinished_one_is_told(soro, monkeypatch):
    def interrupted(state):
        raise KeyboardInterrupt

    monkeypatch.setattr(design, "_line", interrupted)
    assert soro("run", "small.yaml").exit_code == 130
    turned = soro("export", "small_design", "--stl", "part.stl", "--revolve").exception
    assert isinstance(turned, ConfigError)
    assert (turned.key, turned.got) == ("--revolve", "a task in plane_strain")
    assert soro("export", "small_design", "--stl", "part.stl").exception.key == "--extrude"
    unfinished = soro("export", "small_design", "--stl", "part.stl", "--extrude", "4")
    assert "1 of 14 iterations" in unfinished.output


@pytest.mark.slow
def test_the_folder_of_a_run_needs_no_other_file_and_a_failed_run_is_drawn(soro, tmp_path):
    """The material comes from a file beside the task; then the pressure gets too high."""
    (tmp_path / "own.yaml").write_text((config_folder() / "materials" / "dragonskin_10.yaml").read_text())
    task = yaml.safe_load((tmp_path / "small.yaml").read_text())
    task["goal"]["material"] = "own.yaml"
    task["schedule"] |= {"iterations": 2, "ramp": 2, "pressure_pa": [1e3, 3e5]}
    (tmp_path / "short.yaml").write_text(yaml.safe_dump(task))
    failed = soro("run", "short.yaml")
    assert isinstance(failed.exception, ModelError)
    folder = tmp_path / "short_design"
    for name in ("film.gif", "design.png"):
        with Image.open(folder / name) as drawn:
            assert drawn.width > 400
    (tmp_path / "own.yaml").unlink()
    kept = load_task(folder / "task.yaml")
    assert (kept.goal.law("").law == load_task("bellow").goal.law("").law).all()


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (["run", "nothing"], ""),
        (["run", "small.yaml", "--resume"], ""),
        (["export", ".", "--stl", "part.stl"], ""),
        (["export", ".", "--stl", "part.stl", "--extrude", "4", "--revolve"], "--extrude"),
        (["export", ".", "--stl", "part.stl", "--extrude", "-4"], "--extrude"),
        (["export", ".", "--stl", "part.obj", "--revolve"], "--stl"),
        (["check", "."], ""),
    ],
)
def test_wrong_use_is_one_line(soro, arguments, key):
    error = soro(*arguments).exception
    assert isinstance(error, ConfigError)
    assert error.key == key
    assert "\n" not in str(error)


SHIPPED = sorted(file.stem for file in (config_folder() / "design").glob("*.yaml"))


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_tasks_make_a_domain(name):
    task = load_task(name)
    assert task.description
    domain = make_domain(task)
    analysis(domain)
    assert domain.is_inlet.any()
