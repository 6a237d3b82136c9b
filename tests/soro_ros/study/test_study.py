"""`soro study` from the outside: its table, how it goes on, lost workers, and what it refuses."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from soro_core.robot import load_robot
from soro_lab.scene import load_scene
from soro_ros.cli import main
from soro_ros.recordings.report import summarise
from soro_ros.study.closed_loop import run_in_process
from tests.patience import LIMIT_S
from tests.soro_ros.running import SORO, child, wait_until
from tests.soro_ros.study.short_study import FILE, SCENE, soro, table, vary, write


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The table of the study, one run after the other."""
    place = tmp_path_factory.mktemp("done")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        write(place)
        result = soro()
        assert result.exit_code == 0, result.output
        assert "good: 100 (67.56 to 100) % of the runs" in result.output
        assert (place / "study/short-vary/study.png").stat().st_size > 10_000
        return table(), json.loads(Path("study/short-vary/summary.json").read_text())


@pytest.mark.slow
def test_a_row_is_the_run_of_its_values(done):
    rows, summary = done
    assert [row["run"] for row in rows] == list(range(8))
    assert [row["controller.adapt"] for row in rows] == ["true", "false"] * 4
    row = rows[3]
    assert row["plant.tip_mass"] == rows[2]["plant.tip_mass"] != rows[4]["plant.tip_mass"]
    scene = load_scene("short.yaml", {"mode": "lockstep", "controller.adapt": False, "seed": row["seed"]})
    there = load_robot("tue_three_bellow").links[0].k_b[0]
    robot = scene.loaded_robot.with_({"links[0].k_b[0]": row["robot.links[0].k_b[0]"] * there})
    plant = robot.with_({"tip_mass": row["plant.tip_mass"]})
    scene = scene.with_robot(robot)
    alone = summarise(run_in_process(scene, plant)[0], scene)
    assert row["tip_error_last_rms_m"] == alone.tip_error_last_rms_m
    assert row["estimator_error_last_rms_m"] == alone.estimator_error_last_rms_m
    errors = sorted(1e3 * row["tip_error_last_rms_m"] for row in rows)
    found = summary["figures"]["tip_error_last_rms_m"]["median"]
    assert errors[0] <= found["low"] < found["value"] < found["high"] <= errors[-1]


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.filterwarnings("default")
def test_a_cluster_writes_the_same_table(done):
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    with distributed.LocalCluster(n_workers=4, threads_per_worker=1, dashboard_address=":0") as cluster:
        result = soro("--dask", cluster.scheduler_address)
    assert result.exit_code == 0, result.output
    assert table() == done[0]


def started(*arguments):
    return subprocess.Popen([*SORO, "study", "short.yaml", "--vary", "vary.yaml", *arguments], text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)  # fmt: skip


def wait_for_rows(process, count):
    rows = Path("study/short-vary/runs.jsonl")

    def are_there():
        assert process.poll() is None, process.communicate()[0]
        return rows.exists() and len(rows.read_text().splitlines()) >= count

    wait_until(are_there, f"{count} rows", 2 * LIMIT_S)


@pytest.mark.slow
@pytest.mark.process
def test_ctrl_c_keeps_what_is_done_and_the_same_command_goes_on(done):
    process = started()
    wait_for_rows(process, 2)
    process.send_signal(signal.SIGINT)
    output = process.communicate(timeout=LIMIT_S)[0]
    assert process.returncode == 130, output
    kept = table()
    assert 2 <= len(kept) < 8
    said = f"interrupted: {len(kept)} of 8 runs are done; the same command goes on"
    assert said in " ".join(output.split())
    with open("study/short-vary/runs.jsonl", "a") as file:
        file.write('{"run": 7, "ver')  # the computer was switched off
    again = soro()
    assert f"{len(kept)} of 8 runs are done already" in again.output
    assert again.exit_code == 0
    assert table() == done[0]
    (Path.cwd() / "vary.yaml").write_text(yaml.safe_dump({**FILE, "seed": 4}))
    refused = soro()
    assert type(refused.exception).__name__ == "ConfigError"
    assert "got 'runs of another --vary'; allowed: runs of this --vary" in str(refused.exception)
    assert table() == done[0]


@pytest.mark.slow
@pytest.mark.process
def test_processes_write_the_same_table_and_a_killed_one_loses_nothing(done):
    process = started("--jobs", "2")
    wait_for_rows(process, 1)
    os.kill(child(process.pid, "spawn_main"), signal.SIGKILL)
    output = process.communicate(timeout=4 * LIMIT_S)[0]
    assert process.returncode == 0, output
    assert table() == done[0]


@pytest.mark.parametrize(
    ("file", "changes", "words"),
    [
        (vary(**{"twin.payload": {"uniform": [0, 1]}}), (), ("twin.payload", "payload_kg")),
        (vary(**{"twin.payload_kg": {"uniform": [1, 0]}}), (), ("vary.twin.payload_kg", "lower end first")),
        (vary(**{"twin.payload_kg": {"even": [0, 1]}}), (), ("even", "uniform, normal, lognormal")),
        (vary(**{"twin.payload_kg": {"uniform": [0, 1], "grid": [1]}}), (), ("one of uniform",)),
        (vary(**{"twin.payload_kg": {"uniform": [-1, 0]}}), (), ("payload_kg", "greater")),
        (vary(**{"controller.law": {"choice": ["composite", "none"]}}), (), ("controller.law", "none")),
        (vary(**{"robot.links[4].k_b[0]": {"scale": [1, 2]}}), (), ("links[4].k_b[0]", "a number")),
        (vary(**{"robot.links[0].kb": {"uniform": [1, 2]}}), (), ("links[0]", "kb")),
        (vary(**{"robot.name": {"scale": [1, 2]}}), (), ("robot.name", "a number")),
        (vary(mode={"choice": ["real_time"]}), (), ("vary.mode", "lockstep alone")),
        (vary(), (), ("vary",)),
        ({"samples": 0, **vary(seed={"grid": [1]})}, (), ("samples", "1")),
        (
            vary(faults={"choice": [[{"at": 1.0, "fault": "stuck_open"}]]}),
            (),
            ("vary.faults", "stuck_open", "faults of devices need soro run"),
        ),
        (
            vary(seed={"grid": [1]}),
            ("--set", "platform=emulated_canopen", "--set", "faults=[{at: 0.1, fault: bus_off}]"),
            ("faults", "bus_off", "faults of devices need soro run"),
        ),
        (vary(seed={"grid": [1]}), ("--jobs", "2", "--dask", "tcp://127.0.0.1:1"), ("--jobs", "either")),
        (vary(seed={"grid": [1]}), ("--out", "short.yaml"), ("--out", "a folder")),
    ],
)  # fmt: skip
def test_wrong_use_ends_with_2_and_one_line(file, changes, words, monkeypatch, capfd):
    Path("bad.yaml").write_text(yaml.safe_dump(file))
    monkeypatch.setattr("sys.argv", ["soro", "study", "short.yaml", "--vary", "bad.yaml", *changes])
    with pytest.raises(SystemExit) as end:
        main()
    lines = [line for line in capfd.readouterr().err.splitlines() if not line.startswith("soro: compiling")]
    assert end.value.code == 2
    assert len(lines) == 1, lines
    assert all(word in lines[0] for word in words), lines[0]
    assert not Path("study").exists()


def test_a_value_that_is_refused_later_is_a_row():
    """A normal distribution has no bounds: a mass below 0 is a row that says so."""
    keys = vary(**{"plant.tip_mass": {"normal": [0.0, 0.005]}})
    Path("bad.yaml").write_text(yaml.safe_dump({"samples": 4, "seed": 3, **keys}))
    assert soro(file="bad.yaml").exit_code == 0
    rows = table("study/short-bad")
    bad = [row for row in rows if row["plant.tip_mass"] < 0.0]
    assert 0 < len(bad) < 4
    assert {row["verdict"] for row in bad} == {"refused"}
    assert all("tip_mass" in row["reason"] and row["tip_error_last_rms_m"] is None for row in bad)


@pytest.mark.slow
@pytest.mark.process
def test_a_study_needs_no_ros():
    """With an import system that has no ROS, no recordings and no drivers of devices."""
    code = (
        "import sys\n"
        "from soro_core.extras import PACKAGES\n"
        "absent = {name for extra in ('hardware', 'ros', 'view', 'dask') for name in PACKAGES[extra]}\n"
        "class Absent:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.partition('.')[0] in absent:\n"
        "            raise ModuleNotFoundError(f'No module named {name!r}', name=name)\n"
        "sys.meta_path.insert(0, Absent())\n"
        "from soro_ros.cli import main\n"
        "sys.argv = ['soro', 'study', 'short.yaml', '--vary', 'vary.yaml', '--set', 'duration_s=0.05']\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=4 * LIMIT_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(table()) == 8


@pytest.mark.slow
def test_the_time_of_a_run_in_one_process_counts_from_the_end_of_the_probe(tmp_path):
    """As in real time; a run that ended earlier would be judged as lost."""
    (tmp_path / "short.yaml").write_text(yaml.safe_dump(SCENE))
    keys = {"mode": "lockstep", "duration_s": 0.6, "controller.probe_at_enable": "warn"}
    scene = load_scene(str(tmp_path / "short.yaml"), keys)
    recording, end = run_in_process(scene)
    assert end.status == 0, end
    assert recording.command.t[0] < -1.0  # the probe
    assert abs(recording.wanted_tip.t[-1] - 0.6) < 0.02
    assert np.isfinite(summarise(recording, scene).tip_error_last_rms_m)
