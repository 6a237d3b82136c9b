"""Bodies that an arm holds at a place: which points of both are joined, from where they are at the start."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.bodies.body import RigidBody
from soro_core.bodies.mounted import tip_frame
from soro_core.errors import ModelError
from soro_core.integrate.base_motion import Base
from soro_core.model import SoftArm
from soro_core.robot.description import END_TOLERANCE


def refuse_displaced(
    bodies: Mapping[str, RigidBody],
    arms: Sequence[str],
    motions: Mapping[str, Base],
    mounts: Mapping[str, str],
) -> None:
    """Refuse motions of what is joined that are displaced or turned at the start: the joint would tear there.

    Parameters
    ----------
    bodies : mapping of str to RigidBody
    arms : sequence of str
        Names.
    motions : mapping of str to callable
        Of bodies and of bases of arms, by name.
    mounts : mapping of str to str
        Arms that another one carries, and which.

    Raises
    ------
    ModelError
    """
    joined = [
        (name, body.attached.arm or arms[0]) for name, body in bodies.items() if body.attached is not None
    ]
    moved = [(body, mounts.get(arm, arm)) for body, arm in joined]
    for who in dict.fromkeys(name for pair in moved for name in pair if name in motions):
        start = motions[who](0.0)
        if np.any(start.displacement) or not np.array_equal(start.rotation, np.eye(3)):
            text = f"motions: {who} is displaced at 0 s, which would tear a joint"
            raise ModelError(f"{text}; allowed are motions that begin at rest there", "motions")


class Joint(NamedTuple):
    """A body on an arm: numbers of both, place along the arm [m], and points in both frames (n, 3) [m]."""

    arm: int
    body: int
    place: float
    on_arm: Array
    on_body: Array


def joints_of(
    bodies: Mapping[str, RigidBody],
    arms: Mapping[str, SoftArm],
    q0: Mapping[str, ArrayLike],
    mounts: Mapping[str, str],
) -> list[Joint]:
    """What holds bodies on arms, from where both are at the start.

    Raises
    ------
    ModelError
        If a body is too far from its place.
    """
    found = []
    for b, (name, body) in enumerate(bodies.items()):
        if body.attached is None:
            continue
        arm_name = body.attached.arm or next(iter(arms))
        arm = arms[arm_name]
        place = arm.length if body.attached.place is None else min(body.attached.place, arm.length)
        own = arm.pose(q0.get(arm_name, np.zeros(arm.n_q)), place)
        pose = tip_frame(mounts, arms, arm_name, q0) @ own
        apart, (_, bound) = pose[:3, 3] - body.position, body.shape.extents()
        radius = max(link.radius for link in arm.robot.links)
        if (far := math.hypot(*apart)) > bound + radius + END_TOLERANCE:
            raise ModelError(
                f"bodies.{name}.attached: {far:.4g} m from the centre to the place of {arm_name}; "
                f"allowed are {bound + radius:.4g} m at most, within or beside it",
                "attached",
            )
        # Of a weld as far apart as the body is large: they bear its moments.
        far = max(bound, radius)
        points = np.array([[0, 0, 0], [far, 0, 0], [0, far, 0]][: 3 if body.attached.joint == "weld" else 1])
        held = ((pose[:3, :3] @ points.T).T + apart) @ body.rotation @ body.axes
        found.append(Joint(list(arms).index(arm_name), b, place, 1.0 * points, held))
    return found


def joint_tables(joints: Sequence[Joint], arc: Sequence[float], first_site: Sequence[int]) -> dict[str, Any]:
    """Return the entries of `ArmTables` on joints, a row a point."""
    rows = [(one, points) for one in joints for points in zip(one.on_arm, one.on_body, strict=True)]
    sections = []
    for one, _ in rows:
        first, behind = first_site[one.arm], first_site[one.arm + 1]
        sections.append(first + int(np.argmin(np.abs(np.array(arc[first:behind]) - one.place))))
    return {
        "joint_arm": np.array([one.arm for one, _ in rows], dtype=np.int64),
        "joint_section": np.array(sections, dtype=np.int64),
        "joint_body": np.array([one.body for one, _ in rows], dtype=np.int64),
        "joint_offset": np.array([points for _, points in rows], dtype=np.float64).reshape(-1, 2, 3),
    }
