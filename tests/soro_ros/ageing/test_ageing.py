"""An arm over its runs: the error of its model, its stiffness, trends, when it is identified again."""

import json
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from soro_core.errors import ConfigError
from soro_core.twin.plant import true_robot
from soro_ros.ageing.history import RunEntry, runs_of, since_identified
from soro_ros.ageing.model_error import FILE, ModelMismatch, model_error
from soro_ros.ageing.trend import AGAIN, STIFFNESS, ageing, lines, trend
from soro_ros.commands.log import log
from soro_ros.study.closed_loop import run_in_process
from tests.soro_ros.ageing.aged import BEGIN, all_runs, scene_of

RUNS = 8
app = typer.Typer()
app.command()(log)


def entry(day, error_mm, stiffness=1.0, digest="a", **learned):
    when = BEGIN + timedelta(days=day)
    error = ModelMismatch(1e-3 * error_mm, stiffness, 1e-3)
    return RunEntry(Path(f"arm-{when:%Y%m%d-%H%M%S}"), when, "good", error, digest, learned)


def test_cycles_soften_the_true_arm_alone(tmp_path):
    """By 1 % in 1,000, each time of what is left."""
    for cycles, left in ((0, 1.0), (1000, 0.99), (3000, 0.99**3)):
        scene = scene_of(tmp_path, cycles)
        robot = scene.loaded_robot
        true = true_robot(robot, scene.twin_node())
        parts = len(true.links) // len(robot.links)
        assert true.links[0].k_e[0] / robot.links[0].k_e[0] == pytest.approx(left * parts)


def test_the_arm_is_identified_again_when_the_error_stays_beyond():
    """Not for one bad run among good ones."""
    errors = [0.2, 0.21, 0.19, 0.3, 0.22, 0.27, 0.28]
    found = ageing([entry(k, each) for k, each in enumerate(errors)])
    assert found.new_m == pytest.approx(0.2e-3)
    assert found.since is not None
    assert found.since.folder.name == "arm-20260307-090000"
    assert "identify again: since arm-20260307-090000" in lines(found)[-1]
    below = ageing([entry(k, each) for k, each in enumerate([*errors[:5], 0.2 * AGAIN])])
    assert below.since is None
    assert "identify again" not in "\n".join(lines(below))


def test_a_new_robot_file_begins_anew():
    runs = [entry(0, 0.2), entry(1, 0.4), entry(2, 0.1, digest="b"), entry(3, 0.1, digest="")]
    assert since_identified(runs) == runs[2:]
    assert since_identified(runs[:2]) == runs[:2]


def test_a_trend_has_the_weights_of_its_deviations():
    """A line is found; a doubtful run beside it is left aside; scatter beyond deviations counts."""
    line = [(float(day), 1.0 - 0.01 * day, 1e-3) for day in range(6)]
    found = trend("x", [*line, (6.0, 5.0, 100.0)])
    assert found.per_day == pytest.approx(-0.01, abs=2e-4)
    assert found.is_told
    rng = np.random.default_rng(1)
    scattered = trend("x", [(float(day), float(rng.normal()), 1e-3) for day in range(30)])
    assert scattered.deviation > 100.0 * trend("x", [(float(day), 0.0, 1e-3) for day in range(30)]).deviation
    assert not scattered.is_told
    assert not np.isfinite(trend("x", line[:2]).per_day)


@pytest.mark.slow
def test_the_error_sees_the_stiffness_and_not_the_noise(tmp_path):
    """Softened by 3 %, in the same model, is found as 3 %; another seed of the noise changes nothing."""
    found = {}
    for cycles, seed in ((0, 1), (0, 2), (3000, 3)):
        scene = scene_of(tmp_path, cycles, seed)
        recording, end = run_in_process(scene)
        assert end.status == 0, end.error
        found[cycles, seed] = model_error(recording, scene)
    first, second, soft = found.values()
    assert second.stiffness == pytest.approx(first.stiffness, abs=0.005)
    assert second.rms_m < 1.1 * first.rms_m
    assert soft.stiffness / first.stiffness == pytest.approx(0.99**3, abs=0.006)


@pytest.mark.slow
def test_the_softening_is_found_by_3000_cycles(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    runs = all_runs(tmp_path, RUNS, 3000.0)
    found = ageing(since_identified(runs_of("aged", runs)))
    assert len(found.runs) == RUNS
    assert found.since is not None
    stiffness = next(one for one in found.trends if one.name == STIFFNESS)
    assert stiffness.per_day * (RUNS - 1) == pytest.approx(0.99**3 - 1.0, abs=0.006)
    assert stiffness.is_told
    # After a third of the cycles it is too early.
    assert ageing(found.runs[: 1 + RUNS // 3]).since is None
    done = CliRunner().invoke(app, ["aged", "--runs", str(runs), "--report", str(tmp_path / "page")])
    assert done.exit_code == 0, done.output
    assert f"{RUNS} runs with this robot file, 2026-03-02 09:00 to 2026-03-09 09:00" in done.output
    assert f"identify again: since {found.since.folder.name}" in done.output
    content = json.loads((tmp_path / "page" / "report.json").read_text())
    assert content["identify_again_since"] == found.since.folder.name
    assert [run["verdict"] for run in content["runs"]] == ["good"] * RUNS
    assert len(list((tmp_path / "page" / "pictures").iterdir())) == 2
    assert "stiffness" in (tmp_path / "page" / "index.html").read_text()


def test_what_is_no_run_is_left_out(tmp_path, monkeypatch):
    """Of another arm, refused, without a number, or with a file that is damaged."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    runs = tmp_path / "runs"
    for name, word in (
        ("arm-20260302-090000", "good"),
        ("arm-20260303-090000", "vented"),
        ("arm-left-20260304-090000", "good"),
        ("arm-today", "good"),
        ("arm-20260301-090000-2", "poor"),
    ):
        (runs / name).mkdir(parents=True)
        (runs / name / "summary.json").write_text(json.dumps({"verdict": word}))
    (runs / "arm-20260302-090000" / FILE).write_text("{")
    found = runs_of("arm", runs)
    assert [run.folder.name for run in found] == ["arm-20260301-090000-2", "arm-20260302-090000"]
    assert [run.error for run in found] == [None, None]
    done = CliRunner().invoke(app, ["arm", "--runs", str(runs)])
    assert "error of the model: not known" in done.output
    refused = CliRunner().invoke(app, ["leg", "--runs", str(runs)])
    assert isinstance(refused.exception, ConfigError)
    assert f"no run in {runs}" in str(refused.exception)
