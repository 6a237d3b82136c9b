"""`soro fem run` on coarse parts: files, a sweep that stops, Ctrl-C, an output that exists."""

import csv
import os
import signal

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from soro_core import jobs
from soro_core.errors import ConfigError
from soro_core.jobs import Threads
from soro_design.commands.fem import app as fem
from soro_design.parts import sweeps
from soro_design.parts.file import load_part
from soro_design.parts.folder import load_backbones
from tests.refused import refused
from tests.soro_design.fem.small_parts import ROD, TUBE, written

app = typer.Typer()
app.add_typer(fem, name="fem")
PULL = {"name": "pull", "force_n": [0.0, 0.0, 1.0], "states": 2}
ONE = {"name": "one", "pressures_pa": [4e3, 0.0, 0.0], "states": 2}


def call(tmp_path, part, *arguments, **changes):
    path, out = written(tmp_path, part, **changes), tmp_path / "run"
    return CliRunner().invoke(app, ["fem", "run", str(path), "--out", str(out), *arguments]), path, out


def rows(out):
    with (out / "table.csv").open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.slow
def test_a_run_leaves_shapes_a_table_backbones_and_pictures(tmp_path):
    done, path, out = call(tmp_path, ROD, sweeps=[PULL, ONE])
    assert done.exit_code == 0, done.output
    for name in ("pull_01.vtu", "pull_02.vtu", "one_02.vtu", "shapes.png", "curves.png"):
        assert (out / name).stat().st_size > 1000
    table = rows(out)
    assert [(row["sweep"], float(row["load"])) for row in table] == [
        ("pull", 0.5), ("pull", 1.0), ("one", 0.5), ("one", 1.0),
    ]  # fmt: skip
    assert float(table[1]["force_z_n"]) == 1.0
    # EA of six c1 and the area of rubber, less stiff plugs: 65 N.
    assert float(table[1]["tip_z_m"]) - 0.06 == pytest.approx(0.06 / 65.0, rel=0.08)
    z, states = load_backbones(out, load_part(path))
    assert z[[0, -1]].tolist() == [0.0, 0.06]
    assert [state.sweep for state in states] == ["pull", "pull", "one", "one"]
    assert states[3].pressures_pa.tolist() == [4e3, 0.0, 0.0]
    assert states[3].poses[-1][0, 3] == pytest.approx(float(table[3]["tip_x_m"]))

    again, _, _ = call(tmp_path, ROD, sweeps=[PULL])
    assert isinstance(again.exception, ConfigError)
    assert again.exception.key == "--out"
    (tmp_path / "run" / "mine.csv").write_text("kept")
    forced, _, _ = call(tmp_path, ROD, "--force", sweeps=[ONE])
    assert forced.exit_code == 0
    assert sorted(path.name for path in out.glob("*.vtu")) == ["one_01.vtu", "one_02.vtu"]
    assert (out / "mine.csv").read_text() == "kept"
    (out / "part.json").unlink()
    other, _, _ = call(tmp_path, ROD, "--force", sweeps=[ONE])
    assert other.exception.key == "--out"


def test_a_folder_of_another_part_is_refused(tmp_path):
    _, path, out = call(tmp_path, ROD, sweeps=[PULL])
    written(tmp_path, ROD, sweeps=[ONE])
    with refused(""):  # the part has another list of sweeps now
        load_backbones(out, load_part(path))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["backbone.npz", "part.json"])
def test_a_damaged_folder_of_a_run_is_one_line(tmp_path, name):
    _, path, out = call(tmp_path, ROD, sweeps=[PULL])
    (out / name).write_bytes((out / name).read_bytes()[:-40])
    with refused("", names=("soro fem run",)):
        load_backbones(out, load_part(path))


@pytest.mark.slow
def test_a_tube_keeps_its_ends_and_has_a_force(tmp_path):
    pulled = {"name": "pulled", "extension_m": 1e-4, "states": 1}
    done, _, out = call(tmp_path, TUBE, sweeps=[*TUBE["sweeps"], pulled])
    assert done.exit_code == 0, done.output
    last = rows(out)[-1]
    assert float(last["extension_m"]) == pytest.approx(1e-4)
    stiffness = 6.0 * 36e3 * np.pi * (0.008**2 - 0.004**2) / 0.02
    assert float(last["force_n"]) == pytest.approx(1e-4 * stiffness, rel=0.02)
    assert float(rows(out)[0]["radius_change_m"]) > 0.0


def test_a_sweep_without_equilibrium_keeps_its_last_state_and_the_others_go_on(tmp_path):
    crushed = {"name": "crushed", "extension_m": -0.0195, "states": 4}
    done, _, out = call(tmp_path, TUBE, sweeps=[crushed, *TUBE["sweeps"]])
    assert done.exit_code == 1
    assert (out / "crushed_last.vtu").is_file()
    assert {row["sweep"] for row in rows(out)} == {"crushed", "blown"}


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done(tmp_path, monkeypatch):
    follow = sweeps.follow

    def interrupted(specimen, sweep, reached):
        def until(state):
            reached(state)
            if sweep.name == "one":
                raise KeyboardInterrupt

        return follow(specimen, sweep, until)

    monkeypatch.setattr(sweeps, "follow", interrupted)
    done, _, out = call(tmp_path, ROD, sweeps=[PULL, ONE])
    assert done.exit_code == 130
    assert [row["sweep"] for row in rows(out)] == ["pull", "pull", "one"]
    assert (out / "one_last.vtu").is_file()
    assert (out / "shapes.png").is_file()


@pytest.mark.process
@pytest.mark.slow
def test_two_jobs_keep_the_same_states_to_the_bit(tmp_path):
    check_same_states(tmp_path, "--jobs", "2")


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_dask_cluster_keeps_the_same_states_to_the_bit(tmp_path):
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        check_same_states(tmp_path, "--dask", cluster.scheduler_address)


def check_same_states(tmp_path, *several):
    """Compare every file but the pictures of one process with those that more write."""
    crushed = {"name": "crushed", "extension_m": -0.0195, "states": 4}
    found = []
    for folder, options in (("one", ("--jobs", "1")), ("more", several)):
        (tmp_path / folder).mkdir()
        done, _, out = call(tmp_path / folder, TUBE, *options, sweeps=[crushed, *TUBE["sweeps"]])
        assert done.exit_code == 1, done.output
        assert "crushed: stopped" in done.output
        found.append({file.name: file.read_bytes() for file in out.iterdir() if file.suffix != ".png"})
    assert len(found[0]) > 4
    assert found[0] == found[1]


def test_ctrl_c_with_several_jobs_lets_the_sweeps_under_way_end(tmp_path, monkeypatch):
    class Interrupted(Threads):
        """Threads; Ctrl-C comes with the first sweep."""

        def submit(self, function, item):
            os.kill(os.getpid(), signal.SIGINT)
            return super().submit(function, item)

    monkeypatch.setattr(jobs, "executor_of", lambda *_: Interrupted(2))
    pulled = [{"name": name, "extension_m": 1e-4, "states": 1} for name in ("a", "b", "c", "d")]
    done, _, out = call(tmp_path, TUBE, "--jobs", "2", sweeps=pulled)
    assert done.exit_code == 130
    assert [row["sweep"] for row in rows(out)] == ["a"]
    assert "1 of 4 sweeps are done" in done.output
