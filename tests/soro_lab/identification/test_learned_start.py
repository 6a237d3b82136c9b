"""`soro identify --learn-from`: first guesses from what a controlled run has learned."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.adaptation.damping import damping_model
from soro_core.adaptation.kept import FILE, KeptNumbers, digest_of
from soro_lab.identification.arm.cases.parameters import numbers_of
from soro_lab.identification.arm.learned_start import with_learned
from tests.refused import refused

ROBOT = load_robot("tue_three_bellow")
LEARNED = {
    "tip_mass": 0.02,
    "link0/elongation/by link0/elongation": -2.0,
    "link0/elongation/by link0/bending_x": 3.0,
    "link0/bending_x/by link0/bending_x": 2.0,
    "link0/bending_y/by link0/bending_y": 4.0,
    "link0/chamber0/gain": 0.1,
    "link0/chamber1/gain": -0.3,
    "link0/chamber2/gain": 0.2,
    "link0/area_slope": 2.6,
}


def kept(**changes):
    numbers = {name: (value, 0.01) for name, value in LEARNED.items()}
    keys = {"version": 3, "robot": ROBOT.name, "digest": digest_of(ROBOT), "numbers": numbers}
    return KeptNumbers(**{**keys, **changes})


def test_gains_slopes_and_stiffness_are_the_learned_ones():
    found = with_learned(ROBOT, kept())
    for i, (was, now) in enumerate(zip(ROBOT.links[0].chambers, found.links[0].chambers, strict=True)):
        gain = 1.0 + LEARNED[f"link0/chamber{i}/gain"]
        assert now.alpha_eps == pytest.approx(gain * was.alpha_eps)
        assert now.alpha_kappa == pytest.approx(gain * was.alpha_kappa)
        assert now.area_slope == pytest.approx(was.area_slope + 2.6)
    was, now = (numbers_of(robot) for robot in (ROBOT, found))
    assert now["link0/k_e"].value == pytest.approx(0.8 * was["link0/k_e"].value)
    assert now["link0/k_b"].value == pytest.approx(1.3 * was["link0/k_b"].value)
    assert found.tip_mass == ROBOT.tip_mass


def test_muscles_take_gains_and_no_slope():
    """The law of a braid has none."""
    robot = load_robot("antagonistic_joint")
    numbers = {"link0/chamber0/gain": (0.21, 0.01), "link0/area_slope": (2.0, 0.5)}
    found = with_learned(robot, kept(robot=robot.name, digest=digest_of(robot), numbers=numbers))
    (was, other), (now, still) = robot.links[0].chambers, found.links[0].chambers
    assert now.muscle.radius_m == pytest.approx(1.1 * was.muscle.radius_m)
    assert still.muscle.radius_m == pytest.approx(other.muscle.radius_m)


@pytest.mark.parametrize("name", ["tue_three_bellow", "asu_two_segment"])
def test_the_damping_is_the_learned_one(name):
    """As the law has it: beside the file's, a retardation time on the stiffness at rest."""
    robot = load_robot(name)
    arm = SoftArm(robot)
    model, times_s = damping_model(arm), {}
    for k, one in enumerate(model.names):
        times_s[one] = 0.05 * (k + 1) if k else 0.3 * model.lower[0]
    numbers = {one: (value, 0.01) for one, value in times_s.items()}
    found = with_learned(robot, kept(robot=robot.name, digest=digest_of(robot), numbers=numbers))
    learned = np.diag(model.matrix) * np.array(list(times_s.values()))[model.number]
    wanted = np.diag(arm.damping_matrix()) + learned
    assert np.diag(SoftArm(found).damping_matrix()) == pytest.approx(wanted, rel=1e-6)
    far = {one: (10.0 * low, 0.01) for one, low in zip(model.names, model.lower, strict=True)}
    bound = with_learned(robot, kept(robot=robot.name, digest=digest_of(robot), numbers=far))
    least = 0.1 * np.diag(arm.damping_matrix())
    assert np.diag(SoftArm(bound).damping_matrix()) == pytest.approx(least, rel=1e-6)


def test_another_robot_is_refused():
    with refused("robot", "other"):
        with_learned(ROBOT, kept(robot="other"))
    with refused("digest"):
        with_learned(ROBOT, kept(digest="sha256:0"))


def test_the_command_refuses_what_is_not_of_its_robot(tmp_path):
    from typer.testing import CliRunner

    from soro_core.errors import ConfigError
    from soro_ros.cli import application

    (tmp_path / FILE).write_text(kept(robot="other").to_yaml())
    words = ["identify", "tue_three_bellow", "bag", "--out", "out.yaml", "--learn-from", str(tmp_path)]
    result = CliRunner().invoke(application(), words)
    assert isinstance(result.exception, ConfigError)
    assert (result.exception.where, result.exception.key) == (str(tmp_path / FILE), "robot")
