"""The numbers of an arm, from a robot and back; what a sensor should show."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soro_core import SoftArm, load_robot
from soro_core.errors import ConfigError, ModelError
from soro_lab.identification.arm.cases.parameters import numbers_of, with_numbers
from soro_lab.identification.arm.cases.predict import difference, predict_measurement
from soro_lab.identification.arm.laws import LAWS, NAMED, free_parameters, is_of_law, plain
from soro_lab.identification.arm.search.problem import modelled
from soro_lab.identification.recording import Bend, Curvature, Marker, Place, Plate


@pytest.mark.parametrize("name", ["tue_three_bellow", "asu_two_segment"])
def test_numbers_of_a_robot_give_the_same_robot(name: str) -> None:
    robot = load_robot(name)
    same = with_numbers(robot, {key: number.value for key, number in numbers_of(robot).items()})
    one, other = SoftArm(robot), SoftArm(same)
    q = np.tile([0.02, 1.0, -2.0], len(robot.links))
    for arm in (one, other):
        assert arm.n_internal == one.n_internal
    p = np.linspace(1e4, 3e4, one.n_u)
    np.testing.assert_allclose(
        other.forward_dynamics(q, 0.1 * q, p), one.forward_dynamics(q, 0.1 * q, p), rtol=1e-12
    )


def test_numbers_change_what_they_name() -> None:
    robot = load_robot("tue_three_bellow")
    changed = with_numbers(
        robot,
        {
            "link0/k_b": 0.01,
            "link0/rise_b": 0.5,
            "link0/rate_b": 2.0,
            "link0/gain": 2.0,
            "link0/chamber1/gain": 1.5,
        },
    )
    a4, a5, a6 = changed.links[0].k_b
    assert (a4 - a5, a5, a6) == pytest.approx((0.01, 0.005, 2.0))
    before, after = robot.links[0].chambers, changed.links[0].chambers
    assert [b.alpha_eps / a.alpha_eps for a, b in zip(before, after, strict=True)] == pytest.approx(
        [2.0, 3.0, 2.0]
    )


def test_numbers_of_a_chamber_reach_all_chambers_of_the_link() -> None:
    robot = plain(load_robot("tue_three_bellow"))
    values = {"link0/area_slope": 3.0, "link0/area_saturation": 0.3, "link0/dead_band": 1500.0}
    changed = with_numbers(robot, values)
    for chamber in changed.links[0].chambers:
        assert (chamber.area_slope, chamber.area_saturation, chamber.dead_band_pa) == (3.0, 0.3, 1500.0)
    found = numbers_of(changed)
    assert {name: found[name].value for name in values} == values
    # A bound of an area that does not grow has no meaning, and no robot has it.
    flat = with_numbers(changed, {"link0/area_slope": 0.0})
    assert {chamber.area_saturation for chamber in flat.links[0].chambers} == {0.0}
    linear = plain(changed).links[0].chambers[0]
    assert (linear.area_slope, linear.area_saturation, linear.dead_band_pa) == (0.0, 0.0, 0.0)


def test_the_force_of_a_muscle_is_scaled_by_its_section() -> None:
    robot = load_robot("antagonistic_joint")
    changed = with_numbers(robot, {"link0/gain": 1.21, "link0/chamber1/arm": 0.9})
    before, after = robot.links[0].chambers, changed.links[0].chambers
    assert [
        a.muscle.radius_m / b.muscle.radius_m for a, b in zip(after, before, strict=True)
    ] == pytest.approx([1.1, 1.1])
    assert after[1].offset_m == pytest.approx(0.9 * before[1].offset_m)
    # The braid says how the pull changes: there is no slope to search.
    assert not {"link0/area_slope", "link0/area_saturation"} & numbers_of(robot).keys()


def test_slow_creep_alone_stays_slow_creep() -> None:
    robot = with_numbers(
        plain(load_robot("tue_three_bellow")), {"link0/slow_b": 0.3, "link0/slow_b_tau": 2.0}
    )
    found = numbers_of(robot)
    assert found["link0/slow_b"].value == pytest.approx(0.3)
    assert found["link0/slow_b_tau"].value == pytest.approx(2.0)
    assert found["link0/creep_b"].value == 0.0


def test_an_unknown_number_is_refused_with_the_names_allowed() -> None:
    with pytest.raises(ModelError, match="link0/k_b") as caught:
        with_numbers(load_robot("tue_three_bellow"), {"link0/stiffness": 1.0})
    assert caught.value.key == "link0/stiffness"


def test_a_strain_that_varies_is_refused() -> None:
    with pytest.raises(ModelError) as caught:
        numbers_of(load_robot("silicone_rod_planar"))
    assert caught.value.key == "link0/bending_x"


def test_laws_free_what_the_recordings_show() -> None:
    robot = plain(load_robot("tue_three_bellow"))
    names = {n.name for n in free_parameters(robot, (), "b")[0]}
    assert "link0/k_b" in names
    assert "link0/k_e" not in names
    assert "link0/creep_b" not in names
    numbers, starts = free_parameters(robot, LAWS, "eb")
    assert {"link0/creep_e", "link0/dahl_b_range", "link0/area_slope", "link0/k_e"} <= {
        n.name for n in numbers
    }
    assert starts["link0/creep_b"] > 0.0


def test_a_plate_shows_its_section_through_tracker_and_mount() -> None:
    arm = SoftArm(load_robot("tue_three_bellow"))
    q = np.array([[0.02, 3.0, -1.0], [0.0, 0.0, 0.0]])
    turn, mount = Rotation.from_rotvec([0.2, 0.1, -0.4]), Rotation.from_rotvec([0.0, 0.1, 0.3])
    at, offset = np.array([1.0, 2.0, 3.0]), np.array([0.01, 0.0, -0.02])
    position, quaternion = [], []
    for row in q:
        pose = arm.pose(row, 0.05)
        position.append(turn.as_matrix() @ (pose[:3, 3] + pose[:3, :3] @ offset) + at)
        quaternion.append((turn * Rotation.from_matrix(pose[:3, :3]) * mount).as_quat())
    frames = {f"frame/tracker/turn_{x}": v for x, v in zip("xyz", turn.as_rotvec(), strict=True)}
    frames |= {f"frame/tracker/offset_{x}": v for x, v in zip("xyz", at, strict=True)}
    frames |= {f"frame/top/turn_{x}": v for x, v in zip("xyz", mount.as_rotvec(), strict=True)}
    frames |= {f"frame/top/offset_{x}": v for x, v in zip("xyz", offset, strict=True)}
    plate = Plate("top", np.arange(2.0), Place(0, 0.05), np.array(position), np.array(quaternion))
    np.testing.assert_allclose(
        difference(plate, predict_measurement(plate, arm.robot, arm, q), frames), 0.0, atol=1e-12
    )
    marker = Marker("top", np.arange(2.0), Place(0, 0.05), np.array(position) + np.array([0.0, 0.0, 1e-3]))
    np.testing.assert_allclose(
        difference(marker, predict_measurement(marker, arm.robot, arm, q), frames),
        [[0, 0, 1e-3]] * 2,
        atol=1e-12,
    )


def test_each_tracker_has_its_own_frame() -> None:
    arm = SoftArm(load_robot("tue_three_bellow"))
    q = np.array([[0.02, 3.0, -1.0]])
    tip = arm.pose(q[0], arm.length)[:3, 3]
    frames = {"frame/tracker/offset_x": 0.1, "frame/second/offset_y": 0.2, "frame/second/turn_z": np.pi / 2}
    turned = np.array([-tip[1], tip[0], tip[2]])
    for name, seen in (
        ("tracker", tip + np.array([0.1, 0.0, 0.0])),
        ("second", turned + np.array([0.0, 0.2, 0.0])),
    ):
        marker = Marker("point", np.arange(1.0), Place(0), np.array([seen]), frame=name)
        np.testing.assert_allclose(
            difference(marker, predict_measurement(marker, arm.robot, arm, q), frames), 0.0, atol=1e-12
        )


def test_kept_numbers_are_not_searched() -> None:
    robot = load_robot("tue_three_bellow")
    keep = ("link0/k_e", "link0/creep_b")
    numbers, begin = free_parameters(robot, LAWS, "eb", keep)
    assert {n.name for n in free_parameters(robot, LAWS, "eb")[0]} - {n.name for n in numbers} == set(keep)
    assert "link0/creep_e" in begin
    assert "link0/creep_b" not in begin
    described = numbers_of(robot)["link0/creep_b"].value
    assert described > 0.0
    assert numbers_of(plain(robot, keep))["link0/creep_b"].value == pytest.approx(described)
    assert numbers_of(plain(robot))["link0/creep_b"].value == 0.0
    with pytest.raises(ConfigError) as caught:
        free_parameters(robot, LAWS, "eb", ("link0/mass",))
    assert caught.value.key == "--keep"


def test_a_camera_turns_and_shifts_curvatures() -> None:
    arm = SoftArm(load_robot("tue_three_bellow"))
    frames = {"frame/camera/turn": np.pi / 2, "frame/camera/offset_x": 0.5}
    seen = Curvature("camera", np.arange(1.0), 0, np.array([[0.5, 2.0]]))
    np.testing.assert_allclose(
        difference(seen, predict_measurement(seen, arm.robot, arm, np.array([[0.01, 2.0, 0.0]])), frames),
        0.0,
        atol=1e-12,
    )


def test_a_moment_arm_of_one_chamber_changes_that_one_alone() -> None:
    robot = load_robot("tue_three_bellow")
    changed = with_numbers(robot, {"link0/chamber2/arm": 0.5}).links[0].chambers
    before = robot.links[0].chambers
    assert [c.alpha_eps for c in changed] == pytest.approx([c.alpha_eps for c in before])
    factors = [c.alpha_kappa / b.alpha_kappa for c, b in zip(changed, before, strict=True)]
    assert factors == pytest.approx([1.0, 1.0, 0.5])


def test_moment_arms_are_freed_only_by_their_law() -> None:
    robot = load_robot("tue_three_bellow")
    arms = {"link0/chamber1/arm", "link0/chamber2/arm"}
    assert not arms & {n.name for n in free_parameters(robot, LAWS, "eb")[0]}
    assert arms <= {n.name for n in free_parameters(robot, NAMED, "eb")[0]}
    assert all(is_of_law(name) for name in arms)
    assert not is_of_law("link0/chamber1/gain")


def test_pieces_of_a_link_show_what_the_link_does() -> None:
    """Hysteresis acts on constant strains, so the arm is simulated in pieces; streams count links."""
    robot = with_numbers(load_robot("asu_two_segment"), {"link0/dahl_b": 0.2, "link1/dahl_b": 0.2})
    whole, parts = SoftArm(robot), modelled(robot, is_constant=False)
    assert len(parts.robot.links) == 3 * len(robot.links)
    q = np.array([[0.1, 3.0, -1.0, -0.05, 2.0, 4.0]])
    pieces = np.concatenate([np.tile(q[:, :3], 3), np.tile(q[:, 3:], 3)], axis=1)
    t, turn = np.arange(1.0), np.array([[0.0, 0.0, 0.0, 1.0]])
    for shape in (
        Plate("middle", t, Place(0), np.zeros((1, 3)), turn),
        Marker("half", t, Place(1, 0.05), np.zeros((1, 3))),
        Curvature("camera", t, 1, np.zeros((1, 2))),
        Bend("angle", t, 1, np.zeros(1)),
    ):
        seen = predict_measurement(shape, robot, whole, q)
        np.testing.assert_allclose(predict_measurement(shape, robot, parts, pieces), seen, atol=1e-9)
        assert np.ptp(seen) > 0.0 or shape.name == "angle"
