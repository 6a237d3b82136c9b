"""The files of a new arm: they say what was given, stand together anywhere, and are written whole or not."""

import re
import shutil

import numpy as np
import pytest
import yaml

from soro_core import SoftArm, load_robot
from soro_core.adaptation.modes import first_mode
from soro_core.control.reference_feasibility import check_reach
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import robot_from_dict
from soro_hardware import load_platform
from soro_lab.scaffold import ScaffoldOptions, files, new_arm, write_arm
from soro_lab.scaffold.estimate import STRETCH
from soro_lab.scaffold.files import scalar
from soro_lab.scaffold.reference import LINK_BEND, LONGEST, first_reference
from soro_lab.scaffold.robot_file import DAMPING
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of
from tests.refused import refused

ONE = ScaffoldOptions("one", length="80mm", mass="30g")
TWO = ScaffoldOptions("two", length="90mm,70mm", mass="40g,25g", mounting="hanging")
PLANAR = ScaffoldOptions("planar", length="60mm", radius="15mm", mass="20g", planar=True)
ARMS = pytest.mark.parametrize("options", [ONE, TWO, PLANAR], ids=lambda options: options.name)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The files of the three arms."""
    folder = tmp_path_factory.mktemp("arms")
    return {options.name: write_arm(new_arm(options), folder) for options in (ONE, TWO, PLANAR)}


def values(node):
    """The values of a file that are no sections."""
    if isinstance(node, yaml.ScalarNode):
        return [node]
    inner = [value for _, value in node.value] if isinstance(node, yaml.MappingNode) else node.value
    return [value for each in inner for value in values(each)]


def is_number(value):
    return value.tag in ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")


@ARMS
def test_every_value_has_a_comment(written, options):
    """In the platform file every number: its texts are names that the shipped file explains."""
    made = written[options.name]
    for path in (made.robot, made.platform, made.scene):
        lines = path.read_text().splitlines()
        found = values(yaml.compose(path.read_text()))
        places = {one.start_mark.line for one in found if path != made.platform or is_number(one)}
        assert len(places) >= 10
        for k in places:
            assert "#" in lines[k] or lines[k - 1].lstrip().startswith("#"), lines[k]


def test_what_no_option_says_is_edited_in_the_files(tmp_path):
    """Chambers, mass of the tip, payload and sensors: each key is there, once for each chamber."""
    made = write_arm(new_arm(ONE), tmp_path)
    edit(made.robot, angle_rad=("0.5", "2.6", "4.7"), area_m2=("40e-6",) * 3, offset_m=("0.008",) * 3)
    edit(made.robot, tip_mass=("0.002",), k_e=("[500.0, 0.0, 0.0]",), pressure_range_pa=("[-10e3, 80e3]",))
    edit(made.scene, payload_kg=("0.01",), locations=("[0.5, 1.0]", "[0.7]"), enabled=("true", "true"))
    scene = load_scene(made.scene)
    (link,) = scene.loaded_robot.links
    assert [(c.angle_rad, c.area_m2, c.offset_m) for c in link.chambers] == [
        (angle, 40e-6, 0.008) for angle in (0.5, 2.6, 4.7)
    ]
    assert (scene.loaded_robot.tip_mass, link.k_e[0]) == (0.002, 500.0)
    assert scene.loaded_robot.pressure_range_pa == (-10e3, 80e3)
    assert scene.twin.payload_kg == 0.01
    assert (scene.twin.pose.locations, scene.twin.imu.locations) == ((0.5, 1.0), (0.7,))
    assert scene.twin.imu.enabled


def edit(path, **keys):
    """Write other values behind keys of a file, one for each time that a key stands there."""
    text = path.read_text()
    for key, new in keys.items():
        given = iter(new)
        text, n = re.subn(
            rf"^( *(?:- )?{key}:)[^#\n]*", lambda found, v=given: f"{found[1]} {next(v)}  ", text, flags=re.M
        )
        assert n == len(new), key
    path.write_text(text)


@ARMS
def test_any_reader_of_yaml_reads_the_same_numbers(written, options):
    made = written[options.name]
    plain = yaml.safe_load(made.robot.read_text())
    robot = load_robot(made.robot)
    for link, read in zip(plain["links"], robot.links, strict=True):
        assert tuple(link["damping"]) == read.damping
        assert [chamber["area_m2"] for chamber in link["chambers"]] == [c.area_m2 for c in read.chambers]


@pytest.mark.parametrize("value", [1e-7, 2.5e-7, 5.0, 90e3, 1e20, -0.1, 2.0 * np.pi / 3.0])
def test_a_number_is_one_to_readers_of_yaml_1_1(value):
    """They take 1e-7 for a text, and 5 for an integer."""
    read = yaml.safe_load(scalar(value))
    assert isinstance(read, float)
    assert read == pytest.approx(value, rel=1e-11)


def test_what_was_given_is_in_the_robot(written):
    robot = load_robot(written["two"].robot)
    assert [link.length for link in robot.links] == [0.09, 0.07]
    assert [link.mass for link in robot.links] == [0.04, 0.025]
    assert robot.name == "two"
    hanging = SoftArm(robot).pose(np.zeros(robot.n_q), robot.length)
    assert hanging[:3, 3] == pytest.approx([0.0, 0.0, -0.16])
    scene = load_scene(written["two"].scene)
    assert (scene.name, scene.twin.payload_kg, scene.twin.pose.locations) == ("two", 0.0, (1.0,))


def test_a_planar_arm_bends_towards_its_angles(written):
    robot = load_robot(written["planar"].robot)
    assert robot.coordinate_names == ("link0/elongation", "link0/bending_x")
    assert [chamber.angle_rad for chamber in robot.links[0].chambers] == pytest.approx([0.0, np.pi])


@ARMS
def test_the_first_modes_have_the_guessed_damping(written, options):
    arm = SoftArm(load_robot(written[options.name].robot))
    for stretch in (False, True):
        mode = first_mode(arm, stretch)
        assert mode.damping == pytest.approx(DAMPING, rel=0.02)


@ARMS
def test_the_files_stand_together_in_any_folder(written, options, tmp_path, monkeypatch):
    made = written[options.name]
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for path in (made.robot, made.platform, made.scene):
        shutil.copy(path, moved)
    monkeypatch.chdir(tmp_path)
    for name in (f"elsewhere/{made.scene.name}", moved / made.scene.name):
        scene = load_scene(name)
        assert scene.robot == str(moved / made.robot.name)
        assert scene.loaded_robot.name == options.name
        assert scene.loaded_platform.chamber_names == scene.loaded_robot.chamber_names


@ARMS
def test_the_pressures_hold_the_reference(written, options):
    scene = load_scene(written[options.name].scene)
    check_reach(loop_of(scene).controller, 1e-3)


@pytest.mark.parametrize("planar", [False, True])
def test_the_reference_of_a_soft_arm_is_no_longer_or_more_bent_than_arms_are(tmp_path, planar):
    soft = {"axial_stiffness": "736", "bending_stiffness": "25Nmm/rad", "pressure_range": "0,300kPa"}
    options = ScaffoldOptions("soft", length="60mm", mass="20g", planar=planar, **soft)
    scene = load_scene(write_arm(new_arm(options), tmp_path).scene)
    controller = loop_of(scene).controller
    q = controller.configured.sample(0.0).q
    assert scene.controller.reference.kind == ("set_point" if planar else "circle")
    assert 0.0 < q[0] <= LONGEST
    assert 0.1 < abs(q[1]) * 0.06 <= LINK_BEND
    check_reach(controller, 1e-3)


def test_a_long_hanging_arm_moves_and_its_weight_stretches_it_little(tmp_path):
    """A beam that would stand as well is far too stiff for its pressures: it would not bend by 0.2 1/m."""
    options = ScaffoldOptions("long", 3, "133mm", mass="60g", pressure_range="60kPa", mounting="hanging")
    written = write_arm(new_arm(options), tmp_path)
    arm = SoftArm(load_robot(written.robot))
    bent = equilibrium(arm, [60e3] + [0.0] * 8)
    assert np.hypot(*bent[1:3]) > 1.5
    assert np.all(equilibrium(arm, np.zeros(9))[0::3] < STRETCH)
    assert load_scene(written.scene).controller.reference.curvature_per_m > 0.3


def test_a_reference_that_is_too_far_is_seen(written):
    """The check above."""
    scene = load_scene(written["one"].scene, {"controller.reference.curvature_per_m": 14.0})
    with refused("reference.curvature_per_m"):
        check_reach(loop_of(scene).controller, 1e-3)


def test_a_resting_place_is_one(written):
    scene = load_scene(written["planar"].scene)
    arm = SoftArm(scene.loaded_robot)
    q = np.array(scene.controller.reference.set_point)
    force = arm.gravity_force(q) + arm.elastic_force(q)
    pressure = np.linalg.solve(arm.actuation_matrix(q), force)
    assert all(0.1 * 90e3 < p < 0.7 * 90e3 for p in pressure)
    assert equilibrium(arm, pressure, 0.9 * q) == pytest.approx(q, rel=1e-6)
    assert q[1] < -1.0  # away from the chamber at angle 0, which is longer


@pytest.mark.parametrize(
    ("platform", "family"),
    [
        ("emulated", "canopen_408"),
        ("canopen_socketcan", "canopen_408"),
        ("emulated_canopen_4ch", "canopen_408"),
        ("itv_serial", "itv_rs232"),
        ("itv_rs232", "itv_rs232"),
        ("alicat", "alicat"),
        ("veab_tcp", "veab_tcp"),
        ("soro_board", "soro_board"),
        ("vtem_modbus", "vtem_modbus"),
    ],
)
def test_every_platform_takes_six_chambers(platform, family, tmp_path):
    options = ScaffoldOptions("arm", links=2, length="60mm", platform=platform, mounting="hanging")
    found = load_platform(write_arm(new_arm(options), tmp_path).platform)
    assert found.family == family
    assert found.chamber_names == tuple(f"link{i}/chamber{j}" for i in range(2) for j in range(3))


@pytest.mark.parametrize(("low", "high"), [(0, 20), (-50, 60), (10, 80), (0, 250), (0, 900)])
def test_limits_ranges_and_ratings_follow_the_pressures(low, high, tmp_path):
    options = ScaffoldOptions("arm", length="80mm", pressure_range=f"{low},{high}kPa")
    made = write_arm(new_arm(options), tmp_path)
    scene = load_scene(made.scene)
    assert scene.loaded_robot.pressure_range_pa == (1e3 * low, 1e3 * high)
    platform, lowest = scene.loaded_platform, min(1e3 * low, 0.0)
    regulator = platform.regulator
    for lower, upper in (
        (platform.range.minimum_pa, platform.range.maximum_pa),
        (scene.limits.minimum_pa, scene.limits.maximum_pa),
        (regulator.minimum_pa, regulator.maximum_pa),
    ):
        assert (lower, upper) == (lowest, 1e3 * high)
    assert loop_of(scene).controller.minimum_pa == pytest.approx(1e3 * low)
    assert scene.controller.reference.mean_pressure_pa == pytest.approx(500.0 * (low + high))


@pytest.mark.parametrize(("low_kpa", "said"), [(0, "0, to vent"), (-20, "guess: a ninth beyond the range")])
def test_the_lowest_rating_is_a_guess_only_below_zero(low_kpa, said, tmp_path):
    made = write_arm(new_arm(ScaffoldOptions("arm", pressure_range=f"{low_kpa},60kPa")), tmp_path)
    comment = re.search(
        r"(# lowest permitted set point .*?)\n *minimum_pa|minimum_pa: .*(# lowest permitted .*)",
        made.platform.read_text(),
    )
    assert said in comment[0]
    assert ("ninth" in comment[0]) == (low_kpa < 0)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"platform": "hydraulic"}, "--platform"),
        ({"platform": "itv", "pressure_range": "-20,60kPa"}, None),
        ({"platform": "soro_board", "pressure_range": "0,200kPa"}, None),
        ({"platform": "veab_tcp", "links": 5}, None),
    ],
)
def test_an_arm_that_does_not_fit_its_platform_leaves_nothing(changes, key, tmp_path):
    options = ScaffoldOptions(**{"name": "arm", "length": "60mm", "mounting": "hanging", **changes})
    with refused(key or "", names=("emulated",) if key else ()) as caught:
        write_arm(new_arm(options), tmp_path / "arm")
    assert caught.value.where.startswith("soro new")
    assert list(tmp_path.iterdir()) == []


def test_existing_files_stay_without_force(tmp_path):
    made = write_arm(new_arm(ONE), tmp_path)
    mine = "robot: mine\n"
    made.scene.write_text(mine)
    made.robot.unlink()
    with refused("--out", names=("--force",)):
        write_arm(new_arm(ONE), tmp_path)
    assert made.scene.read_text() == mine
    assert not made.robot.exists()
    write_arm(new_arm(ONE), tmp_path, force=True)
    assert load_scene(made.scene).name == "one"
    assert sorted(tmp_path.iterdir()) == sorted((made.robot, made.platform, made.scene))


def test_a_file_that_cannot_be_read_back_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "scene_tree", lambda *_: {})
    monkeypatch.setattr(files, "scene_header", lambda *_: "broken")
    with refused(""):
        write_arm(new_arm(ONE), tmp_path / "new" / "folder")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "taken").write_text("")
    for out in (tmp_path / "taken", tmp_path / "taken" / "below"):
        with refused("--out", str(out)):
            write_arm(new_arm(ONE), out)


def test_an_arm_that_falls_over_is_said_so(tmp_path):
    soft = ScaffoldOptions("soft", length="200mm", radius="10mm", bending_stiffness="3Nmm/rad")
    assert len(write_arm(new_arm(soft), tmp_path).warnings) == 1
    stiff = ScaffoldOptions("stiff", length="200mm", radius="10mm", bending_stiffness="0.5Nm/rad")
    assert write_arm(new_arm(stiff), tmp_path).warnings == ()


def test_an_arm_with_several_modes_gets_a_resting_place(written):
    """Its chambers do not drive the slopes of its strains, so that it gets no circle."""
    fields = {name: {"basis": "legendre", "order": 1} for name in ("elongation", "bending_x", "bending_y")}
    robot = load_robot(written["one"].robot)
    link = robot.links[0].model_dump(mode="json") | {"strains": fields, "damping": [1e-3] * 6}
    bent = robot_from_dict({**robot.model_dump(mode="json"), "links": [link]})
    reference = first_reference(bent)
    assert reference.kind == "set_point"
    q = np.array(reference.set_point)
    assert q.shape == (6,)
    assert np.abs(q[2:4]).max() > 0.1
    assert abs(q[4]) < 1e-6
