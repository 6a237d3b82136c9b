"""A controller refuses chambers whose first pressures do nothing."""

import pytest

from soro_core import load_robot
from soro_core.control import Controller
from soro_core.errors import ConfigError


def test_a_controller_refuses_a_dead_band() -> None:
    robot = load_robot("tue_three_bellow")
    link = robot.links[0].model_dump(exclude_none=True)
    link["chambers"][1]["dead_band_pa"] = 2400.0
    with pytest.raises(ConfigError) as caught:
        Controller(robot.replace(links=[link]))
    assert (caught.value.where, caught.value.key) == ("controller", "dead_band_pa")
    assert "2400 of link0/chamber1" in str(caught.value)
