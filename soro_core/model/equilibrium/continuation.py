"""The branch of equilibria that begins at rest, followed while the pressures grow, docs/model.md (53).

Equilibria are a curve in the space of coordinates and share of the pressures. Followed by its own length
(pseudo-arclength continuation [K77]), it can be passed where it turns back in the pressures: there an arm
snaps or collapses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.linear import inverse

Force: TypeAlias = Callable[[Array, float], Array]

# Of the curve's length, where all pressures count 1, a strain 1, and a curvature its product with the length.
LONGEST, SHORTEST, MOST_STEPS = 0.1, 1e-5, 1000
MOST_ITERATIONS = 8
TOLERANCE = 1e-9
# Steps of the numerical derivatives by the coordinates and by the share, in which forces are linear.
DIFFERENCE, BY_SHARE = 1e-6, 1e-2
# Longest step across a place where the share turns back: its error there is about the square of this.
TURN = 1e-3
# Least cosine between the directions at both ends of a step.
STRAIGHT = 0.95


@dataclass(frozen=True)
class Branch:
    """Where the branch ends.

    Attributes
    ----------
    q : (n_q,)
        Coordinates near its crossing of the whole pressures; where it has none, those of its last point.
    share : float
        Largest share of the pressures that it has passed, 1 where it crosses them.
    is_whole : bool
        Whether it was followed to its end; else only as far as `MOST_STEPS` go.
    """

    q: Array
    share: float
    is_whole: bool = True


def follow(force: Force, rest: Array, weight: Array, scale: Array) -> Branch:
    """Follow the branch from rest to the whole pressures.

    Parameters
    ----------
    force : callable
        Unbalanced generalised force (n_q,) of coordinates and of the share of the pressures that act; a
        ModelError marks coordinates beyond the model.
    rest : (n_q,)
        Equilibrium without pressures.
    weight : (n_q,)
        Weight of each coordinate: 1 for a strain, the link's length for a curvature.
    scale : (n_q,)
        Stiffness of each coordinate.
    """

    def balance(z: Array) -> Array:
        return weight / scale * force(z[:-1] / weight, float(z[-1]))

    z = np.append(rest * weight, 0.0)
    forward = np.append(np.zeros(rest.size), 1.0)
    length, furthest = LONGEST, 0.0
    try:
        slope = _slope(balance, z)
        heading = _along(slope, forward)
        for _ in range(MOST_STEPS):
            after = _step(balance, z, slope, heading, length)
            if after is not None:
                slope_after = _slope(balance, after)
                turned = _along(slope_after, heading)
                turns = heading[-1] > 0.0 > turned[-1] and length > TURN
            if after is None or turns or turned @ heading < STRAIGHT:
                length *= 0.5
                if length < SHORTEST:
                    break
                continue
            if after[-1] >= 1.0:
                part = (1.0 - z[-1]) / (after[-1] - z[-1])
                return Branch((z + part * (after - z))[:-1] / weight, 1.0)
            z, slope, heading = after, slope_after, turned
            furthest = max(furthest, float(z[-1]))
            if z[-1] <= 0.0:  # it has turned back to no pressure
                break
            length = min(1.5 * length, LONGEST)
        else:
            return Branch(z[:-1] / weight, furthest, is_whole=False)
    except (ModelError, np.linalg.LinAlgError):  # beyond the model, or all bounds
        pass
    return Branch(z[:-1] / weight, furthest)


def _step(
    balance: Callable[[Array], Array], z: Array, slope: Array, heading: Array, length: float
) -> Array | None:
    """Next point; None where the step is too long for the curve. The derivatives are those at the start."""
    ahead = z + length * heading
    x = ahead
    try:
        back = inverse(np.vstack((slope, heading)))
        for _ in range(MOST_ITERATIONS):
            change = back @ np.append(balance(x), heading @ (x - ahead))
            x = x - change
            if np.abs(change).max() < TOLERANCE:
                return np.asarray(x)
    except (ModelError, np.linalg.LinAlgError):
        pass
    return None


def _along(slope: Array, heading: Array) -> Array:
    """Unit vector along the curve, on the side of the heading."""
    along: Array = np.linalg.svd(slope)[2][-1]
    return along if along @ heading > 0.0 else -along


def _slope(balance: Callable[[Array], Array], z: Array) -> Array:
    """Derivatives (n_q, n_q + 1) by central differences."""
    steps = np.diag(np.append(np.full(z.size - 1, DIFFERENCE), BY_SHARE))
    return np.stack([(balance(z + e) - balance(z - e)) / (2.0 * e.sum()) for e in steps], axis=1)
