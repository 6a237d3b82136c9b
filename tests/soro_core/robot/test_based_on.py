"""A robot file that changes some keys of another one."""

import pytest

from soro_core import load_robot
from soro_core.config import config_folder
from tests.refused import refused

HANGING = "based_on: {}\nbase_quaternion: [1.0, 0.0, 0.0, 0.0]\n"


def test_a_file_has_the_keys_of_the_other_but_its_own(tmp_path):
    (tmp_path / "hung.yaml").write_text(HANGING.format("tue_three_bellow"))
    found, other = load_robot(tmp_path / "hung.yaml"), load_robot("tue_three_bellow")
    assert found.name == "hung"
    assert found.base_quaternion == (1.0, 0.0, 0.0, 0.0)
    assert found.replace(name=other.name, base_quaternion=other.base_quaternion) == other


def test_a_file_beside_it_counts_before_a_shipped_one(tmp_path):
    shipped = (config_folder() / "robots/tue_three_bellow.yaml").read_text()
    (tmp_path / "other.yaml").write_text(shipped.replace("tip_mass: 0.0", "tip_mass: 0.5"))
    (tmp_path / "hung.yaml").write_text(HANGING.format("other.yaml"))
    assert load_robot(tmp_path / "hung.yaml").tip_mass == 0.5


@pytest.mark.parametrize(
    ("other", "allowed"),
    [
        ("five: 5", "a robot file"),
        ("three_bellow_hanging", "not based on another one"),
        ("nobody", "tue_three_bellow"),
    ],
)
def test_another_that_is_none_is_refused(tmp_path, other, allowed):
    file = tmp_path / "hung.yaml"
    file.write_text(HANGING.format(f"{{{other}}}" if ":" in other else other))
    with refused("" if other == "nobody" else "based_on", names=(allowed,)):
        load_robot(file)
