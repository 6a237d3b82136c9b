"""An arm at the tip of another by `soro run`: both nodes' worlds, its bag, its replay and its film."""

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from sensor_msgs.msg import JointState

from soro_core.bodies import BodyWorld, simulate_world
from soro_core.twin import Twin
from soro_lab.bag import BagReader
from soro_lab.scene import load_scene
from soro_ros.conversion import messages
from soro_ros.conversion.decoding import Messages
from soro_ros.pictures import film
from soro_ros.recordings.replay import replay
from tests.soro_ros.running import run, summary

ARMS = ("upper", "lower")
SCENE = {
    "mode": "lockstep",
    "rate_hz": 100.0,
    "duration_s": 4.0,
    "robot": "three_bellow_hanging",
    "twin": {"refine": 1},
    "controller": {"law": "adaptive", "adapt": False},
    "arms": {
        "upper": {
            "controller": {"reference": {"kind": "set_point", "set_point": [0.05, 5.0, 0.0], "start_s": 1.0}}
        },
        "lower": {
            "mounted_on": "upper",
            "robot": "tue_three_bellow",
            "controller": {
                "reference": {"kind": "circle", "curvature_per_m": 5.0, "start_s": 1.0, "period_s": 2.0}
            },
        },
    },
}


@pytest.mark.process
def test_two_arms_in_a_chain_move_as_the_library_has_them_and_are_replayed(domain, tmp_path):
    file = tmp_path / "chain.yaml"
    file.write_text(yaml.safe_dump(SCENE))
    status, output, folder = run(tmp_path / "runs", scene=str(file))
    assert status == 0, output
    assert summary(folder)["verdict"] in ("good", "too_short"), output
    scene, bag = load_scene(folder / "scene_used.yaml"), folder / "bag"
    kinds = {f"/chain/{name}/truth/chambers": JointState for name in ARMS}
    kinds |= {f"/chain/{name}/truth/state": JointState for name in ARMS}
    kinds |= {f"/chain/{name}/truth/tip": PoseStamped for name in ARMS}
    kinds |= {f"/chain/{name}/arm/tip": PoseWithCovarianceStamped for name in ARMS}
    heard = {topic: [] for topic in kinds}
    with BagReader(bag) as reader:
        recorded = Messages(reader, kinds)
        for item in reader.messages(set(kinds)):
            message = recorded.read(item)
            heard[item.topic].append((1e-9 * messages.to_ns(message.header.stamp), message))
    # Each arm is where the library has it, under the pressures that its twin had.
    twins = {name: Twin(arm.loaded_robot, arm.twin_node()) for name, arm in scene.arms.items()}
    plants = {name: twin.plant.arm for name, twin in twins.items()}
    starts = {name: twin.initial().arm.q for name, twin in twins.items()}

    def pressures(name):
        rows = heard[f"/chain/{name}/truth/chambers"]
        t, values = np.array([stamp for stamp, _ in rows]), np.array([one.effort for _, one in rows])
        return lambda now: [np.interp(now, t, column) for column in values.T]

    world = BodyWorld({}, plants, starts, scene.mounts)
    whole = simulate_world(world, t_end=4.0, pressures={name: pressures(name) for name in ARMS})
    for name in ARMS:
        rows = [(stamp, one.position) for stamp, one in heard[f"/chain/{name}/truth/state"] if stamp <= 4.0]
        steps = np.rint(np.array([stamp for stamp, _ in rows]) / 1e-3).astype(int)
        np.testing.assert_allclose([q for _, q in rows], whole.q[name][steps], atol=1e-5)
        assert np.abs(whole.q[name][-1, 1:]).max() > 1.5
    # What the outer arm tells is seen from the tip of the inner one, which is its frame.
    for topic in ("truth/tip", "arm/tip"):
        frames = {name: {one.header.frame_id for _, one in heard[f"/chain/{name}/{topic}"]} for name in ARMS}
        assert frames == {"upper": {"world"}, "lower": {"chain/upper/tip"}}
    tips = {name: dict(heard[f"/chain/{name}/truth/tip"]) for name in ARMS}
    at = max(stamp for stamp in tips["upper"] if stamp <= 4.0)
    upper, lower = (messages.transform(tips[name][at].pose) for name in ARMS)
    ends = {name: rows[round(at / 1e-3)] for name, rows in whole.q.items()}
    true = world.frame_of("lower", ends) @ plants["lower"].pose(ends["lower"], plants["lower"].length)
    np.testing.assert_allclose(upper @ lower, true, atol=1e-6)
    again = replay(bag, scene)
    assert again.same, [topic for topic in again.topics if topic.differing]
    # The film of the carrier shows what it carries, from its tip on.
    upper = scene.arms["upper"]
    shown = film.with_carried(film.take(bag, upper, 0.0, 4.0, 5.0), bag, scene.carried_by(upper), 5.0)
    (carried,) = shown.carried
    np.testing.assert_allclose(carried.poses[:, 0], shown.poses[:, -1], atol=1e-12)
    assert len(shown.faces(3).corners) > 0
    assert carried.poses[-1, -1, 2, 3] < shown.poses[-1, -1, 2, 3] - 0.03  # it hangs below
