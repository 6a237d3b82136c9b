"""Estimates of a new arm against other ways to the same number."""

import math

import numpy as np
import pytest

from soro_lab.scaffold import ScaffoldOptions, estimate, new_arm
from tests.refused import refused


@pytest.mark.parametrize("n", range(1, 8))
def test_chambers_fit_into_their_section(n):
    area, offset = estimate.chamber_of(0.01, n)
    own = math.sqrt(area / math.pi)
    assert own + offset < 0.01  # a wall outside
    angles = 2.0 * math.pi * np.arange(n) / n
    centres = offset * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for k in range(1, n):
        assert np.linalg.norm(centres[k] - centres[0]) > 2.0 * own  # a wall between two


@pytest.mark.parametrize("planar", [False, True])
def test_the_section_is_that_of_a_grid_of_points(planar):
    radius, area, offset, angles = 0.015, 4e-5, 0.009, [0.1, 1.0, 3.0]
    line = np.linspace(-radius, radius, 1501)
    x, y = np.meshgrid(line, line)
    solid = np.hypot(x, y) < radius
    for angle in angles:
        away = np.hypot(x - offset * math.cos(angle), y - offset * math.sin(angle))
        solid &= away > math.sqrt(area / math.pi)
    cell = (line[1] - line[0]) ** 2
    second = float(np.sum(x[solid] ** 2) * cell)
    if not planar:
        second = 0.5 * (second + float(np.sum(y[solid] ** 2) * cell))
    found = estimate.section_of(radius, area, offset, angles, planar)
    assert found.area_m2 == pytest.approx(np.sum(solid) * cell, rel=5e-3)
    assert found.second_moment_m4 == pytest.approx(second, rel=5e-3)


def test_the_radius_from_the_mass_gives_that_mass():
    radius = estimate.radius_of(0.08, 0.03, 1070.0, 3)
    area, offset = estimate.chamber_of(radius, 3)
    section = estimate.section_of(radius, area, offset, [0.0, 2.1, 4.2], False)
    assert 1070.0 * section.area_m2 * 0.08 == pytest.approx(0.03)


def test_the_modulus_for_the_weight_is_that_of_a_beam():
    section = estimate.Section(1e-4, 1e-9)
    # A beam that stands: E I = m g (L / 2) L / SAG.
    alone = estimate.modulus_for_weight([section], [0.1], [0.02])
    assert alone == pytest.approx(9.81 * 0.02 * 0.05 * 0.1 / (estimate.SAG * 1e-9))
    # The same beam in two halves.
    halves = estimate.modulus_for_weight([section] * 2, [0.05] * 2, [0.01] * 2)
    assert halves == pytest.approx(alone)


def test_a_material_that_is_not_given_moves_over_the_range_of_pressures():
    """Its stretch by all chambers at the highest pressure, from the numbers of the arm."""
    (link,) = new_arm(
        ScaffoldOptions("arm", length="60mm", radius="15mm", mass="20g", pressure_range="0,50kPa")
    ).links
    stretch = 3 * link.geometry.area.value * 50e3 / (link.k_e.value * 0.06)
    bend = link.geometry.area.value * link.geometry.offset.value * 50e3 / link.k_b.value
    assert max(stretch / estimate.STRETCH, bend / estimate.BEND) == pytest.approx(1.0, rel=1e-3)


def test_stiffness_follows_section_and_modulus():
    """From a section with three round holes and the modulus that the comment names."""
    (link,) = new_arm(ScaffoldOptions("arm", length="0.1", radius="10mm")).links
    modulus = 1e3 * float(link.k_e.note.partition("E = ")[2].split()[0])
    hole, offset = link.geometry.area.value, link.geometry.offset.value
    area = math.pi * 1e-4 - 3 * hole
    second = math.pi * 1e-8 / 4 - 3 * (hole**2 / (4 * math.pi) + 0.5 * hole * offset**2)
    assert link.k_e.value == pytest.approx(modulus * area / 0.1, rel=1e-3)
    assert link.k_b.value == pytest.approx(modulus * second / 0.1, rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"name": "My-Arm"}, "ARM"),
        ({"name": "../arm"}, "ARM"),
        ({"name": "3arm"}, "ARM"),
        ({"mounting": "leaning"}, "--mounting"),
        ({"mass": "10kg", "radius": "10mm"}, "--mass"),
        ({"mass": "0.1g", "radius": "30mm"}, "--mass"),
        ({"mass": "3kg"}, "--mass"),
        ({"planar": True, "chambers": "3"}, "--chambers"),
    ],
)
def test_an_arm_that_cannot_be_is_refused(changes, key):
    with refused(key):
        new_arm(ScaffoldOptions(**{"name": "arm", "length": "80mm", **changes}))
