"""The frames that were found become the calibration of the robot."""

from __future__ import annotations

import numpy as np
import pytest

from soro_core import load_robot
from soro_lab.identification.arm.frames import calibrated
from soro_lab.identification.recording import Place, Plate
from soro_lab.identification.recording.streams import Bend

T = np.zeros(1)
PLATE = Plate("tip", T, Place(0), np.zeros((1, 3)), np.array([[0.0, 0.0, 0.0, 1.0]]), "ceiling")


def test_the_calibration_has_the_frame_of_the_tracker_and_its_bodies() -> None:
    names = [f"frame/{what}_{axis}" for what in ("ceiling/turn", "ceiling/offset") for axis in "xyz"]
    names += [f"frame/tip/{what}_{axis}" for what in ("turn", "offset") for axis in "xyz"]
    values = dict(zip(names, [0.0, 0.0, np.pi, 1.0, 2.0, 3.0, np.pi, 0.0, 0.0, 0.1, 0.2, 0.3], strict=True))
    found = calibrated(load_robot("tue_three_bellow"), [PLATE], values).calibration
    assert found.tracker_position == (1.0, 2.0, 3.0)
    assert found.tracker_quaternion == pytest.approx((0.0, 0.0, 1.0, 0.0), abs=1e-12)
    assert found.bodies[0].at == pytest.approx(1.0)
    assert found.bodies[0].offset_m == (0.1, 0.2, 0.3)
    assert found.bodies[0].quaternion == pytest.approx((1.0, 0.0, 0.0, 0.0), abs=1e-12)


def test_a_calibration_that_no_frame_replaces_stays() -> None:
    robot = load_robot("tue_three_bellow")
    assert calibrated(robot, [Bend("bend", T, 0, T)], {}).calibration == robot.calibration
