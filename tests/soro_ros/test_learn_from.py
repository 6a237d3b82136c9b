"""`soro run --learn-from`: a run keeps what was learned, and the next one starts from it."""

from __future__ import annotations

import pytest

from soro_core.adaptation.kept import FILE, load_kept
from soro_core.robot import load_robot
from soro_lab.bag import BagReader
from soro_ros.recordings.recording import recorded
from tests.patience import COMPILED_S
from tests.soro_ros.running import SORO, only_run, run, summary
from tests.warm import completed

pytestmark = pytest.mark.process

BRIEF = ("mode=lockstep", "rate_hz=100", "platform=", "duration_s=1.5", "controller.law=composite")


def again(folder, source, *changes):
    """Start from what `source` kept; returns exit status and lines on stderr."""
    options = [word for change in (*BRIEF, *changes) for word in ("--set", change)]
    command = [*SORO, "run", "track_circle", "--no-figure", "--folder", str(folder), *options]
    end = completed([*command, "--learn-from", str(source)], 2 * COMPILED_S)
    return end.returncode, end.stderr.strip().splitlines()


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """A run that is over."""
    from tests.soro_ros.conftest import own_domain

    with own_domain(tmp_path_factory.mktemp("state")):
        status, output, folder = run(tmp_path_factory.mktemp("first"), *BRIEF)
    assert status == 0, output
    assert f"--learn-from {folder}" in output
    return folder


def test_the_second_run_starts_from_what_the_first_one_kept(domain, first, tmp_path):
    kept = load_kept(first)
    assert kept.robot == load_robot("tue_three_bellow").name
    assert {"tip_mass", "link0/chamber2/gain", "link0/area_slope"} < set(kept.numbers)
    assert all(deviation > 0.0 for _, deviation in kept.numbers.values())
    # A gain that the first run would not find.
    name, far = "link0/chamber1/gain", -0.25
    text = kept.to_yaml().replace(f"{name}: [{kept.numbers[name][0]:.8g},", f"{name}: [{far},")
    (tmp_path / FILE).write_text(text)
    status, lines = again(tmp_path / "runs", tmp_path / FILE)
    assert status == 0, lines
    folder = only_run(tmp_path / "runs")
    with BagReader(folder / "bag") as reader:
        estimates = recorded(reader, "track_circle").estimates
    assert estimates.value[0, estimates.names.index(name)] == pytest.approx(far, abs=0.02)
    assert summary(folder)["verdict"] == "good"


@pytest.mark.parametrize(
    ("old", "new", "changes", "names"),
    [
        ("version: 3", "version: 2", (), (FILE, "version", "2", "learn again")),
        ("digest: sha256:", "digest: sha256:0", (), (FILE, "digest", "robot file")),
        ("", "", ("robot=three_bellow_hanging",), (FILE, "robot", "three_bellow_hanging")),
        ("1/gain: [", "1/gain: [2.0, 0.1]  # [", (), (FILE, "link0/chamber1/gain", "-0.7 to 1")),
        ("", "", ("controller.law=adaptive",), ("controller.law", "adaptive", "composite")),
    ],
    ids=["version", "digest", "robot", "gain", "law"],
)
def test_what_does_not_fit_is_refused_in_one_line(domain, first, tmp_path, old, new, changes, names):
    from typer.testing import CliRunner

    from soro_core.errors import ConfigError
    from soro_ros.cli import application

    (tmp_path / FILE).write_text((first / FILE).read_text().replace(old, new, 1))
    options = [word for change in (*BRIEF, *changes) for word in ("--set", change)]
    where = ["--folder", str(tmp_path / "runs"), "--learn-from", str(tmp_path)]
    result = CliRunner().invoke(application(), ["run", "track_circle", *options, *where])
    assert isinstance(result.exception, ConfigError)
    assert all(name in str(result.exception) for name in names), result.exception
    assert "\n" not in str(result.exception)
    assert not (tmp_path / "runs").exists()  # nothing was started


def test_a_run_that_kept_nothing_is_named(domain, tmp_path):
    status, lines = again(tmp_path / "runs", tmp_path)
    assert status == 2
    (line,) = lines
    assert FILE in line
