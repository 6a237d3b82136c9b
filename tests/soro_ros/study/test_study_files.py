"""Studies and the files that they name: what rows follow from, what is refused, and what a row says."""

import pickle
from pathlib import Path

import pytest
import yaml

from soro_core.config import find_config, read_yaml
from soro_core.errors import ConfigError
from soro_ros.study import runs
from soro_ros.study.folder import StudyFolder
from soro_ros.study.runs import VariedScene, row_of
from tests.soro_ros.study.short_study import soro, table

ARM = {"based_on": "tue_three_bellow"}
LAW = "from soro_core.control.laws.tip_pid import TipPid\n\n\nclass Own(TipPid):\n    pass\n"
NEGATIVE = {"plant.tip_mass": {"normal": [0.0, 0.005]}}


def written(name, **keys):
    Path(name).write_text(yaml.safe_dump(keys))


def varied(changes=None, samples=1, seed=1, **keys):
    written("vary.yaml", samples=samples, seed=seed, vary=keys or {"seed": {"grid": [1]}})
    return VariedScene("short.yaml", changes or {}, "vary.yaml")


def seed_below_0(count):
    """Return a seed whose first draws are masses below 0."""
    asked = (runs.StudyFile(samples=count, seed=seed, vary=NEGATIVE) for seed in range(1, 50))
    return next(one.seed for one in asked if all(one.values(k)["plant.tip_mass"] < 0.0 for k in range(count)))


def test_a_first_draw_that_is_refused_is_a_row():
    job = next(varied(samples=2, seed=seed_below_0(1), **NEGATIVE).jobs({}))
    assert row_of(job)["verdict"] == "refused"
    assert "tip_mass" in job.refusal


def test_the_duration_may_vary():
    written("vary.yaml", samples=4, seed=18, vary={"duration_s": {"normal": [0.15, 0.1]}})
    assert soro().exit_code == 0
    asked = runs.StudyFile(samples=4, seed=18, vary={"duration_s": {"normal": [0.15, 0.1]}})
    rows = table()
    assert [row["duration_s"] for row in rows] == [asked.values(k)["duration_s"] for k in range(4)]
    assert {row["verdict"] for row in rows if row["duration_s"] <= 0.0} == {"refused"}
    assert all(row["judged_s"] is None or row["judged_s"] <= row["duration_s"] for row in rows)


def test_a_key_with_the_name_of_another_column_is_refused():
    with pytest.raises(ConfigError, match=r"vary\.verdict: .*column"):
        varied(verdict={"choice": [{}]})


@pytest.mark.parametrize(
    ("changes", "keys"),
    [
        ({"twin.plant": "other.yaml"}, {}),
        ({}, {"robot": {"choice": ["tue_three_bellow", "other.yaml"]}}),
        ({}, {"twin.plant": {"grid": ["", "other.yaml"]}}),
        ({}, {"platform": {"choice": ["", "valves.yaml"]}}),
        ({"controller.law": "own.py:Own"}, {}),
        ({}, {"controller.law": {"choice": ["composite", "own.py:Own"]}}),
    ],
)
def test_rows_of_another_content_of_a_file_are_refused(changes, keys):
    valves = read_yaml(find_config("emulated_canopen", "platforms"))
    written("valves.yaml", **valves)
    written("other.yaml", **ARM, tip_mass=0.001)
    Path("own.py").write_text(LAW)
    StudyFolder(Path("out"), varied(changes, **keys))
    StudyFolder(Path("out"), varied(changes, **keys))
    written("valves.yaml", **valves | {"regulator": valves["regulator"] | {"tau_s": 0.123}})
    written("other.yaml", **ARM, tip_mass=0.002)
    Path("own.py").write_text(LAW + "\n# changed\n")
    with pytest.raises(ConfigError, match="runs of another"):
        StudyFolder(Path("out"), varied(changes, **keys))


def test_a_worker_needs_no_file_of_the_plant():
    written("other.yaml", **ARM, tip_mass=0.001)
    study = varied({"twin.plant": "other.yaml"})
    job = pickle.dumps(study.job(0, study.file.values(0)))
    there = row_of(pickle.loads(job))
    Path("other.yaml").rename("away.yaml")
    row = row_of(pickle.loads(job))
    assert row["verdict"] != "refused", row["reason"]
    assert row == there


def test_a_plant_that_cannot_be_computed_is_refused_before_anything_runs():
    written("tendon.yaml", **ARM, tendons=[{"angle_rad": 0.0, "offset_m": 0.01}])
    with pytest.raises(ConfigError, match="tendons"):
        varied({"twin.plant": "tendon.yaml"})
    with pytest.raises(ConfigError, match="tendons"):
        varied(**{"twin.plant": {"choice": ["", "tendon.yaml"]}})


def test_rows_that_are_all_refused_are_a_bad_result():
    written("vary.yaml", samples=2, seed=seed_below_0(2), vary=NEGATIVE)
    result = soro()
    assert result.exit_code == 1, result.output
    assert [row["verdict"] for row in table()] == ["refused"] * 2


def test_kernels_are_compiled_before_runs_are_given_to_processes(monkeypatch):
    """This process says that it compiles; a worker does not."""
    import soro_core.jobs

    steps = []
    monkeypatch.setattr(runs, "_warmed", [])
    monkeypatch.setattr(runs, "ticks_of", lambda *_: steps.append("kernels") or iter(()))
    monkeypatch.setattr(soro_core.jobs, "map_jobs", lambda *_: (steps.append("runs") for _ in ()))
    written("vary.yaml", vary={"seed": {"grid": [1, 2]}})
    assert soro("--jobs", "2").exit_code == 130
    assert steps == ["kernels"]
