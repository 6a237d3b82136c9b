"""What the reference knows of its own error, and what energy and frequency have in them."""

import numpy as np
import pytest
from small import ROBOT, robot
from test_trade_picture import MODELS, study

from soro_core import SoftArm, robot_from_dict
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Discretisation
from soro_lab.commands.trade_report import notes
from soro_lab.scene import Requirement
from soro_lab.trade import bare_case
from soro_lab.trade.reference import ReferenceRun, converge, spaces
from soro_lab.trade.slow_metrics import mean_curvature
from soro_lab.trade.trace import first_frequency_hz, total_energy

# Of a cantilever, not of 1 at the base: the projection of a uniform strain has both.
SAMPLES = [[(1.0 - s) ** 2, s * (1.0 - s) + 0.5] for s in np.linspace(0.0, 1.0, 21)]


@pytest.fixture
def modes():
    (link,) = ROBOT["links"]
    strains = {"bending_x": {"basis": "pod", "samples": SAMPLES}}
    return robot_from_dict({**ROBOT, "links": [{**link, "strains": strains, "chambers": []}]})


def test_a_uniform_bend_of_modes_bends_by_so_much(modes):
    case = bare_case(modes, 0.1)
    assert "modes" in case.text
    arm = SoftArm(modes)
    q = case.initial(arm)
    turn = (np.linalg.inv(arm.pose(q, 0.0)) @ arm.pose(q, arm.length))[:3, :3]
    assert np.arccos((np.trace(turn) - 1.0) / 2.0) == pytest.approx(1.0, abs=0.05)
    polynomial = SoftArm(Discretisation(basis="legendre", order=2, links=2).discretise(robot()))
    plain = bare_case(robot().replace(links=[{**ROBOT["links"][0], "chambers": []}]), 0.1)
    np.testing.assert_array_equal(plain.initial(polynomial), [5.0, 0.0, 0.0, 5.0, 0.0, 0.0])


def test_mean_curvature_of_modes(modes):
    arm = SoftArm(modes)
    q = np.random.default_rng(2).normal(size=arm.n_q)
    pose = np.linalg.inv(arm.pose(q, 0.0)) @ arm.pose(q, arm.length)
    # In the plane the mean curvature is the angle of the tip over the length.
    angle = np.arctan2(pose[0, 2], pose[2, 2])
    assert (mean_curvature(arm, 1) @ q)[0] == pytest.approx(angle / arm.length)


def test_the_error_of_a_pod_basis_is_said_to_be_unknown(modes):
    reference = converge(bare_case(modes, 0.06), 0.05)
    assert reference.unknown == "POD basis is not refined"
    assert reference.converged
    assert ReferenceRun.from_dict(reference.as_dict()).unknown == reference.unknown
    assert spaces(robot())[2] == ""
    shown = study(MODELS, Requirement(error="1%"))
    told = type(shown)(**{**vars(shown), "reference": reference})
    assert (
        "its own error: of space unknown: POD basis is not refined; of quadrature and time: tip"
        in " ".join(notes(told))
    )
    assert told.as_dict()["reference"]["own_error_of_space"] == "unknown: POD basis is not refined"
    assert "unknown" not in " ".join(notes(shown))


OUTSIDE = {
    "held tip": {"tip_constraint": {"point": [0.0, 0.0, -0.2], "axes": ["x"], "stiffness": 50.0}},
    "contact": {
        "contacts": {"planes": [{"point": [0.0, 0.0, -0.19], "normal": [0.0, 0.0, 1.0], "stiffness": 5.0}]}
    },
    "area slope": {
        "links": [
            {**ROBOT["links"][0], "chambers": [{**ROBOT["links"][0]["chambers"][0], "area_slope": -1.5}]}
        ]
    },
    "nothing": {},
}


@pytest.mark.parametrize("outside", OUTSIDE)
def test_frequency_and_energy_have_what_stores_energy_in_them(outside):
    arm = SoftArm(robot().replace(**OUTSIDE[outside]).refine(2))
    pressure = np.full(arm.n_u, 2e4)
    rest = equilibrium(arm, pressure)
    none = np.zeros(arm.n_q)
    step = 1e-6
    # Small vibrations are those of the equation of motion itself, without velocity, so without damping.
    rows = [
        (arm.forward_dynamics(rest + e, none, pressure) - arm.forward_dynamics(rest - e, none, pressure))
        / (2 * step)
        for e in step * np.eye(arm.n_q)
    ]
    slowest = np.sqrt(np.min(-np.linalg.eigvals(np.array(rows).T).real)) / (2 * np.pi)
    assert first_frequency_hz(arm, rest, pressure) == pytest.approx(slowest, rel=1e-5)
    # The slope of the energy is the force of all that stores it; at rest the chambers hold the balance.
    slope = [
        (total_energy(arm, rest + e, none) - total_energy(arm, rest - e, none))
        for e in step * np.eye(arm.n_q)
    ]
    work = arm.actuation_matrix(rest) @ pressure
    np.testing.assert_allclose(np.array(slope) / (2 * step), work, rtol=1e-4, atol=1e-9)
