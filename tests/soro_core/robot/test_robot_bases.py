"""Strain bases: sizes, names, shape functions, integrals over the link, modes from files, refined links."""

import json
import math
from unittest.mock import ANY

import numpy as np
import pytest
import yaml
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

from soro_core.errors import ModelError
from soro_core.robot import (
    StrainField,
    link_damping,
    link_stiffness,
    load_robot,
    robot_from_dict,
    shape_integrals,
    shape_values,
    strain_rows,
)
from tests.refused import refused
from tests.small_links import LAW

LENGTH, RADIUS = 0.2, 0.015
MATERIAL = {"youngs_modulus": 5e5, "shear_modulus": 1.6e5, "viscosity": 300.0, "shear_factor": 0.9}
LINK = {"length": LENGTH, "radius": RADIUS, "mass": 0.15, "material": MATERIAL}
AT = np.linspace(0.0, 1.0, 21)
MODES = np.stack([np.exp(AT), np.sin(3 * AT), AT**2], axis=1)
POD = {"basis": "pod", "samples": MODES.tolist(), "modes": 2}
MIXED = {
    "bending_x": {"basis": "legendre", "order": 3},
    "elongation": {"basis": "constant"},
    "bending_y": {"basis": "chebyshev", "order": 2},
    "shear_x": POD,
    "torsion": {"basis": "legendre", "order": 0},
}
NAMES = (
    *(f"bending_x_{k}" for k in range(4)),
    "elongation",
    *(f"bending_y_{k}" for k in range(3)),
    "shear_x_0",
    "shear_x_1",
    "torsion_0",
)


def one(strains, **keys):
    """Robot of one link with these strains."""
    return robot_from_dict({"links": [{**LINK, "strains": strains, **keys}]})


def per_length(m=MATERIAL):
    area, inertia = math.pi * RADIUS**2, math.pi * RADIUS**4 / 4
    E, G, eta = m["youngs_modulus"], m["shear_modulus"], m["viscosity"]
    stiffness = {
        "bending_x": E * inertia,
        "bending_y": E * inertia,
        "elongation": E * area,
        "shear_x": m["shear_factor"] * G * area,
        "torsion": 2 * G * inertia,
    }
    damping = {
        "bending_x": 3 * eta * inertia,
        "bending_y": 3 * eta * inertia,
        "elongation": 3 * eta * area,
        "shear_x": eta * area,
        "torsion": 2 * eta * inertia,
    }
    return stiffness, damping


def test_names_and_sizes_follow_the_order_given():
    robot = one(MIXED, damping=[0.1] * 11)
    link = robot.links[0]
    assert link.coordinates == NAMES
    assert robot.coordinate_names == tuple(f"link0/{name}" for name in NAMES)
    assert link.n_q == robot.n_q == len(NAMES) == 11
    assert strain_rows(link) == tuple(name.rstrip("0123456789").rstrip("_") for name in NAMES)
    assert [field.size for field in link.strains.values()] == [4, 1, 3, 2, 1]
    both = robot.replace(links=[*robot.links, {**LAW, "strains": {"bending_y": {}}}])
    assert both.n_q == 12
    assert both.coordinate_names[-1] == "link1/bending_y"


@pytest.mark.parametrize(
    ("field", "size"),
    [
        (StrainField(), 1),
        (StrainField(basis="legendre", order=12), 13),
        (StrainField(basis="chebyshev", order=0), 1),
        (StrainField(basis="pod", samples=MODES.astype(np.float32)), 3),
        (StrainField(basis="pod", samples=MODES, modes=2), 2),
    ],
)
def test_size_of_a_field(field, size):
    assert field.size == size


def test_shape_functions():
    link = one(MIXED).links[0]
    sigma = np.array([0.0, 0.03, 0.1, 0.17, LENGTH])
    x = 2 * sigma / LENGTH - 1
    spline = CubicSpline(AT * LENGTH, MODES)(sigma)
    want = [
        *(np.ones(5), x, (3 * x**2 - 1) / 2, (5 * x**3 - 3 * x) / 2),
        np.ones(5),
        *(np.ones(5), x, 2 * x**2 - 1),
        *(spline[:, 0], spline[:, 1]),
        np.ones(5),
    ]
    np.testing.assert_allclose(shape_values(link, sigma), want, rtol=1e-13, atol=1e-14)


def test_shape_functions_meet_the_samples_and_the_ends():
    link = one({"bending_x": {**POD, "modes": 3}, "bending_y": {"basis": "chebyshev", "order": 12}}).links[0]
    np.testing.assert_allclose(shape_values(link, AT * LENGTH)[:3], MODES.T, rtol=1e-14, atol=1e-15)
    ends = shape_values(link, [-1e-11, LENGTH * (1 + 1e-10)])
    np.testing.assert_array_equal(ends[3:], [[(-1.0) ** k, 1.0] for k in range(13)])


@pytest.mark.parametrize("sigma", [[-0.01], [0.1, LENGTH * 1.001], [np.nan], [np.inf], [[0.1]]])
def test_shape_functions_outside_of_the_link_are_refused(sigma):
    with pytest.raises(ModelError, match=r"sigma.*0\.2"):
        shape_values(one(MIXED).links[0], sigma)


def test_integrals_agree_with_adaptive_quadrature():
    link = one(MIXED).links[0]
    rows = strain_rows(link)
    knots = AT[1:-1] * LENGTH
    want = np.zeros((11, 11))
    for a in range(11):
        for b in range(a, 11):
            if rows[a] == rows[b]:
                points = knots if rows[a] == "shear_x" else None
                want[a, b] = want[b, a] = quad(
                    lambda s, a=a, b=b: np.prod(shape_values(link, [s])[[a, b], 0]),
                    0.0,
                    LENGTH,
                    epsabs=1e-13,
                    epsrel=1e-11,
                    points=points,
                    limit=100,
                )[0]
    got = shape_integrals(link)
    np.testing.assert_allclose(got, want, rtol=1e-10, atol=1e-12)
    stiffness, damping = per_length()
    np.testing.assert_allclose(
        link_stiffness(link), [[stiffness[r]] for r in rows] * want, rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(link_damping(link), [[damping[r]] for r in rows] * want, rtol=1e-9, atol=1e-9)
    for matrix in (got, link_stiffness(link), link_damping(link)):
        np.testing.assert_array_equal(matrix, matrix.T)


@pytest.mark.parametrize("order", [0, 1, 4, 12])
def test_legendre_polynomials_are_orthogonal(order):
    link = one({"bending_x": {"basis": "legendre", "order": order}}).links[0]
    want = np.diag(LENGTH / (2 * np.arange(order + 1) + 1))
    np.testing.assert_allclose(shape_integrals(link), want, rtol=1e-13, atol=1e-16)


def test_chebyshev_integrals_in_closed_form():
    """int T_a T_b over -1 ... 1 = 1 / (1 - (a + b)^2) + 1 / (1 - (a - b)^2) for a + b even, else 0."""
    link = one({"bending_x": {"basis": "chebyshev", "order": 12}}).links[0]
    a, b = np.meshgrid(range(13), range(13))
    with np.errstate(divide="ignore"):
        even = 1 / (1 - (a + b) ** 2) + 1 / (1 - (a - b) ** 2)
    want = LENGTH / 2 * np.where((a + b) % 2 == 0, even, 0.0)
    np.testing.assert_allclose(shape_integrals(link), want, rtol=1e-12, atol=1e-16)


def test_constant_fields_keep_their_exact_diagonal():
    strains = ("torsion", "bending_x", "elongation", "shear_x")
    link = one({name: {"basis": "constant"} for name in strains}, damping=[0.1, 0.2, 0.3, 0.4]).links[0]
    stiffness, damping = per_length()
    np.testing.assert_array_equal(
        link_stiffness(link, 0.98),
        np.diag([stiffness[n] * (0.98 if n == "bending_x" else 1.0) * LENGTH for n in strains]),
    )
    np.testing.assert_allclose(
        link_damping(link),
        np.diag(np.array([0.1, 0.2, 0.3, 0.4]) + [damping[n] * LENGTH for n in strains]),
        rtol=1e-15,
    )


def test_damping_given_is_added_to_the_diagonal():
    given = np.arange(1.0, 12.0)
    bare, damped = one(MIXED).links[0], one(MIXED, damping=given.tolist()).links[0]
    np.testing.assert_allclose(link_damping(damped), link_damping(bare) + np.diag(given), rtol=1e-15)
    law = robot_from_dict({"links": [{**LAW, "strains": {"bending_x": {"basis": "legendre", "order": 1}}}]})
    np.testing.assert_array_equal(link_stiffness(law.links[0]), np.zeros((2, 2)))
    np.testing.assert_array_equal(link_damping(law.links[0]), np.zeros((2, 2)))


def test_a_robot_goes_through_a_dictionary_unchanged():
    robot = one(MIXED, damping=[0.1] * 11, creep=[{"tau": 0.1, "stiffness": [1.0] * 11}])
    assert robot_from_dict(robot.model_dump()) == robot
    assert robot_from_dict(robot.model_dump(exclude_unset=True)) == robot
    assert robot_from_dict(json.loads(robot.model_dump_json())) == robot
    assert robot.replace(tip_mass=0.01).links == robot.links
    assert robot.scaled(stiffness=2.0).links[0].strains == robot.links[0].strains
    np.testing.assert_allclose(
        link_stiffness(robot.scaled(stiffness=2.0).links[0]), 2 * link_stiffness(robot.links[0]), rtol=1e-14
    )


@pytest.mark.parametrize("ending", ["npy", "npz", "csv"])
def test_modes_from_a_file_beside_the_robot(tmp_path, ending):
    name = f"modes.{ending}"
    if ending == "npy":
        np.save(tmp_path / name, MODES)
    elif ending == "npz":
        np.savez(tmp_path / name, modes=MODES)
    else:
        np.savetxt(tmp_path / name, MODES, delimiter=",", fmt="%.18e", header="three modes")
    field = {"basis": "pod", "file": name}
    data = {"name": "robot", "links": [{**LINK, "strains": {"bending_x": field, "bending_y": {}}}]}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(data))
    robot = load_robot(tmp_path / "robot.yaml")
    assert robot.coordinate_names == tuple(
        f"link0/{name}" for name in ("bending_x_0", "bending_x_1", "bending_x_2", "bending_y")
    )
    np.testing.assert_array_equal(robot.links[0].strains["bending_x"].samples, MODES)
    # The samples are in the robot: changed copies and dictionaries need the file no more.
    (tmp_path / name).unlink()
    assert robot_from_dict(robot.model_dump()) == robot
    assert robot.replace(tip_mass=0.01).n_q == 4
    with refused("links[0].strains.bending_x.file"):
        robot_from_dict(data)


def test_a_file_in_a_dictionary_is_relative_to_the_working_directory(tmp_path, monkeypatch):
    np.save(tmp_path / "modes.npy", MODES[:, :1].astype(np.float32))
    monkeypatch.chdir(tmp_path)
    field = {"basis": "pod", "file": "modes.npy"}
    assert one({"bending_x": field}).links[0].coordinates == ("bending_x_0",)
    assert field == {"basis": "pod", "file": "modes.npy"}


def test_a_file_that_nothing_read_is_refused():
    robot = one({"bending_x": {}})
    links = [{**LINK, "strains": {"bending_x": {"basis": "pod", "file": "modes.npy"}}}]
    with refused("links[0].strains.bending_x.file", "modes.npy", ("samples",)):
        robot.replace(links=links)


def test_refined_polynomials_keep_energy_and_losses_of_a_uniform_strain():
    robot = one(
        {"bending_x": {"basis": "legendre", "order": 2}, "elongation": {"basis": "chebyshev", "order": 1}}
    )
    fine = robot.refine(4)
    assert fine.n_q == 20
    assert fine.coordinate_names[5:7] == ("link1/bending_x_0", "link1/bending_x_1")
    uniform = np.array([3.0, 0.0, 0.0, 0.1, 0.0])
    for matrix in (link_stiffness, link_damping):
        whole = uniform @ matrix(robot.links[0]) @ uniform
        parts = sum(uniform @ matrix(part) @ uniform for part in fine.links)
        assert parts == pytest.approx(whole, rel=1e-13)
    # A linear strain is one in the parts too: slope / 4, and the values at their middles.
    linear = np.array([0.0, 2.0, 0.0, 0.0, 0.0])
    whole = linear @ link_stiffness(robot.links[0]) @ linear
    parts = [np.array([2.0 * (2 * i + 1 - 4) / 4, 0.5, 0, 0, 0]) for i in range(4)]
    energies = [q @ link_stiffness(part) @ q for q, part in zip(parts, fine.links, strict=True)]
    assert sum(energies) == pytest.approx(whole, rel=1e-13)


@pytest.mark.parametrize(
    ("strains", "keys", "key", "got"),
    [
        (MIXED, {}, "strains.shear_x.basis", "pod"),
        (
            {"bending_x": {"basis": "legendre", "order": 1}},
            {"damping": [0.1, 0.2]},
            "damping",
            [0.1, 0.2],
        ),
        (
            {"bending_x": {"basis": "legendre", "order": 0}, "elongation": {}},
            {"creep": [{"tau": 0.1, "stiffness": [1.0, 1.0]}]},
            "creep",
            ANY,
        ),
        (
            {"bending_x": {"basis": "chebyshev", "order": 1}, "elongation": {}},
            {"hysteresis": [{"stiffness": [0.0, 0.0, 1.0], "range": [1.0] * 3}]},
            "hysteresis",
            ANY,
        ),
    ],
)
def test_links_that_cannot_be_split(strains, keys, key, got):
    robot = one(strains, **keys)
    assert robot.refine(1) is robot
    with refused(f"links[0].{key}", got) as caught:
        robot.refine(2)
    assert "refine(2)" in caught.value.where


def test_laws_may_vary_along_the_link():
    field = {"basis": "legendre", "order": 2}
    link = {**LAW, "strains": {"elongation": field, "bending_x": field, "bending_y": field}}
    link["chambers"] = [{"angle_rad": 0.0, "area_m2": 1e-4, "offset_m": 0.01, "area_slope": -4.0}]
    fine = robot_from_dict({"links": [link]}).refine(2)
    assert fine.n_q == 18
    assert fine.links[0].k_e == (600.0, 200.0, 40.0)
    with refused("links[0].k_e", names=("material", "k_b", "shear_x")):
        robot_from_dict({"links": [{**link, "strains": {"shear_x": field}}]})


def test_shipped_planar_rod():
    robot = load_robot("silicone_rod_planar")
    assert robot.n_q == 10
    assert robot.coordinate_names[3:5] == ("link0/bending_x_3", "link0/elongation_0")
    spatial = load_robot("silicone_rod")
    assert robot.length == pytest.approx(spatial.length, rel=1e-12)
    assert robot.links[0].mass == pytest.approx(sum(link.mass for link in spatial.links), rel=1e-12)
    assert robot.links[0].material == spatial.links[0].material
