"""The reference cases, derived elsewhere by automatic differentiation of the energies."""

from unittest.mock import ANY

import numpy as np
import pytest

from soro_core import SoftArm, robot_from_dict
from tests.refused import refused

RESULTS = ("inertia_matrix", "coriolis_force", "gravity_force", "elastic_force", "tip_pose")


def relative(got, want):
    want = np.asarray(want)
    return np.abs(got - want).max() / max(np.abs(want).max(), 1e-30)


@pytest.mark.parametrize("number", range(25))
def test_agrees_with_reference_case(golden, number):
    case = golden[number]
    tolerance = 1e-7 if case["kind"] == "loop" else 1e-9
    arm = SoftArm(robot_from_dict(case), nodes=16)
    q, qd = case["q"], case["qd"]
    got = {
        "inertia_matrix": arm.inertia_matrix(q),
        "coriolis_force": arm.coriolis_force(q, qd),
        "gravity_force": arm.gravity_force(q),
        "elastic_force": arm.elastic_force(q),
        "tip_pose": arm.pose(q, arm.length),
    }
    errors = {name: relative(got[name], case[name]) for name in RESULTS}
    assert max(errors.values()) < tolerance, errors
    np.testing.assert_allclose(arm.coriolis_matrix(q, qd) @ qd, got["coriolis_force"], rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("number", range(25))
def test_default_nodes_are_as_good_as_the_document_says(golden, number):
    case = golden[number]
    arm = SoftArm(robot_from_dict(case))
    bend = np.hypot(case["q"][1::3], case["q"][2::3]) * [link["length"] for link in case["links"]]
    allowed = 1e-12 if bend.max() < np.pi / 2 else 1e-3
    q, qd = case["q"], case["qd"]
    for name, got in (
        ("inertia_matrix", arm.inertia_matrix(q)),
        ("coriolis_force", arm.coriolis_force(q, qd)),
        ("gravity_force", arm.gravity_force(q)),
    ):
        assert relative(got, case[name]) < allowed, name
    assert relative(arm.elastic_force(q), case["elastic_force"]) < 1e-12
    assert relative(arm.pose(q, arm.length), case["tip_pose"]) < 1e-12


def test_a_case_needs_all_its_results_to_be_taken_as_one(golden):
    case = dict(golden[0])
    del case["tip_pose"]
    with refused(ANY, "an unknown key"):
        robot_from_dict(case)
