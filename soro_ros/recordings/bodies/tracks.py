"""Where the bodies of a recorded run were."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.bodies import RigidBody
from soro_lab.scene import Scene


@dataclass(frozen=True)
class BodyTrack:
    """Where a body of a recorded run was.

    Attributes
    ----------
    body : RigidBody
    t : (n,)
        Times [s].
    poses : (n, 4, 4)
        In the world.
    """

    body: RigidBody
    t: Array
    poses: Array

    def at(self, t: float) -> Array:
        """Pose (4, 4) at the last time up to one [s]; the first one before them."""
        return np.asarray(self.poses[max(int(np.searchsorted(self.t, t + 1e-9)) - 1, 0)])


def tracks_of(bag: Path, scene: Scene, zero: str) -> dict[str, BodyTrack]:
    """Return where the bodies of a run were, by name; those of which the bag has nothing are left out.

    Parameters
    ----------
    bag : Path
        Folder of the bag.
    scene : Scene
        Of all arms.
    zero : str
        Topic, the first message of which has the time 0: ``/grasp_ball/thumb/arm/desired/tip``.

    Raises
    ------
    BagError
        If it cannot be read.
    """
    if not scene.bodies:
        return {}
    from geometry_msgs.msg import PoseStamped
    from sensor_msgs.msg import JointState

    from soro_ros.conversion import messages

    topics = {name: f"/{scene.name}/bodies/{name}/pose" for name in scene.bodies}
    kinds: dict[str, Any] = dict.fromkeys(topics.values(), PoseStamped)
    rows = messages_of(bag, kinds | {zero: JointState if zero.endswith("/state") else PoseStamped})
    start_ns = min(
        (listed[0][0] for listed in ([rows[zero]] if rows[zero] else rows.values()) if listed), default=0
    )
    return {
        name: BodyTrack(
            scene.bodies[name],
            1e-9 * np.array([stamp - start_ns for stamp, _ in rows[topic]]),
            np.array([messages.transform(one.pose) for _, one in rows[topic]]),
        )
        for name, topic in topics.items()
        if rows[topic]
    }


def messages_of(bag: Path, kinds: dict[str, Any]) -> dict[str, list[tuple[int, Any]]]:
    """Return stamps [ns] and messages by topic."""
    from soro_lab.bag import BagReader
    from soro_ros.conversion import messages
    from soro_ros.conversion.decoding import Messages

    rows: dict[str, list[tuple[int, Any]]] = {topic: [] for topic in kinds}
    with BagReader(bag) as reader:
        recorded = Messages(reader, {one.name: kinds[one.name] for one in reader.topics if one.name in kinds})
        for item in reader.messages({topic.name for topic in reader.topics} & kinds.keys()):
            if (message := recorded.read(item)) is not None:
                rows[item.topic].append((messages.to_ns(message.header.stamp), message))
    return rows
