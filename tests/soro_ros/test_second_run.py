"""A second program that would be or drive the same arm gives way, and the working one goes on."""

from __future__ import annotations

import sys

import pytest

from tests.patience import COMPILED_S, LIMIT_S
from tests.soro_ros.running import SORO, ClockListener, end, only_run, start_run, summary
from tests.warm import completed

pytestmark = pytest.mark.process

BRIEF = ("mode=lockstep", "platform=", "duration_s=2")


def test_of_two_runs_that_start_together_one_goes_on_and_one_is_refused(domain, tmp_path):
    folders = [tmp_path / name for name in ("one", "other")]
    processes = [start_run(folder, *BRIEF) for folder in folders]
    try:
        said = [process.communicate(timeout=2 * COMPILED_S)[1] for process in processes]
    finally:
        for process in processes:
            process.kill()
    status = [process.returncode for process in processes]
    assert sorted(status) == [0, 2], said
    good, refused = (summary(only_run(folders[status.index(code)])) for code in (0, 2))
    assert (good["verdict"], good["faults"]) == ("good", [])
    assert refused["verdict"] == "refused"
    (line,) = said[status.index(2)].strip().splitlines()
    assert "ROS_DOMAIN_ID" in line
    assert str(processes[status.index(0)].pid) in line


@pytest.fixture(scope="module")
def working(tmp_path_factory):
    """A run in lockstep that goes on until the test ends it; its process and its folder."""
    from tests.soro_ros.conftest import own_domain

    folder = tmp_path_factory.mktemp("working")
    with own_domain(tmp_path_factory.mktemp("state")):
        clock = ClockListener()
        process = start_run(folder, "mode=lockstep", "platform=", "duration_s=1000")
        try:
            clock.wait(1.0, COMPILED_S)
            yield process, folder
        finally:
            clock.close()
            if process.poll() is None:
                end(process)
    assert summary(only_run(folder))["faults"] == []


def node(name: str, *options: str) -> list[str]:
    arguments = [part for option in options for part in ("-p", option)]
    return [
        sys.executable,
        "-m",
        f"soro_ros.nodes.{name}",
        "--ros-args",
        "-r",
        "__ns:=/track_circle",
        *arguments,
    ]


# In the place of the recording of the working run.
BAG = "BAG"
NEWCOMERS = {
    "run": [*SORO, "run", "track_circle"],
    "excite": [*SORO, "excite", "track_circle"],
    "controller": node("controller"),
    "twin": node("twin"),
    "arm": node("arm"),
    "regulator": node("regulator", "device:=/nowhere"),
    "play": [*SORO, "play", BAG],
    "a part of it": [*SORO, "play", BAG, "--topic", "/track_circle/sensors/*"],
}


@pytest.mark.parametrize("newcomer", NEWCOMERS)
def test_a_newcomer_is_refused_beside_a_working_arm(working, tmp_path, newcomer):
    first, folder = working
    bag = str(only_run(folder) / "bag")
    command = [bag if part == BAG else part for part in NEWCOMERS[newcomer]]
    ended = completed(command, LIMIT_S, cwd=tmp_path)
    assert ended.returncode == 2, ended.stderr
    (line,) = [one for one in ended.stderr.splitlines() if "allowed:" in one]
    assert "ROS_DOMAIN_ID" in line
    assert "namespace" in line
    assert first.poll() is None
