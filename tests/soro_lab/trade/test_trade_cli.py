"""`soro trade` from the outside: what it writes, how it ends, and that its block can be pasted."""

import json
import os
import signal
from dataclasses import replace

import pytest
import yaml
from small import GRID, ROBOT
from typer.testing import CliRunner

from soro_lab.scene import load_scene
from soro_lab.trade import cache, grid, reference, study
from soro_lab.trade import slow_metrics as late
from soro_lab.trade.closed_loop import drive
from soro_ros.cli import application, main


@pytest.fixture
def soro(tmp_path, tmp_path_factory, monkeypatch):
    """Call the command with a small grid, in a folder of its own, with a cache that these tests share."""
    kept = tmp_path_factory.getbasetemp() / "trade-cache"
    monkeypatch.setattr(cache, "user_folder", lambda: kept)
    monkeypatch.setitem(grid.PRESETS, "quick", GRID)
    monkeypatch.setattr(study, "STEPPERS", dict.fromkeys(("midpoint_linear", "rk4", "trapezoidal")))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(yaml.safe_dump(ROBOT))

    def call(*arguments):
        return CliRunner().invoke(application(), ["trade", *arguments])

    return call


QUICK = ("--preset", "quick", "--seconds", "0.2", "--repeats", "1")


def test_a_robot_and_a_requirement_that_is_met(soro, tmp_path):
    result = soro("small.yaml", *QUICK, "--error", "5%")
    assert result.exit_code == 0, result.output
    assert "own error" in result.output
    assert "combinations were run" in result.output
    written = json.loads((tmp_path / "trade/small/trade.json").read_text())
    block = yaml.safe_load(result.output[result.output.index("\nmodel:") :])
    assert block["model"] == written["choice"]
    assert (tmp_path / "trade/small/trade.png").stat().st_size > 10_000


def test_a_requirement_that_is_not_met(soro):
    result = soro("small.yaml", *QUICK, "--error", "0.0000001%")
    assert result.exit_code == 1
    assert "nothing meets the requirement" in result.output
    assert "nearest: tip error " in result.output
    assert "\nmodel:" not in result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("small.yaml", "--error", "1"), "like 1%"),
        (("small.yaml", "--error", "1%", "--rate", "100"), "one requirement"),
        (("small.yaml", "--preset", "huge"), "allowed are quick"),
        (("small.yaml", "--seconds", "-1"), "0.1 s to 600"),
        (("absent",), "a scene (antagonistic_joint, "),
        (("absent.yaml",), "no such file"),
        (("small.yaml", "--jobs", "2", "--dask", "tcp://127.0.0.1:1"), "either"),
    ],
)
def test_wrong_use_ends_with_2_and_one_line(tmp_path, monkeypatch, capfd, arguments, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    monkeypatch.setattr("sys.argv", ["soro", "trade", *arguments])
    (tmp_path / "small.yaml").write_text(yaml.safe_dump(ROBOT))
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert message in capfd.readouterr().err


def test_ctrl_c_writes_what_is_done(soro, tmp_path, monkeypatch):
    computed = []

    def compute(*arguments):
        computed.append(arguments)
        if len(computed) == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return known(*arguments)

    known = study.compute
    monkeypatch.setattr(study, "compute", compute)
    result = soro("small.yaml", *QUICK, "--error", "5%", "--fresh")
    assert result.exit_code == 130
    assert "interrupted" in result.output
    written = json.loads((tmp_path / "trade/small/trade.json").read_text())
    assert written["stopped"]
    assert written["combinations"]["run"] == len(computed) == 3


def check_same_errors(soro, tmp_path, *several):
    """Compare the errors of one process with those that more find, to the bit."""
    one = soro("small.yaml", *QUICK, "--error", "5%", "--out", "one", "--fresh")
    two = soro("small.yaml", *QUICK, "--error", "5%", "--out", "two", "--fresh", *several)
    assert one.exit_code == two.exit_code == 0, two.output

    def found(name):
        rows = json.loads((tmp_path / name / "trade.json").read_text())["rows"]
        return {json.dumps(row["model"]): row["errors_percent"] for row in rows}

    first, second = found("one"), found("two")
    both = first.keys() & second.keys()  # the second pass depends on times
    assert len(both) >= 6
    assert {key: first[key] for key in both} == {key: second[key] for key in both}


@pytest.mark.slow
def test_processes_find_the_same_errors(soro, tmp_path):
    check_same_errors(soro, tmp_path, "--jobs", "2")


def test_dask_says_what_is_missing(soro):
    result = soro("small.yaml", *QUICK, "--dask", "tcp://127.0.0.1:1")
    assert type(result.exception).__name__ == "ConfigError"
    assert "--dask: got 'tcp://127.0.0.1:1'; allowed: " in str(result.exception)
    assert "\n" not in str(result.exception)


def test_a_dask_cluster_finds_the_same_errors(soro, tmp_path):
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        check_same_errors(soro, tmp_path, "--dask", cluster.scheduler_address)


def test_a_scene_ends_with_a_block_that_runs(soro, tmp_path, monkeypatch):
    """From a scene: excitation by its own loop, closed loop, a block that parses and runs, and `auto`."""
    coarse = reference.spaces
    monkeypatch.setattr(reference, "spaces", lambda robot: (coarse(robot)[0][:2], "", ""))
    monkeypatch.setattr(late, "LOOP_LAST_S", 0.2)
    monkeypatch.setitem(grid.PRESETS, "quick", replace(GRID, polynomials=(), most=0))
    scene = {
        "robot": "tue_three_bellow",
        "rate_hz": 50,
        "twin": {"pose": {"rate_hz": 50}, "refine": 1, "step_s": 0.004, "integrator": "trapezoidal"},
        "controller": {"reference": {"start_s": 0.2}},
    }
    path = tmp_path / "short.yaml"
    path.write_text(yaml.safe_dump(scene))
    result = soro("short.yaml", *QUICK, "--error", "20%")
    assert result.exit_code == 0, result.output
    assert "Closed loop: 0.4 s" in result.output
    written = json.loads((tmp_path / "trade/short/trade.json").read_text())
    loops = [row["closed_loop"] for row in written["rows"] if row["closed_loop"]]
    assert loops
    assert all(0.0 < loop["tracking_mm"] < 30.0 for loop in loops)
    block = result.output[result.output.index("\n# The twin keeps") :]
    assert "twin.refine, twin.integrator, twin.step_s." in block
    assert (tmp_path / "trade/short/model.yaml").read_text().strip() == block.strip()
    path.write_text(yaml.safe_dump(scene) + block)
    pasted = load_scene(path)
    assert pasted.twin_node().step_s == 0.004
    assert pasted.model.model_dump(exclude_unset=True) == written["choice"]
    assert drive(pasted, pasted.discretisation, 0.1).t[-1] > 0.05
