"""Shapes in which pressures hold an arm at rest: a map from pressures, followed from neighbour to neighbour.

Pressures are counted here from 0 at the least to 1 at the highest that each chamber has.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.model import SoftArm
from soro_core.model.build import find_site
from soro_core.model.tables import Site
from soro_core.planning.kernel.walk import Surroundings, walk
from soro_core.planning.obstacles import Obstacles
from soro_core.planning.steps import Planning
from soro_core.robot.coordinates import strain_fields

# Steps along the range of one chamber, by which its effect on the arm is known; least effect [m].
_RANGE_STEPS, _SHORTEST_M = 8, 1e-6
# Steps of a search for a shape with the tip at a point; its largest motion of the tip in one step, as a part
# of the arm's length, and of what is freed; damping of a step.
_GOAL_STEPS, _REACH, _FREED, _DAMPING = 24, 0.25, 0.05, 1e-3


@dataclass(frozen=True)
class HeldLine:
    """What has been seen along a line in pressures.

    Attributes
    ----------
    x : ndarray (n + 1, n_u)
        Pressures from the begin to the last clear shape.
    q : ndarray (n + 1, n_q)
        Coordinates.
    places : ndarray (n + 1, m, 3)
        Positions of the arm in the world [m].
    clearance_m : ndarray (n + 1,)
        Least clearance of each [m].
    whole : bool
        Whether it reaches its end.
    """

    x: Array
    q: Array
    places: Array
    clearance_m: Array
    whole: bool


class HeldShapes:
    """Shapes of one arm among obstacles.

    Parameters
    ----------
    arm : SoftArm
        Without contact, and with the load that it carries.
    obstacles : Obstacles
        Where it is looked at, and what it keeps clear of.
    low_pa, high_pa : ndarray (n_u,)
        Range of the pressures [Pa gauge].
    limit : ndarray (n_q,)
        Largest absolute coordinates.

    Attributes
    ----------
    looked_at : int
        Shapes that were found so far.
    motion_m : ndarray (n_u,)
        How far the arm moves over the range of each chamber [m], after `measure`.
    """

    def __init__(
        self, arm: SoftArm, obstacles: Obstacles, low_pa: Array, high_pa: Array, limit: Array
    ) -> None:
        self.arm, self.obstacles = arm, obstacles
        self.low_pa, self.span_pa, self.limit = low_pa, high_pa - low_pa, limit
        fields = strain_fields(arm.robot)
        sites = [find_site(arm.robot, arm.tables, float(s)) for s in obstacles.places]
        rows = {name: np.array([getattr(one, name) for one in sites]) for name in Site._fields}
        weight = np.where(fields.stretch, 1.0, fields.length)
        self._around = Surroundings(
            **rows,
            radius=obstacles.radius,
            planes=obstacles.planes,
            spheres=obstacles.spheres,
            limit=limit,
            weight=weight,
        )
        self._boxes = arm._box, arm._room
        self.looked_at = 0
        self.motion_m = np.ones(arm.n_u)

    @property
    def range_pa(self) -> tuple[float, float]:
        """Least and highest pressure of all chambers [Pa gauge]."""
        return float(self.low_pa.min()), float((self.low_pa + self.span_pa).max())

    def measure(self) -> Planning[None]:
        """Find how far the arm moves over the range of each chamber."""
        found = np.empty(self.arm.n_u)
        for u, end in enumerate(np.eye(self.arm.n_u)):
            line = self.line(np.zeros_like(end), end, np.zeros(self.arm.n_q), -math.inf, _RANGE_STEPS)
            steps = np.linalg.norm(np.diff(line.places, axis=0), axis=2).sum(axis=0)
            found[u] = max(float(steps.max(initial=0.0)), _SHORTEST_M)
            yield
        self.motion_m = found

    def apart(self, x: Array, other: Array) -> Array:
        """Return about how far the arm moves [m] between pressures (n, n_u) and others (n_u,)."""
        return np.asarray(np.sqrt((((x - other) * self.motion_m) ** 2).sum(axis=-1)))

    def line(self, begin: Array, end: Array, q: Array, margin_m: float, steps: int | None = None) -> HeldLine:
        """Look along a line in pressures until the arm is nearer to an obstacle than a margin.

        Parameters
        ----------
        begin, end : ndarray (n_u,)
        q : ndarray (n_q,)
            Coordinates near those at the begin, which is not judged.
        margin_m : float
            Least clearance [m].
        steps : int, optional
            Shapes that are looked at; default by how far the arm moves.
        """
        n = steps or max(1, math.ceil(float(self.apart(begin, end)) / self.obstacles.step_m))
        rows = np.empty((n + 1, q.size)), np.empty((n + 1, self._around.link.size, 3)), np.empty(n + 1)
        rows[0][0] = q
        change = (end - begin) / n
        pressures = self.low_pa + begin * self.span_pa, change * self.span_pa
        good = walk(*self._boxes, self._around, pressures, margin_m, rows)
        self.looked_at += n if good == n else good + 2
        x = begin + np.arange(n + 1)[:, None] * change
        x[n] = end
        q, places, clearance = (one[: good + 1] for one in rows)
        return HeldLine(x[: good + 1], q, places, clearance, good == n)

    def with_tip_at(
        self, goal: Array, x: Array, q: Array, tolerance_m: float, margin_m: float
    ) -> Planning[HeldLine | None]:
        """Find pressures that hold the tip at a point; None where the search ends at none.

        Half of its steps (Gauss-Newton) also turn the arm away from what it is nearer to than the margin.

        Parameters
        ----------
        goal : ndarray (3,)
            In the world [m].
        x : ndarray (n_u,)
            Where the search starts.
        q : ndarray (n_q,)
            Coordinates there.
        tolerance_m : float
            Largest distance of the tip [m].
        margin_m : float
            Clearance that is sought, and not always found [m].
        """
        arm, found = self.arm, self.line(x, x, q, -math.inf, 1)
        for i in range(_GOAL_STEPS):
            x, q = found.x[-1], found.q[-1]
            pose, jacobian = arm.pose_and_jacobian(q, arm.length)
            away = np.asarray(goal - pose[:3, 3])
            distance = float(np.linalg.norm(away))
            near: Array = self.obstacles.clearance(found.places[-1])
            clear = i >= _GOAL_STEPS // 2 or float(near.min()) >= margin_m
            if distance <= tolerance_m and clear:
                return self.line(x, x, q, -math.inf, 1)
            by_q, _, by_p = arm.derivatives(q, np.zeros_like(q), self.low_pa + x * self.span_pa)
            moves = -np.linalg.solve(by_q, by_p * self.span_pa)
            rows = pose[:3, :3] @ jacobian[3:] @ moves
            away *= min(1.0, _REACH * arm.length / distance) if distance > 0.0 else 1.0
            if not clear:
                slopes, missing = self._freeing(found.places[-1], near, q, np.asarray(moves), margin_m)
                rows, away = np.vstack((rows, slopes)), np.append(away, missing)
            found = self.line(x, x + _bounded(rows / self.motion_m, away, x, self.motion_m), q, -math.inf)
            if len(found.x) < 2:
                return None
            yield
        return None

    def _freeing(
        self, places: Array, clearance: Array, q: Array, moves: Array, margin_m: float
    ) -> tuple[Array, Array]:
        """Return how clearances below a margin change with pressures (k, n_u), and what they miss (k,)."""
        known, slopes, missing = self.obstacles, [], []
        for index in np.flatnonzero(clearance.min(axis=0) < margin_m):
            k = int(np.argmin(clearance[:, index]))
            pose, jacobian = self.arm.pose_and_jacobian(q, float(known.places[k]))
            slopes.append(known.away_from(int(index), places[k]) @ pose[:3, :3] @ jacobian[3:] @ moves)
            missing.append(min(margin_m - clearance[k, index], _FREED * self.arm.length))
        return np.array(slopes), np.array(missing)


def _bounded(slope: Array, away: Array, x: Array, unit: Array) -> Array:
    """Return a small change (n_u,) that brings the tip nearest, within the range."""
    low, high = -x * unit, (1.0 - x) * unit
    change, free = np.zeros_like(x), np.ones(x.size, dtype=bool)
    damped = np.vstack((slope, _DAMPING * np.linalg.norm(slope) * np.eye(x.size)))
    wanted = np.append(away, np.zeros(x.size))
    for _ in range(4 * x.size):
        if free.any():
            rest = wanted - damped[:, ~free] @ change[~free]
            towards = change.copy()
            towards[free] = np.linalg.lstsq(damped[:, free], rest, rcond=None)[0]
            step = towards - change
            with np.errstate(divide="ignore", invalid="ignore"):
                room = np.where(step > 0.0, (high - change) / step, (low - change) / step)
            room[step == 0.0] = np.inf
            k = int(np.argmin(room))
            change = change + min(1.0, float(room[k])) * step
            if room[k] < 1.0:
                free[k] = False
                continue
        force = damped.T @ (wanted - damped @ change)
        inward = np.where(change - low < high - change, force, -force)
        inward[free] = 0.0
        k = int(np.argmax(inward))
        if inward[k] <= 1e-9 * float(np.abs(force).max(initial=1e-300)):
            break
        free[k] = True
    return np.clip(change, low, high) / unit
