"""What no arm can be: of a description, and among found numbers."""

import pytest
from made_recordings import LINK

from soro_core import load_robot
from soro_core.errors import ConfigError
from soro_core.robot import robot_from_dict
from soro_lab.identification.arm.cases.parameters import numbers_of, with_numbers
from soro_lab.identification.arm.cases.physical import check_described, unphysical

SHIPPED = ("asu_two_segment", "silicone_rod", "six_link", "tue_three_bellow")


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_robots_are_possible(name: str) -> None:
    robot = load_robot(name)
    check_described(robot, name)
    assert not unphysical(robot, {key: n.value for key, n in numbers_of(robot).items()})


@pytest.mark.parametrize(
    "changes",
    [{"mass": 100.0}, {"mass": 1e-4}, {"length": 100.0, "radius": 20.0}],
    ids=["grams for kilograms", "lighter than air", "millimetres for metres"],
)
def test_masses_that_no_matter_has_are_refused(changes: dict[str, float]) -> None:
    robot = robot_from_dict({"links": [LINK, {**LINK, **changes}], "pressure_range_pa": [0.0, 1e5]})
    with pytest.raises(ConfigError) as refused:
        check_described(robot, "arm.yaml")
    assert (refused.value.where, refused.value.key) == ("arm.yaml", "links[1].mass")


@pytest.mark.parametrize("mass", [0.8e-3, 2.5])
def test_a_film_tube_and_a_link_of_tungsten_are_possible(mass: float) -> None:
    robot = robot_from_dict({"links": [{**LINK, "mass": mass}], "pressure_range_pa": [0.0, 1e5]})
    check_described(robot, "arm.yaml")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("link0/k_b", 0.0),
        ("link0/k_e", float("nan")),
        ("link0/damping_b", -1e-9),
        ("link0/gain", 0.0),
        ("link0/chamber1/gain", -1.0),
        ("link0/arm", -0.1),
        ("link0/rise_b", -1.0),
        ("link0/length", 0.0),
        ("link0/creep_b", -0.1),
        ("link0/creep_b_tau", 0.0),
        ("link0/dahl_e", -0.1),
        ("link0/dahl_e_range", -1.0),
    ],
)
def test_signs(name: str, value: float) -> None:
    robot = load_robot("tue_three_bellow")
    assert [each.name for each in unphysical(robot, {name: value})] == [name]
    assert not unphysical(robot, {name: 1.0})


def test_a_modulus_that_no_matter_has() -> None:
    robot = load_robot("tue_three_bellow")
    stiff = with_numbers(robot, {"link0/k_b": 4e5 * 0.006})
    assert not unphysical(stiff, {"link0/k_b": 2400.0})
    soft = with_numbers(robot, {"link0/k_e": 0.05})
    assert [each.name for each in unphysical(soft, {"link0/k_e": 0.05})] == ["link0/E_e"]
    # A number that was not found is not judged.
    assert not unphysical(soft, {"link0/gain": 1.0})


def test_stiffnesses_of_no_section() -> None:
    robot = with_numbers(load_robot("tue_three_bellow"), {"link0/k_e": 10.0, "link0/k_b": 0.1})
    found = unphysical(robot, {"link0/k_e": 10.0, "link0/k_b": 0.1})
    assert [(each.name, each.numbers) for each in found] == [("link0/gyration", ("link0/k_e", "link0/k_b"))]
