"""Braided muscles, against the volume of a braid whose fibres do not stretch."""

import math

import numpy as np
import pytest
from test_model_area import FIELDS, check_derivatives
from test_model_chambers import robot

from soro_core import SoftArm, load_robot
from soro_core.errors import ConfigError
from soro_core.integrate import simulate
from soro_core.integrate.air import chamber_volumes
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.pneumatics import ValveModel
from soro_core.robot.load import robot_from_dict
from soro_core.robot.parts import fields

RADIUS, ANGLE = 0.006, 0.42
PRESSURE = np.array([1.5e5, 0.4e5, 0.9e5])


def muscles(field=FIELDS[1], offset=0.012, angle=ANGLE):
    plain = robot(field, 0.0)
    link = plain.links[0]
    muscle = {"radius_m": RADIUS, "braid_angle_rad": angle}
    chambers = [{"angle_rad": c.angle_rad, "offset_m": offset, "muscle": muscle} for c in link.chambers]
    link = {**link.model_dump(exclude_none=True), "chambers": chambers}
    return SoftArm(plain.replace(links=[link], pressure_range_pa=(0.0, 3e5)))


def braid_volume(length, rest, angle):
    """Volume within n turns of fibres of length b, (b^2 L - L^3) / (4 pi n^2) [Chou and Hannaford 1996]."""
    fibre = rest / math.cos(angle)
    turns = fibre * math.sin(angle) / (2.0 * math.pi * RADIUS)
    return (fibre**2 * length - length**3) / (4.0 * math.pi * turns**2)


@pytest.mark.parametrize("angle", [0.2, 0.42, 0.9])
def test_a_muscle_has_volume_and_pull_of_its_braid(angle):
    arm = muscles(offset=0.0, angle=angle)
    rest = arm.robot.length
    for strain in (-0.3, -0.1, 0.0, 0.05):
        q = np.array([strain, 0.0, 0.0])
        volume = chamber_volumes(arm) + arm.displaced_volume(q)
        assert volume == pytest.approx(braid_volume((1.0 + strain) * rest, rest, angle), rel=1e-12)
        h = 1e-6 * rest
        by_length = braid_volume((1.0 + strain) * rest + h, rest, angle)
        by_length -= braid_volume((1.0 + strain) * rest - h, rest, angle)
        assert arm.actuation_matrix(q)[0] / rest == pytest.approx(by_length / (2.0 * h), abs=1e-7 * RADIUS)


def test_a_muscle_shortens_until_its_braid_locks():
    arm = muscles(offset=0.0)
    locked = 1.0 / math.sqrt(3.0 * math.cos(ANGLE) ** 2) - 1.0
    assert arm.actuation_matrix([locked, 0.0, 0.0])[0] == pytest.approx(0.0, abs=1e-18)
    lengths = [equilibrium(arm, np.full(3, p))[0] for p in (0.0, 0.5e5, 1e5, 2e5)]
    assert all(np.diff(lengths) < 0.0)
    assert lengths[-1] > locked


@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field["basis"])
def test_volume_force_and_stiffness_of_a_muscle_are_derivatives(field):
    check_derivatives(muscles(field), PRESSURE)


def test_two_muscles_turn_a_joint_and_stiffen_it_together():
    """Of the shipped joint: its stiffness by the moments of two braids at its sides, worked out by hand."""
    arm = SoftArm(load_robot("antagonistic_joint"))
    link = arm.robot.links[0]
    side, length = link.chambers[0].offset_m, link.length
    muscle = link.chambers[0].muscle

    def moment(turn, p0, p1):
        pulls = [
            p
            * muscle.section_m2
            * (3.0 * (math.cos(muscle.braid_angle_rad) * (1.0 + s)) ** 2 - 1.0)
            / math.sin(muscle.braid_angle_rad) ** 2
            for p, s in ((p0, -side * turn / length), (p1, side * turn / length))
        ]
        return side * (pulls[0] - pulls[1])

    alone = equilibrium(arm, np.array([2e5, 0.0]))[0] * length
    assert alone > 1.0
    assert link.k_b[0] * alone == pytest.approx(moment(alone, 2e5, 0.0), rel=0.05)  # its weight is the rest
    assert equilibrium(arm, np.array([0.0, 2e5]))[0] * length == pytest.approx(-alone, rel=1e-6)

    def stiffness(both):
        push = [equilibrium(arm, np.full(2, both), wrench=[0, 0, 0, f, 0, 0])[0] for f in (0.01, -0.01)]
        return 1.0 / (push[0] - push[1])

    low, high = stiffness(0.5e5), stiffness(2e5)
    by_hand = [(moment(-1e-4, p, p) - moment(1e-4, p, p)) / 2e-4 for p in (0.5e5, 2e5)]
    more = (link.k_b[0] + by_hand[1]) / (link.k_b[0] + by_hand[0])
    assert high / low == pytest.approx(more, rel=0.05)
    assert more > 2.0


def test_air_behind_valves_bends_the_joint_as_given_pressures_do():
    arm, pressure = SoftArm(load_robot("antagonistic_joint")), np.array([2e5, 0.5e5])
    run = simulate(arm, t_end=1.0, dt=2e-3, pressure=pressure, valves=ValveModel(supply_pa=4e5))
    assert run.status.ok, run.status
    np.testing.assert_allclose(run.q[-1], equilibrium(arm, pressure), rtol=1e-6)
    muscle = arm.robot.links[0].chambers[0].muscle
    furthest = arm.robot.links[0].chambers[0].offset_m * equilibrium(arm, np.array([3e5, 0.0]))[0]
    assert furthest < 1.0 / math.cos(muscle.braid_angle_rad) - 1.0, "its fibres are straight before"


def test_no_energy_is_gained_from_muscles():
    arm = muscles()
    run = simulate(
        arm, [0.05, 6.0, -4.0], np.zeros(3), t_end=0.3, dt=1e-3, integrator="tr_bdf2", pressure=PRESSURE
    )
    assert run.status.ok
    stored = [
        sum(arm.energy(q, v)) - PRESSURE @ arm.displaced_volume(q) for q, v in zip(run.q, run.qd, strict=True)
    ]
    kinetic = max(arm.energy(q, v)[0] for q, v in zip(run.q, run.qd, strict=True))
    assert kinetic > 1e-3 * np.ptp(stored)
    assert max(np.diff(stored)) <= 1e-10 * kinetic


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"area_m2": 1e-4}, "area_m2"),
        ({"area_slope": 2.0}, "area_slope"),
        ({"alpha_eps": 1e-6, "alpha_kappa": 1e-8}, "exactly one of"),
        ({"offset_m": None}, "offset_m"),
        ({"muscle": {"radius_m": 0.006, "braid_angle_rad": 1.2}}, "braid_angle_rad"),
    ],
)
def test_what_contradicts_a_muscle_is_refused(keys, said):
    with pytest.raises(ConfigError, match=said) as caught:
        muscles().robot.with_({f"links[0].chambers[0].{key}": value for key, value in keys.items()})
    assert "\n" not in str(caught.value)


def test_a_muscle_has_no_pressure_below_that_of_the_air():
    with pytest.raises(ConfigError, match="pressures from 0 on"):
        muscles().robot.replace(pressure_range_pa=(-1e4, 3e5))


def test_a_pull_that_no_arm_bears_is_warned_of(caplog):
    """A braid along its line pulls at a thousand times its section."""
    robot = muscles().robot
    odd = robot.replace(links=[{**fields(link), "chambers": _braided(link, 0.05)} for link in robot.links])
    robot_from_dict(odd.model_dump(exclude_unset=True))
    assert "links[0].chambers[0]" in caplog.text
    caplog.clear()
    robot_from_dict(robot.model_dump(exclude_unset=True))
    assert "chambers" not in caplog.text


def _braided(link, angle):
    return [
        {**fields(one), "muscle": {"radius_m": RADIUS, "braid_angle_rad": angle}} for one in link.chambers
    ]
