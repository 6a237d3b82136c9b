"""A range of pressures that can collapse a link: named at load, with chamber and pressure."""

import cmath
import itertools
import logging

import pytest
import yaml

from soro_core.robot import Robot, load_robot, robot_from_dict
from soro_core.robot.collapse import collapsing
from tests.refused import refused

LENGTH, K_E, K_B, ALPHA = 0.1, 400.0, 0.05, 2e-7
LIMIT_PA = 0.32476 * LENGTH**2 * (K_E * K_B) ** 0.5 / ALPHA


def described(high_pa, low_pa=0.0, alpha_eps=0.0, robot=None, **keys):
    chambers = [
        {"angle_rad": 0.3, "alpha_eps": alpha_eps, "alpha_kappa": ALPHA},
        {"angle_rad": 2.4, "alpha_eps": alpha_eps, "alpha_kappa": 0.5 * ALPHA},
    ]
    # At rest the laws have the stiffness K_E and K_B.
    link = {"length": LENGTH, "radius": 0.02, "mass": 0.05, "chambers": chambers}
    link |= {"k_e": [K_E + 300.0, 300.0, 30.0], "k_b": [3.0 * K_B, 2.0 * K_B, 0.5], **keys}
    return {"links": [link, link], "pressure_range_pa": [low_pa, high_pa], **(robot or {})}


def lines(caplog):
    return [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]


def test_one_line_names_each_chamber_and_its_pressure(caplog, tmp_path):
    file = tmp_path / "soft.yaml"
    file.write_text(yaml.safe_dump(described(1.5 * LIMIT_PA)))
    load_robot(file)
    (line,) = lines(caplog)
    assert "\n" not in line
    assert line.startswith(f"{file}: pressure_range_pa")
    assert line.count(f"{1e-3 * LIMIT_PA:.4g} kPa in link0/chamber0") == 1
    assert "link1/chamber0" in line
    assert "chamber1" not in line
    assert f"{1.5e-3 * LIMIT_PA:.6g} kPa" in line


@pytest.mark.parametrize(
    "changes",
    [
        {"high_pa": 0.99 * LIMIT_PA},
        {"high_pa": 0.99 * LIMIT_PA, "low_pa": -0.99 * LIMIT_PA},
        {"robot": {"bend_angle": "geometric"}},
        {"least_elongation": -0.5},
        {"strains": {"bending_x": {}, "bending_y": {}}},
    ],
)
def test_no_line_without_a_collapse_in_the_range(caplog, changes):
    robot_from_dict(described(**{"high_pa": 1.01 * LIMIT_PA, **changes}))
    assert lines(caplog) == []


def test_shipped_robots_load_without_one(caplog):
    for name in (
        "asu_two_segment",
        "six_link",
        "silicone_rod",
        "silicone_rod_planar",
        "srl_one_segment",
        "tue_three_bellow",
    ):
        load_robot(name)
    assert lines(caplog) == []


def test_a_vacuum_shortens_the_link_beside():
    """The limit P of the chamber alone falls to P (1 - e)^2, e its own compression at that pressure."""
    robot = Robot(**described(1e3, -101325.0, alpha_eps=1e-5))
    (found, *_) = collapsing(robot)
    assert found.chambers == ("link0/chamber0",)
    share = found.pressure_pa / -LIMIT_PA
    e = 1e-5 * -found.pressure_pa / (K_E * LENGTH**2)
    assert share == pytest.approx((1.0 - e) ** 2, rel=1e-4)
    assert 0.5 < share < 0.9


@pytest.mark.parametrize("angles", [(0.0, 1.5, 3.1, 4.7), (0.2, 1.2, 0.7)])
def test_chambers_that_bend_a_link_together_are_named_together(angles):
    """At the pressure by which the largest sum of their moments is that of one at its limit."""
    given = [{"angle_rad": angle, "alpha_eps": 0.0, "alpha_kappa": ALPHA} for angle in angles]
    sums = {}
    for chosen in itertools.product((False, True), repeat=len(angles)):
        sums[chosen] = abs(sum(cmath.exp(1j * a) for a, take in zip(angles, chosen, strict=True) if take))
    most = max(sums, key=sums.get)
    (found, *_) = collapsing(Robot(**described(0.999 * LIMIT_PA, chambers=given)))
    assert found.chambers == tuple(f"link0/chamber{k}" for k, take in enumerate(most) if take)
    assert found.pressure_pa == pytest.approx(LIMIT_PA / sums[most], rel=1e-5)
    (alone, *_) = collapsing(Robot(**described(1.001 * LIMIT_PA, chambers=given)))
    assert alone.chambers == ("link0/chamber0",)


def test_what_several_chambers_lengthen_a_link_by_counts():
    given = [{"angle_rad": a, "alpha_eps": 2e-5, "alpha_kappa": ALPHA} for a in (0.0, 1.5)]
    assert collapsing(Robot(**described(0.999 * LIMIT_PA, chambers=given))) == []


def test_parts_of_a_link_collapse_where_it_does():
    robot = Robot(**described(1.5 * LIMIT_PA))
    for one, part in zip(collapsing(robot), collapsing(robot.refine(3)), strict=True):
        assert part.chambers == one.chambers
        assert part.pressure_pa == pytest.approx(one.pressure_pa, rel=1e-12)


def test_walls_belong_to_laws_on_elongation():
    with refused("links[0].least_elongation", -0.5):
        robot_from_dict(described(1e3, least_elongation=-0.5, strains={"bending_x": {}, "bending_y": {}}))
    material = {"youngs_modulus": 5e5, "shear_modulus": 1.7e5}
    with refused("links[0].least_elongation", -0.5):
        robot_from_dict(described(1e3, least_elongation=-0.5, material=material, k_e=None, k_b=None))
