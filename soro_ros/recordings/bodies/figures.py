"""Figures of the bodies of a run: what was held, what crept, what was squeezed."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from soro_core.arrays import Array
from soro_core.bodies.body import GRAVITY, RigidBody
from soro_lab.scene import Scene
from soro_ros.recordings.bodies.tracks import messages_of
from soro_ros.recordings.report import last_s
from soro_ros.recordings.verdict import Verdict

# A body that no arm has touched for longer than this is dropped [s]; a free one falls 49 mm in this time.
_LET_GO_S = 0.1


@dataclass(frozen=True)
class BodyFigures:
    """Figures of a body that is not fixed; NaN where they are not known.

    Attributes
    ----------
    dropped : bool
        Whether an arm has touched it, and none does in the last 0.1 s of control; not of a hinged one.
    creep_m_s : float
        Speed of its centre in the last 5 s, of the straight line through its places; beside a hand at the tip
        of an arm, seen from that tip.
    weight_balance : float
        Mean of the contact forces against its weight there, over the weight, minus 1; NaN of a hinged one.
    largest_normal_n : float
        Largest sum of the normal forces on it during a tick of the control.
    effort_n_m : float
        Torque of the drive of a hinged body, RMS from its first time on [N m].
    effort_part : float
        The same over the torque that the same motion takes where nothing else holds the body.
    """

    dropped: bool
    creep_m_s: float
    weight_balance: float
    largest_normal_n: float
    effort_n_m: float = math.nan
    effort_part: float = math.nan

    def to_dict(self) -> dict[str, Any]:
        """Return the figures by name; an unknown figure is None."""
        return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in asdict(self).items()}


def figures_of_bodies(bag: Path, scene: Scene) -> dict[str, BodyFigures]:
    """Return the figures of the bodies of a run that are not fixed, by name; none without control.

    Raises
    ------
    BagError
        If it cannot be read.
    """
    from geometry_msgs.msg import PoseStamped, WrenchStamped
    from sensor_msgs.msg import JointState

    from soro_ros.conversion import force, messages

    wanted = {name: body for name, body in scene.bodies.items() if not body.fixed}
    place, control = f"/{scene.name}/bodies", f"/{scene.each[0].name}/arm/desired/tip"
    kinds: dict[str, Any] = {control: PoseStamped, f"{place}/contacts": JointState}
    carriers = list(dict.fromkeys(scene.mounts.values()))
    palm = f"/{scene.name}/{carriers[0]}/truth/tip" if scene.hand is not None and carriers else ""
    kinds |= {palm: PoseStamped} if palm else {}
    for name in wanted:
        kinds |= {f"{place}/{name}/pose": PoseStamped, f"{place}/{name}/wrench": WrenchStamped}
        kinds |= {f"{place}/{name}/joint": JointState}
    rows = messages_of(bag, kinds)
    if not rows[control]:
        return {}
    begin_ns = rows[control][0][0]
    end_ns = min(rows[control][-1][0], begin_ns + round(1e9 * scene.duration_s))
    last_ns = end_ns - round(1e9 * last_s(scene))

    def between(topic: str, first_ns: int) -> list[tuple[int, Any]]:
        return [(stamp, one) for stamp, one in rows[topic] if first_ns <= stamp <= end_ns]

    contacts = [(stamp, messages.efforts(one)) for stamp, one in between(f"{place}/contacts", begin_ns)]
    palms = {stamp: messages.transform(one.pose) for stamp, one in between(palm, last_ns)} if palm else {}
    arms = {arm.prefix.rstrip("/") or "arm" for arm in scene.each}
    found = {}
    for name, body in wanted.items():
        joint = [(1e-9 * (s - begin_ns), one) for s, one in between(f"{place}/{name}/joint", begin_ns)]
        own = [(s, {p: n for p, n in of.items() if name in p.split("/")}) for s, of in contacts]
        touched_ns = [stamp for stamp, of in own if any(arms & set(pair.split("/")) for pair in of)]
        since_s = 1e-9 * (own[-1][0] - touched_ns[-1]) if touched_ns else 0.0
        poses, pushes = between(f"{place}/{name}/pose", last_ns), between(f"{place}/{name}/wrench", last_ns)
        seen = [(s, messages.transform(one.pose)) for s, one in poses if not palm or s in palms]
        carried = np.array([force.force_of(one)[2] for _, one in pushes])
        weight_n = math.nan if body.mass is None or body.hinge is not None else body.mass * GRAVITY
        found[name] = BodyFigures(
            dropped=body.hinge is None and since_s > _LET_GO_S,
            # What an arm holds moves with it.
            creep_m_s=math.nan
            if body.attached
            else _speed(
                np.array([1e-9 * (stamp - last_ns) for stamp, _ in seen]),
                np.array([_seen_from(palms.get(stamp), pose) for stamp, pose in seen]),
            ),
            weight_balance=float(carried.mean()) / weight_n - 1.0 if carried.size else math.nan,
            largest_normal_n=max((sum(of.values()) for _, of in own), default=math.nan),
            **_efforts(body, joint),
        )
    return found


def _efforts(body: RigidBody, rows: list[tuple[float, Any]]) -> dict[str, float]:
    """Return the figures of the drive of a hinged body, from times of control [s] and joint states."""
    if body.hinge is None or (drive := body.hinge.drive) is None:
        return {}
    driven = [(t, one.effort[0]) for t, one in rows if t >= drive.at_s[0]]
    if not driven:
        return {}
    efforts, alone = [one for _, one in driven], [body.torque_alone(*drive(t)) for t, _ in driven]
    effort, whole = (float(np.sqrt(np.mean(np.square(one)))) for one in (efforts, alone))
    return {"effort_n_m": effort, "effort_part": effort / whole if whole else math.nan}


def _seen_from(palm: Array | None, pose: Array) -> Array:
    """Place of a body (3,) [m], seen from a palm (4, 4); in the world without one."""
    return pose[:3, 3] if palm is None else np.asarray(palm[:3, :3].T @ (pose - palm)[:3, 3])


def _speed(t: Array, places: Array) -> float:
    """Speed [m/s] of the straight line through places (n, 3) [m] at times (n,) [s]."""
    return float(np.linalg.norm(np.polyfit(t, places, 1)[0])) if t.size > 2 else math.nan


def judge_bodies(figures: dict[str, BodyFigures]) -> Verdict:
    """Return the verdict on bodies: lost with one that was dropped."""
    dropped = [name for name, one in figures.items() if one.dropped]
    return Verdict("lost", f"dropped {', '.join(dropped)}") if dropped else Verdict("good")


def table_of_bodies(figures: dict[str, BodyFigures]) -> Table:
    """Return the figures as a table for the terminal."""
    shown = Table(title="bodies")
    for heading in ("", "dropped", "creep", "forces over weight - 1", "largest normal force", "effort left"):
        shown.add_column(heading)
    for name, one in figures.items():
        shown.add_row(
            name,
            "yes" if one.dropped else "no",
            "-" if math.isnan(one.creep_m_s) else f"{1e6 * one.creep_m_s:.3g} um/s",
            "-" if math.isnan(one.weight_balance) else f"{one.weight_balance:.2g}",
            f"{one.largest_normal_n:.3g} N",
            "-" if math.isnan(one.effort_part) else f"{100.0 * one.effort_part:.3g} %",
        )
    return shown
