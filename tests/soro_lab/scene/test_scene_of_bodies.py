"""Bodies in a scene: read with their units, written out again, and refused in one line."""

import subprocess
import sys

import numpy as np
import pytest
import yaml

from soro_core.bodies import BallShape, BodyMotion
from soro_core.bodies.files import load_bodies
from soro_core.errors import ConfigError
from soro_core.files.stl import write_stl
from soro_lab.scene import check_scene, load_scene, require_one_arm

BALL = {"shape": {"kind": "ball", "radius": "16 mm"}, "mass": "30 g", "position": [0.0, 0.0, 0.1]}
HINGE = {"point": [0.0, 0.0, 0.3], "axis": [0.0, 1.0, 0.0]}
FLOOR = {"shape": {"kind": "ground"}, "fixed": True}


@pytest.fixture
def scene_of(tmp_path):
    """Write a scene with bodies and read it."""

    def scene(bodies, **keys):
        file = tmp_path / "table.yaml"
        file.write_text(yaml.safe_dump({"mode": "lockstep", "bodies": bodies, **keys}))
        loaded = load_scene(file)
        check_scene(loaded, "table.yaml")
        return loaded

    return scene


def test_bodies_are_read_with_their_units_and_written_out_again(scene_of, tmp_path):
    moves = {"at_s": [1.0, 2.0], "displacement_m": [[0.0, 0.0, 0.0], [0.0, 0.0, -0.1]]}
    scene = scene_of({"ball": BALL, "floor": {**FLOOR, "motion": moves}})
    ball, floor = scene.bodies["ball"], scene.bodies["floor"]
    assert (ball.shape, ball.mass) == (BallShape(radius=0.016), 0.03)
    assert floor.motion == BodyMotion(at_s=[1.0, 2.0], displacement_m=[0.0] * 5 + [-0.1])
    file = tmp_path / "used.yaml"
    file.write_text(yaml.safe_dump(scene.to_dict()))
    assert load_scene(file).bodies == scene.bodies
    assert load_bodies(file) == scene.bodies


def test_a_mesh_is_found_beside_the_scene_and_kept_by_its_corners(scene_of, tmp_path):
    corners = np.array([[0, 0, 0], [0.03, 0, 0], [0, 0.03, 0], [0, 0, 0.03]])
    write_stl(tmp_path / "tip.stl", corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    scene = scene_of({"tip": {**BALL, "shape": {"kind": "mesh", "file": "tip.stl"}}})
    rows = [["0 mm", 0.0, 0.0], ["30 mm", 0.0, 0.0], [0.0, "30 mm", 0.0], [0.0, 0.0, "3 cm"]]
    by_corners = scene_of({"tip": {**BALL, "shape": {"kind": "mesh", "corners": rows}}}).bodies["tip"]
    by_file = scene.bodies["tip"]
    assert by_file.shape.solid.volume == pytest.approx(4.5e-6, rel=1e-6)
    assert by_corners.shape.solid.volume == pytest.approx(4.5e-6, rel=1e-9)
    (tmp_path / "tip.stl").unlink()
    file = tmp_path / "used.yaml"
    file.write_text(yaml.safe_dump(scene.to_dict()))
    assert load_bodies(file)["tip"] == by_file


def test_bodies_are_those_of_the_scene_and_of_no_arm(scene_of):
    scene = scene_of({"ball": BALL}, arms={"left": {"base_position": [-0.1, 0.0, 0.0]}, "right": None})
    assert list(scene.bodies) == ["ball"]
    assert [arm.bodies for arm in scene.each] == [{}, {}]


@pytest.mark.parametrize(
    ("bodies", "keys", "said"),
    [
        ({"ball": {**BALL, "mass": None}}, {}, "bodies.ball: .*a mass above 0"),
        ({"ball": {**BALL, "colour": 1}}, {}, "bodies.ball.colour: .*an unknown key"),
        ({"ball": {**BALL, "shape": {"kind": "ball"}}}, {}, "bodies.ball.shape.radius: .*nothing"),
        ({"ball": {**BALL, "shape": {"kind": "cone"}}}, {}, "bodies.ball.shape.kind: .*mesh"),
        ({"ball": {**BALL, "shape": {"kind": "mesh"}}}, {}, "bodies.ball.shape.corners: .*or file"),
        ({"ball": {**BALL, "shape": {"kind": "mesh", "file": "no.stl"}}}, {}, r"bodies.ball.shape.*no\.stl"),
        ({"Ball": BALL}, {}, "bodies.Ball"),
        ({"arm": BALL}, {}, "bodies.arm: .*a name that no arm has"),
        ({"left": BALL}, {"arms": {"left": None, "right": None}}, "bodies.left: .*a name that no arm has"),
        ({"ball": BALL}, {"twin": {"imu": {"enabled": True}}}, "twin: .*no imu beside them"),
        (
            {"ball": BALL},
            {"arms": {"left": None, "right": {"twin": {"wall": {"stiffness": 10.0}}}}},
            "arms.right: twin: .*no wall",
        ),
        ({"ball": BALL}, {"arms": {"left": {"bodies": {"ball": BALL}}}}, "arms.left.bodies: .*at the top"),
        ({"door": {**BALL, "hinge": {**HINGE, "drive": {}}}}, {}, "bodies.door.hinge.drive: .*one or more"),
        (
            {"door": {**BALL, "hinge": {**HINGE, "drive": {"at_s": [1.0, 1.0], "angle_rad": [0.0, 0.1]}}}},
            {},
            "bodies.door.hinge.drive: .*that increase",
        ),
        (
            {"door": {**BALL, "hinge": HINGE}},
            {"controller": {"joint": "bodies/window/joint"}},
            "controller.joint: .*bodies/door/joint",
        ),
        ({"ball": BALL}, {"controller": {"joint": "bodies/ball/joint"}}, "controller.joint: .*has none"),
    ],
)
def test_wrong_bodies_are_refused_in_one_line(scene_of, bodies, keys, said):
    with pytest.raises(ConfigError, match=said) as error:
        scene_of(bodies, **keys)
    assert "\n" not in str(error.value)


def test_who_simulates_an_arm_alone_refuses_bodies(scene_of):
    with pytest.raises(ConfigError, match=r"bodies: got 'ball'.*only soro run"):
        require_one_arm(scene_of({"ball": BALL}), "table.yaml")


def test_a_scene_without_bodies_has_nothing_that_moves_them():
    code = (
        "import sys; from soro_lab.scene import load_scene; from soro_core.twin import Twin\n"
        "import soro_core.twin.world\n"
        "scene = load_scene('three_fingers'); Twin(scene.each[0].loaded_robot, scene.each[0].twin_node())\n"
        "moves = [f'soro_core.bodies.{name}' for name in ('stepping', 'simulate', 'stepper', 'world')]\n"
        "sys.exit(any(name.startswith(tuple(moves)) for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
