"""A scene with bodies by `soro run`: what its bag and its summary say is what the library computes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, WrenchStamped
from sensor_msgs.msg import JointState

from soro_core.bodies import BodyWorld, simulate_world
from soro_core.twin import Twin
from soro_lab.bag import BagReader
from soro_lab.scene import load_scene
from soro_ros.conversion import force, messages
from soro_ros.conversion.decoding import Messages
from soro_ros.recordings.replay import replay
from tests.patience import patient_platform
from tests.soro_ros.running import run, summary

FINGERS = ("thumb", "index", "middle")
SCENE, BODIES = "grasp_ball", "/grasp_ball/bodies"
END_S, TICK_S = 6.0, 0.01
# Without the law of a hand: the fingers close towards shapes that they would have inside the ball.
CLOSE = "{kind: set_point, set_point: [0.0666, -11.2, -0.557], start_s: 2.0}"
SINK = "{at_s: [3.0, 5.0], displacement_m: [[0.0, 0.0, 0.0], [0.0, 0.0, -0.040]]}"


@dataclass
class Ran:
    """A run: exit status, output, summary, scene as used, and messages with their stamps [s] by topic."""

    status: int
    output: str
    figures: dict
    scene: object
    heard: dict
    bag: Path


def grasp(tmp_path, *changes):
    platform = patient_platform(tmp_path, real_time=False, name="emulated_three_fingers")
    status, output, folder = run(
        tmp_path / "runs",
        "mode=lockstep",
        f"rate_hz={1 / TICK_S:g}",
        f"duration_s={END_S:g}",
        f"platform={platform}",
        "hand=null",
        f"controller.reference={CLOSE}",
        f"bodies.table.motion={SINK}",
        *changes,
        scene=SCENE,
    )
    kinds = {f"{BODIES}/ball/pose": PoseStamped, f"{BODIES}/ball/wrench": WrenchStamped}
    kinds |= {f"{BODIES}/contacts": JointState}
    kinds |= {f"/{SCENE}/{name}/truth/chambers": JointState for name in FINGERS}
    heard = {topic: [] for topic in kinds}
    if (folder / "bag").exists():
        with BagReader(folder / "bag") as reader:
            recorded = Messages(reader, kinds)
            for item in reader.messages(set(kinds)):
                message = recorded.read(item)
                heard[item.topic].append((1e-9 * messages.to_ns(message.header.stamp), message))
    scene = load_scene(folder / "scene_used.yaml")
    return Ran(status, output, summary(folder), scene, heard, folder / "bag")


def computed(ran):
    """The same by `simulate_world`, with the pressures that the valves have made."""
    twins = {arm.prefix.rstrip("/"): Twin(arm.loaded_robot, arm.twin_node()) for arm in ran.scene.each}
    world = BodyWorld(
        ran.scene.bodies,
        {name: twin.plant.arm for name, twin in twins.items()},
        {name: twin.initial().arm.q for name, twin in twins.items()},
    )

    def pressures(name):
        rows = ran.heard[f"/{SCENE}/{name}/truth/chambers"]
        t, values = np.array([stamp for stamp, _ in rows]), np.array([one.effort for _, one in rows])
        return lambda now: [np.interp(now, t, column) for column in values.T]

    return simulate_world(world, t_end=END_S, pressures={name: pressures(name) for name in FINGERS})


@pytest.mark.process
def test_three_fingers_hold_a_ball_as_the_library_has_it(domain, tmp_path):
    ran = grasp(tmp_path)
    assert (ran.status, ran.figures["verdict"]) == (0, "good"), ran.output
    found = ran.figures["bodies"]["ball"]
    assert list(ran.figures["bodies"]) == ["ball"]  # the table is fixed
    world = computed(ran)
    assert world.status.ok
    stamps = np.array([stamp for stamp, _ in ran.heard[f"{BODIES}/ball/pose"]])
    np.testing.assert_allclose(np.diff(stamps), TICK_S, atol=1e-9)
    inside = stamps <= END_S + 1e-9
    steps = np.rint(stamps[inside] / 1e-3).astype(int)
    places = np.array([messages.pose_arrays(one.pose)[0] for _, one in ran.heard[f"{BODIES}/ball/pose"]])
    np.testing.assert_allclose(places[inside], world.place["ball"][steps], atol=1e-7)
    assert world.place["ball"][-1, 2] > -0.065  # the table has sunk by 40 mm

    def mean(values):
        """Means over each tick behind the first step."""
        return values[1:].reshape(len(steps) - 1, -1, *values.shape[1:]).mean(axis=1)

    pushed = np.array([force.force_of(one) for _, one in ran.heard[f"{BODIES}/ball/wrench"]])[inside][1:]
    np.testing.assert_allclose(pushed, mean(world.contact_force("ball")), atol=1e-4)
    normal = mean(world.normal_force("ball"))
    assert found["largest_normal_n"] == pytest.approx(normal.max(), abs=1e-4)
    assert not found["dropped"]
    assert world.normal_force("thumb")[-1] > 0.05
    weight = ran.scene.bodies["ball"].mass * 9.81
    late = world.t >= END_S - 5.0
    creep = np.linalg.norm(np.polyfit(world.t[late], world.place["ball"][late], 1)[0])
    assert found["creep_m_s"] == pytest.approx(creep, rel=0.02)
    balance = world.contact_force("ball")[late, 2].mean() / weight - 1.0
    assert found["weight_balance"] == pytest.approx(balance, abs=1e-3)
    _, last = ran.heard[f"{BODIES}/contacts"][int(np.argmax(stamps >= END_S))]
    assert sorted(last.name) == sorted(f"{name}/ball" for name in FINGERS)
    # Each finger stands at a place of its own.
    again = replay(ran.bag, ran.scene)
    assert {topic.topic.split("/")[2] for topic in again.topics} == set(FINGERS)
    assert again.same, [topic for topic in again.topics if topic.differing]
    assert again.without == ()


@pytest.mark.process
def test_a_ball_that_is_too_smooth_is_dropped(domain, tmp_path):
    ran = grasp(tmp_path, "bodies.ball.friction=0.2", "duration_s=5", "platform=")  # lost at 4.3 s
    assert (ran.status, ran.figures["verdict"]) == (1, "lost"), ran.output
    assert ran.figures["reason"] == "bodies: lost: dropped ball"
    assert ran.figures["bodies"]["ball"]["dropped"]


@pytest.mark.process
def test_a_ball_in_its_table_is_refused_before_anything_moves(domain, tmp_path):
    ran = grasp(tmp_path, "bodies.ball.position=[0.0, 0.0, -0.063]")
    assert (ran.status, ran.figures["verdict"]) == (2, "refused"), ran.output
    assert "body ball and body table overlap at the start by 3 mm" in ran.figures["reason"], ran.figures
    assert "\n" not in ran.figures["reason"]


@pytest.mark.process
def test_a_ball_that_falls_out_of_the_world_ends_the_run_with_the_cause(domain, tmp_path):
    slope = "bodies.floor.quaternion=[0.0, 0.3826834, 0.0, 0.9238795]"  # 45 degrees
    changes = "bodies.ball.friction=0.0", slope, "duration_s=8", "platform="
    ran = grasp(tmp_path, *changes)
    assert (ran.status, ran.figures["verdict"]) == (1, "vented"), ran.output
    assert "body ball has left the world, beyond its reach of 10 m" in ran.figures["reason"]


@pytest.mark.process
def test_a_long_arm_wraps_around_a_cylinder_and_carries_it(domain, tmp_path):
    changes = [f"bodies.{side}.motion.at_s=[6.5, 7.5]" for side in ("left", "right")]
    status, output, folder = run(
        tmp_path / "runs", "mode=lockstep", "duration_s=12", *changes, scene="wrap_a_cylinder"
    )
    assert (status, summary(folder)["verdict"]) == (0, "good"), output
    found = summary(folder)["bodies"]["cylinder"]
    assert not found["dropped"]
    assert found["largest_normal_n"] > 0.03 * 9.81  # it presses, and does not only lie


@pytest.mark.process
@pytest.mark.parametrize(("friction", "is_carried"), [(0.8, True), (0.0, False)])
def test_two_arms_carry_a_bar_by_friction(domain, tmp_path, friction, is_carried):
    name = "two_arms_carry_a_bar"
    changes = "mode=lockstep", "duration_s=5", f"bodies.bar.friction={friction}"
    status, output, folder = run(tmp_path / "runs", *changes, scene=name)
    with BagReader(folder / "bag") as reader:
        topic = f"/{name}/bodies/bar/pose"
        recorded = Messages(reader, {topic: PoseStamped})
        poses = [recorded.read(item) for item in reader.messages({topic})]
    places = np.array(
        [messages.pose_arrays(one.pose)[0] for one in poses if messages.to_ns(one.header.stamp) < 5e9]
    )
    found = summary(folder)["bodies"]["bar"]
    if not is_carried:
        assert np.ptp(places[:, 0]) < 0.010 or found["dropped"]
        return
    assert (status, summary(folder)["verdict"]) == (0, "good"), output
    assert not found["dropped"]
    assert np.ptp(places[:, 0]) > 0.020  # both tips move by 20 mm
    assert np.abs(places[:, 1]).max() < 2e-3
    assert np.ptp(places[:, 2]) < 3e-3
