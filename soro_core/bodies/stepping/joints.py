"""Points at which bodies are held on arms: a contact that pulls as well, and lets nothing slip.

A ball joint is one such point; three of them, not on a line, are a weld.
"""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.bodies.stepping.contacts import arm_side, body_side
from soro_core.bodies.stepping.records import HELD, HERE, MOST_CONTACTS, THERE, ArmTables, WorldTables
from soro_core.bodies.stepping.vectors import turn


@inner
def find_joints(arms: ArmTables, w: WorldTables) -> bool:
    """Write the contacts of all joints; False if there are more than `MOST_CONTACTS`."""
    k, n_b = w.contacts, w.bodies.kind.shape[0]
    on_arm, on_body = w.points[HERE], w.points[THERE]
    for j in range(arms.joint_body.shape[0]):
        i, s, b = arms.joint_arm[j], arms.joint_section[j], arms.joint_body[j]
        c = int(k.counts[0])
        if c == MOST_CONTACTS:
            return False
        turn(arms.R[s], arms.joint_offset[j, 0], on_arm)
        turn(w.now.rotation[b], arms.joint_offset[j, 1], on_body)
        for r in range(3):
            on_arm[r] += arms.p[s, r]
            on_body[r] += w.now.place[b, r]
            k.apart[c, r] = on_arm[r] - on_body[r]
            k.point[c, r] = 0.5 * (on_arm[r] + on_body[r])
            k.given[c, r] = 0.0
            for axis in range(3):
                k.frame[c, r, axis] = 1.0 if r == axis else 0.0
        k.key[c] = -1 - 2 * n_b - j  # behind those of hinges
        k.gap[c] = k.bias[c] = k.restitution[c] = 0.0
        k.friction[c] = HELD
        # The piece that begins there, or at the end of the arm the last one.
        ends = s + 1 == arms.first_site[i + 1]
        k.part[c, 0] = 1.0 if ends else 0.0
        arm_side(w, arms, c, 0, i, s - 1 if ends else s)
        body_side(w, c, 1, b)
        k.counts[0] = c + 1
    return True


@inner
def is_joined(arms: ArmTables, i: int, b: int) -> bool:
    """Whether body b is held on arm i or its host: they do not touch besides."""
    found = False
    for j in range(arms.joint_body.shape[0]):
        holds = arms.joint_arm[j] == i or arms.joint_arm[j] == arms.mounts.host[i]
        found = found or (holds and arms.joint_body[j] == b)
    return found
