"""A name of a stream stands for one sensor in all recordings."""

import numpy as np
import pytest

from soro_core import load_robot
from soro_core.errors import ConfigError
from soro_lab.identification.arm.stages import identify
from soro_lab.identification.recording import Bend, Curvature, Place, Recording, Series, check_names

T = np.linspace(0.0, 1.0, 50)
ROBOT = load_robot("tue_three_bellow")


def run(name: str, *, bends: str = "", curvatures: str = "") -> Recording:
    pressure = Series("pressure", T, np.zeros((50, 3)))
    seen = np.column_stack([np.sin(9.0 * T), np.cos(9.0 * T)])
    return Recording(
        name,
        ROBOT.chamber_names,
        pressure,
        bends=(Bend(bends, T, Place(0), np.sin(9.0 * T)),) if bends else (),
        curvatures=(Curvature(curvatures, T, Place(0), seen),) if curvatures else (),
    )


def test_one_name_for_two_kinds_is_refused_before_the_search() -> None:
    with pytest.raises(ConfigError) as caught:
        identify(ROBOT, [run("forced", curvatures="segment"), run("release", bends="segment")])
    assert (caught.value.where, caught.value.key) == ("release", "segment")


def test_one_name_for_one_kind_and_two_names_for_two_are_allowed() -> None:
    check_names([run("a", curvatures="segment"), run("b", curvatures="segment"), run("c", bends="bend")])
