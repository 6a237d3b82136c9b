"""`soro identify`: what it refuses before any search, and how it ends."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from made_recordings import JOINT, LINK, START_NS, arm_topics, pressures, write_bag, write_csv
from made_result import made, runs
from typer.testing import CliRunner

from soro_core.errors import ConfigError
from soro_core.robot import load_robot
from soro_lab.commands import identify as command
from soro_lab.commands.identify_report import ReportOptions
from soro_lab.identification.arm import stages
from soro_lab.identification.arm.stages import ArmIdentification

COLUMNS = {
    "time": {"column": "t", "unit": "s"},
    "pressures": {"columns": {"link0/chamber0": "a", "link1/chamber0": "b"}, "unit": "Pa"},
    "plates": {
        "tip": {
            "position": ["x", "y", "z"],
            "unit": "m",
            "quaternion": ["qx", "qy", "qz", "qw"],
            "link": 1,
        }
    },
}


def _soro(*words: str | Path):
    from soro_ros.cli import application

    return CliRunner().invoke(application(), ["identify", *map(str, words)])


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    arm = {"links": [LINK] * 2, "pressure_range_pa": [0.0, 100e3]}
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(arm), encoding="utf-8")
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(COLUMNS), encoding="utf-8")
    return tmp_path


def _table(n: int = 400) -> dict[str, Any]:
    t = 0.01 * np.arange(n)
    zero = np.zeros(n)
    moved = 0.01 * np.sin(t)
    columns: dict[str, Any] = {"t": t, "a": 1e3 * (1 + np.sin(t)), "b": 1e3 * (1 + np.cos(t))}
    return columns | {
        "x": moved,
        "y": zero,
        "z": 0.2 + zero,
        "qx": zero,
        "qy": zero,
        "qz": zero,
        "qw": zero + 1,
    }


def _csv(here: Path, **changes: Any) -> Path:
    return write_csv(here / "run.csv", _table() | changes)


def _without(topic: str) -> Callable[[Path], Path]:
    return lambda here: write_bag(here / "bag", {k: v for k, v in arm_topics().items() if topic not in k})


def _other_names(here: Path) -> Path:
    rows = [
        (START_NS + k * 10**7, pressures(START_NS + k * 10**7, ["left", "right"], (1, 2))) for k in range(40)
    ]
    return write_bag(here / "bag", arm_topics() | {"/arm/chambers/state": (JOINT, rows)})


def _backwards(here: Path) -> Path:
    t = _table()["t"]
    return _csv(here, t=np.where(t > 2.0, t - 1.0, t))


def _still(here: Path) -> Path:
    draw = np.random.default_rng(1)
    return _csv(here, x=draw.normal(0.0, 1e-4, 400))


@pytest.mark.parametrize(
    ("recording", "key"),
    [
        (_without("pose"), "sensors/pose0"),
        (_without("state"), "chambers/state"),
        (_other_names, "/arm/chambers/state"),
        (_backwards, "pressure"),
        (lambda here: _csv(here, x=np.full(400, np.nan)), "tip"),
        (_still, ""),
        (lambda here: here / "absent.csv", ""),
    ],
    ids=["no poses", "no pressures", "other chambers", "backwards", "nan", "no motion", "no file"],
)
def test_bad_recordings_are_refused(recording: Callable[[Path], Path], key: str, here: Path) -> None:
    path = recording(here)
    more = ("--columns", "map.yaml") if path.suffix == ".csv" else ()
    result = _soro("arm.yaml", path, "--out", "new.yaml", *more)
    assert isinstance(result.exception, ConfigError), result.exception
    assert result.exception.key == key, result.exception
    assert "\n" not in str(result.exception)
    assert not (here / "new.yaml").exists()


def test_a_missing_bag_is_one_line(here: Path) -> None:
    result = _soro("arm.yaml", here / "absent", "--out", "new.yaml")
    assert (result.exit_code, result.output.count("\n")) == (2, 1)
    assert "absent" in result.output


def test_wrong_options_are_refused(here: Path) -> None:
    _csv(here)
    (here / "old").mkdir()
    begin = ("arm.yaml", "run.csv", "--columns", "map.yaml", "--out", "new.yaml")
    for words, key in (
        (("--report", "old"), "--report"),
        (("--profile", "all"), "--profile"),
        (("--report", "new", "--profile", "link0/k_c"), "--profile"),
        (("--report", "arm.yaml", "--force"), "--report"),
    ):
        result = _soro(*begin, *words)
        assert isinstance(result.exception, ConfigError), words
        assert result.exception.key == key


def test_no_profile_may_be_asked_for_without_a_report() -> None:
    ReportOptions(None, "none").check(load_robot("tue_three_bellow"), force=False)


def test_a_robot_that_no_matter_can_be_is_refused(here: Path) -> None:
    heavy = {"links": [LINK, {**LINK, "mass": 100.0}], "pressure_range_pa": [0.0, 100e3]}
    (here / "arm.yaml").write_text(yaml.safe_dump(heavy), encoding="utf-8")
    result = _soro("arm.yaml", _csv(here), "--columns", "map.yaml", "--out", "new.yaml")
    assert isinstance(result.exception, ConfigError)
    assert result.exception.key == "links[1].mass"


@pytest.fixture(scope="module")
def found() -> ArmIdentification:
    return made(damaged=False)


def _end(found: ArmIdentification, monkeypatch: pytest.MonkeyPatch, *words: str):
    """Run the command with a search that finds this."""
    monkeypatch.setattr(stages, "identify", lambda *given: found)
    monkeypatch.setattr(command, "_read", lambda *given: runs(damaged=False))
    return _soro("tue_three_bellow", "bag", "--out", "new.yaml", *words)


@pytest.mark.slow
def test_exit_0_accepted(found: ArmIdentification, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("--accept", "20", "--report", "page", "--profile", "none")
    result = _end(found, monkeypatch, *words)
    assert result.exit_code == 0, result.output
    assert load_robot(here / "new.yaml").n_u == 3
    assert {path.name for path in (here / "page").iterdir()} == {"index.html", "report.json", "pictures"}


def test_exit_1_above_the_limit(
    found: ArmIdentification, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert _end(found, monkeypatch, "--accept", "0.001").exit_code == 1
    assert (here / "new.yaml").exists()


def test_exit_1_where_nothing_could_be_held_out(
    found: ArmIdentification, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    none = replace(found, held_out=(), held_out_share=float("nan"), choice=None, held_cases=())
    assert _end(none, monkeypatch, "--accept", "100").exit_code == 1
    assert (here / "new.yaml").exists()


def test_exit_1_where_a_number_is_unphysical(
    found: ArmIdentification, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = found.solution.values | {"link0/k_b": -1.0}
    odd = replace(found, solution=replace(found.solution, values=values))
    assert _end(odd, monkeypatch, "--accept", "100").exit_code == 1
    text = (here / "new.yaml").read_text(encoding="utf-8")
    assert "UNPHYSICAL: link0/k_b" in text
    # What is not found but kept is not judged.
    kept = replace(odd, kept={"link0/k_b": ()})
    assert _end(kept, monkeypatch, "--accept", "100", "--force").exit_code == 0


@pytest.mark.slow
def test_exit_130_after_ctrl_c(found: ArmIdentification, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended = replace(found, interrupted=True)
    result = _end(ended, monkeypatch, "--accept", "100", "--report", "page")
    assert result.exit_code == 130
    assert "their own error is not known" in result.output
    assert "INTERRUPTED" in (here / "new.yaml").read_text(encoding="utf-8")
    assert (here / "page" / "index.html").exists()


@pytest.mark.slow
def test_ctrl_c_during_profiles_keeps_the_file_and_the_report(
    found: ArmIdentification, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from soro_lab.identification.arm import profiles

    def interrupt(*given: Any, **named: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(profiles, "searched", interrupt)
    assert _end(found, monkeypatch, "--accept", "100", "--report", "page").exit_code == 130
    assert (here / "new.yaml").exists()
    assert (here / "page" / "index.html").exists()


def test_the_help_has_the_exit_status() -> None:
    text = " ".join(_soro("--help").output.split())
    assert all(status in text for status in ("0 found", "1 not accepted", "2 wrong use", "130 after Ctrl-C"))
