"""An arm that an IMU alone shows: its rotations find what bends, in a world of their own."""

from dataclasses import replace

import numpy as np
import pytest
from made_arm import MOUNT, TRACKER, record
from scipy.spatial.transform import Rotation

from soro_core import load_robot
from soro_core.robot import Robot
from soro_lab.identification.arm.cases.parameters import with_numbers
from soro_lab.identification.arm.laws import LAWS, plain
from soro_lab.identification.arm.report.found import frames_of
from soro_lab.identification.arm.stages import ArmIdentification, IdentificationOptions, identify
from soro_lab.identification.recording import Imu, Recording

TRUTH = {
    "link0/k_b": 7.5e-3,
    "link0/damping_b": 2e-7,
    "link0/gain": 1.25,
    "link0/chamber1/gain": 0.93,
    "link0/chamber2/gain": 1.08,
}
NAME = "sensors/imu0"


def by_imu(made: Recording, noise_rad: float = 0.01) -> Recording:
    """Return the recording with an IMU in place of its plate; some of its orientations are not known."""
    plate = made.plates[0]
    noise = np.random.default_rng(7).normal(0.0, noise_rad, (len(plate.t), 3))
    quaternion = (Rotation.from_quat(plate.quaternion) * Rotation.from_rotvec(noise)).as_quat()
    quaternion[::50] = 0.0
    nothing = np.zeros((len(plate.t), 3))
    return replace(made, plates=(), imus=(Imu(NAME, plate.t, plate.place, nothing, nothing, quaternion),))


@pytest.fixture(scope="module")
def guess() -> Robot:
    return with_numbers(plain(load_robot("tue_three_bellow")), {"link0/damping_b": 1e-7})


@pytest.fixture(scope="module")
def found(guess: Robot) -> ArmIdentification:
    laws = tuple(law for law in LAWS if law.name in ("area slope", "creep"))
    options = IdentificationOptions(dt_s=0.005, rate_hz=20.0, laws=laws, is_constant=True, starts=1)
    return identify(guess, [by_imu(record(with_numbers(guess, TRUTH)))], options)


@pytest.mark.slow
def test_what_bends_is_found(found: ArmIdentification) -> None:
    assert found.choice is not None
    assert found.choice.chosen.laws == ()
    sure = 0
    for name, truth in TRUTH.items():
        if name in found.kept:
            continue
        value, deviation = found.solution.values[name], found.certainty.deviations[name]
        assert abs(np.log(value / truth)) < max(2.5 * deviation, 0.03), f"{name}: {value} +- {deviation}"
        sure += deviation < 0.05
    assert sure >= 3
    # Rotations say nothing of how long the arm is.
    assert "link0/k_e" not in found.solution.values


def test_the_world_of_the_imu_and_its_mount_are_found(found: ArmIdentification) -> None:
    frames = frames_of(found)
    for entry, truth in ((frames["worlds"], TRACKER), (frames["bodies"], MOUNT)):
        (own,) = entry
        assert own["name"] == NAME
        assert own["offset_m"] is None
        assert (Rotation.from_rotvec(own["rotation_vector_rad"]).inv() * truth).magnitude() < 0.02


def test_a_pose_sensor_precedes_an_imu(guess: Robot) -> None:
    made = record(guess, hold_s=0.3)
    assert [shape.name for shape in by_imu(made).shapes] == [NAME]
    both = replace(by_imu(made), plates=made.plates)
    assert [shape.name for shape in both.shapes] == ["tip"]
    silent = replace(both.imus[0], orientation=None)
    assert replace(both, plates=(), imus=(silent,)).shapes == ()
