"""What a fit begins with: which runs it sees, and a frame for each tracker."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soro_core import SoftArm, load_robot
from soro_core.errors import ConfigError
from soro_core.robot import Robot
from soro_lab.identification.arm.cases.case import Rests
from soro_lab.identification.arm.frames import frame_numbers
from soro_lab.identification.arm.judge import squares
from soro_lab.identification.arm.search.prepare import split
from soro_lab.identification.recording import Marker, Place, Recording, Series

# Where both trackers stand [m].
PLACE = np.array([0.1, 0.2, 0.3])


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("tue_three_bellow")


def step(name: str, robot: Robot) -> Recording:
    """One step and no rest after it: one section."""
    t = np.arange(0.0, 1.0, 0.01)
    pressure = np.outer(t > 0.1, [1e4, 0.0, 0.0])
    place = np.column_stack([0.01 * (t > 0.1) * np.sin(40.0 * t), 0.0 * t, 0.0 * t])
    marker = Marker("tip", t, Place(0), place + 1e-6 * np.random.default_rng(1).normal(size=(100, 3)))
    return Recording(name, robot.chamber_names, Series("pressure", t, pressure), markers=(marker,))


def test_whole_runs_are_held_out_where_each_has_one_section(robot: Robot) -> None:
    fit, held = split([step(str(k), robot) for k in range(7)], 0.01, 50.0)
    assert [case.name for case in held] == ["1", "5"]
    assert [case.name for case in fit] == ["0", "2", "3", "4", "6"]


def test_named_runs_are_held_out_whole(robot: Robot) -> None:
    fit, held = split([step(str(k), robot) for k in range(4)], 0.01, 50.0, ("0", "2"))
    assert [case.name for case in held] == ["0", "2"]
    assert [case.name for case in fit] == ["1", "3"]
    with pytest.raises(ConfigError) as caught:
        split([step(str(k), robot) for k in range(4)], 0.01, 50.0, ("0", "7"))
    assert caught.value.key == "hold_out"


def _other_stream(recording: Recording) -> Recording:
    return replace(recording, markers=(replace(recording.markers[0], name="middle"),))


def test_a_stream_that_no_fit_sees_does_not_judge(robot: Robot) -> None:
    runs = [step("0", robot), _other_stream(step("1", robot))]
    fit, held = split(runs, 0.01, 50.0)
    assert ([case.name for case in fit], held) == (["0", "1"], [])
    with pytest.raises(ConfigError) as caught:
        split(runs, 0.01, 50.0, ("1",))
    assert caught.value.got == "middle"


def test_of_a_single_run_nothing_is_held_out(robot: Robot) -> None:
    fit, held = split([step("alone", robot)], 0.01, 50.0)
    assert ([case.name for case in fit], held) == (["alone"], [])


def test_each_tracker_has_its_numbers(robot: Robot) -> None:
    arm = SoftArm(robot)
    pressure = 2e4 * np.vstack([np.zeros(3), np.eye(3), 0.5 * np.eye(3)])
    t = np.arange(7.0)
    plain = Rests("rest", pressure, (Marker("a", t, Place(0), np.zeros((7, 3))),))
    tip = arm.poses(plain.simulated(arm, {}).q, arm.length)[:, :3, 3]
    turns = {
        "tracker": Rotation.from_rotvec([0.3, 0.0, 0.0]),
        "second": Rotation.from_rotvec([0.0, 0.5, 0.0]),
    }
    markers = tuple(
        Marker(f"of_{frame}", t, Place(0), turn.apply(tip) + PLACE, frame=frame)
        for frame, turn in turns.items()
    )
    found = {n.name: n.value for n in frame_numbers(arm, [replace(plain, shapes=markers)])}
    for frame, turn in turns.items():
        seen = Rotation.from_rotvec([found[f"frame/{frame}/turn_{x}"] for x in "xyz"])
        assert (seen.inv() * turn).magnitude() < 1e-6
        np.testing.assert_allclose([found[f"frame/{frame}/offset_{x}"] for x in "xyz"], PLACE)


def test_what_hardly_moves_does_not_judge() -> None:
    t = np.arange(0.0, 1.0, 0.1)
    still, moving = (Marker(name, t, Place(0), np.zeros((10, 3))) for name in ("still", "moving"))
    case = Rests("run", np.zeros((1, 1)), (still, moving))
    rows = [np.full((10, 3), 1e-4), np.zeros((10, 3))]
    assert squares([case], [rows], {"still": 1e-4, "moving": 1e-2}) == (0.0,)
    assert squares([case], [rows], {"still": 2e-3, "moving": 1e-2}) > (0.0,)
