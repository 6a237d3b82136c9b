"""What the answers of an arm to one chamber after the other say of its wiring, its chambers and its base.

In each state that the arm has been held in, the forces of the model balance:

    s f_e(q) + m Y(q) + G(q) + M dqd/T + R dq/T + A(q) tilt = sum_j g_j H(q) p_j

They are linear in the stiffness s and the load m, which are not known, in the gain g_j of each chamber and in
a tilt of the base: one least-squares problem for each way in which the chambers may be wired. A gain that all
chambers share cannot be told from s and m: the mean of the gains is that of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.linear import inverse
from soro_core.model import SoftArm
from soro_core.robot import Robot
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix, rotation_exp

# Errors of the model that no wiring explains: parts of the elastic displacement, of the one by pressure, and
# of the length.
_ELASTIC, _PRESSED, _SEEN = 0.003, 0.02, 1.5e-3
# Deviations that are expected of stiffness, gains and tilt [rad], and of the mean of the gains.
_SOFT, _GAIN, _TILT, _MEAN = 0.3, 0.3, 0.3, 0.02
# Least stiffness, by that of the file, for what a tilt does.
_SOFTEST = 0.3
# Of fewer states a load that changes explains any.
_LEAST_STATES = 5
# Error of a load that has changed, as a part of the heaviest.
_LOAD_PART = 0.1
# Difference [rad] for the derivative by the tilt.
_STEP = 1e-3
# Sum of squares for each state from which on deviations are larger.
_SPREAD = 5.0
# Part of the square of the elastic motion, large where an arm leans, that counts beside that by pressure.
_STIFF = 0.1
# Least motion that counts as one by pressure [m].
_LEAST_M = 1e-9
# Deviation [kg] of a load that is at its bound.
_FIXED_KG = 1e-6


class HeldState(NamedTuple):
    """Means over the time for which the arm was held at some pressures.

    Attributes
    ----------
    q : ndarray (n_q,)
        Coordinates.
    rate, acceleration : ndarray (n_q,)
        Change of coordinates and of their rates in this time, by its length.
    pressure_pa : ndarray (n_u,)
        Measured pressures [Pa gauge].
    """

    q: Array
    rate: Array
    acceleration: Array
    pressure_pa: Array


@dataclass(frozen=True)
class WiringFit:
    """The best explanation with one wiring.

    Attributes
    ----------
    wiring : tuple of int
        The chamber in which the pressure of each valve acts.
    cost : float
        Sum of squares of what is left and of what differs from the expectation, in deviations.
    residual_part : float
        Residual of the motions, by those that pressures make and the elastic arm resists.
    stiffness, load_kg : float
        Stiffness by that of the file, and load at the tip [kg].
    tilt : ndarray (2,)
        Turn of the base about its x and y axes [rad].
    tilt_std : float
        Its deviation [rad].
    gain, gain_covariance : ndarray (n_u,), (n_u, n_u)
        Gain of each valve's chamber.
    changed_kg : float
        By how much the load is another one from one of the states on [kg]; 0 where it may not be.
    """

    wiring: tuple[int, ...]
    cost: float
    residual_part: float
    stiffness: float
    load_kg: float
    tilt: Array
    tilt_std: float
    gain: Array
    gain_covariance: Array
    changed_kg: float = 0.0


class _Rows(NamedTuple):
    """The balance of one state, each row by its deviation: columns of s, m and tilt, of valve j in chamber k
    (n_u, n_u, n), the known forces, and the deviation [m]."""

    unknown: Array
    pressed: Array
    known: Array
    std_m: float


class WiringModel:
    """What the model of an arm says of states that it was held in.

    Parameters
    ----------
    arm : SoftArm
    heaviest_kg : float
        Largest load at the tip [kg].

    Attributes
    ----------
    links : tuple of tuple of int
        Chambers of each link.
    """

    def __init__(self, arm: SoftArm, heaviest_kg: float) -> None:
        self._arm, self._heaviest_kg = arm, heaviest_kg
        self._ends = np.cumsum([link.length for link in arm.robot.links])
        self._tilted = [SoftArm(_tilted(arm.robot, _STEP * axis)) for axis in np.eye(3)[:2]]
        names = arm.robot.chamber_names
        owners = [name.rsplit("/", 1)[0] for name in names]
        self.links = tuple(
            tuple(k for k, one in enumerate(owners) if one == owner) for owner in dict.fromkeys(owners)
        )

    def fits(
        self,
        states: Sequence[HeldState],
        between: Callable[[], None] = lambda: None,
        same_load: bool = False,
    ) -> list[WiringFit]:
        """Return the fit of every wiring, and of that of the file with a load that changes; the best first.

        Parameters
        ----------
        states : sequence of HeldState
        between : callable
            Called again and again: this takes longer than a tick.
        same_load : bool
            Whether no load that changes is tried.
        """
        # What a tilt does depends on stiffness and load: they come from a fit that takes those of the file.
        stiffness, load_kg = 1.0, 0.0
        for _ in range(2):
            rows, fits = [], []
            for state in states:
                between()
                rows.append(self._rows(state, stiffness, load_kg))
            own = tuple(range(self._arm.n_u))
            told = not same_load and len(states) >= _LEAST_STATES
            changes = [(own, k) for k in range(1, len(states))] if told else []
            for wiring, changed in (*((one, 0) for one in self._wirings()), *changes):
                between()
                fit = self._fit(rows, wiring, changed)
                if not changed or self._is_possible(fit):
                    fits.append(fit)
            fits.sort(key=lambda fit: fit.cost)
            stiffness, load_kg = max(fits[0].stiffness, _SOFTEST), fits[0].load_kg
        return fits

    def _is_possible(self, fit: WiringFit) -> bool:
        """Whether an arm can be as soft as this, and carry the load that has changed."""
        doubt_kg = _LOAD_PART * self._heaviest_kg
        return fit.stiffness >= _SOFTEST and (
            -doubt_kg <= fit.load_kg + fit.changed_kg <= self._heaviest_kg + doubt_kg
        )

    def _wirings(self) -> Iterator[tuple[int, ...]]:
        """Yield the wiring of the file, each swap of two, and the chambers of links rotated by one."""
        own = tuple(range(self._arm.n_u))
        found = {own: None}
        for a, b in combinations(own, 2):
            found[tuple(b if k == a else a if k == b else k for k in own)] = None
        large = [link for link in self.links if len(link) > 2]
        for turned in (*([link] for link in large), large):
            for step in (1, -1):
                wiring = list(own)
                for link in turned:
                    for k, n in zip(link, np.roll(link, step).tolist(), strict=True):
                        wiring[k] = n
                found[tuple(wiring)] = None
        yield from found

    def _rows(self, state: HeldState, stiffness: float, load_kg: float) -> _Rows:
        arm, q, ones = self._arm, state.q, np.eye(self._arm.n_u)
        weight, turn = self._motions(q)

        def rest(one: SoftArm, at: Array) -> Array:
            none = np.zeros(one.n_q)
            force = stiffness * one.elastic_force(at) + one.gravity_force(at)
            return np.asarray(force + load_kg * one.tip_mass_force(at, none, none))

        moving = arm.inertia_matrix(q) @ state.acceleration + arm.damping_force(q, state.rate)
        tilt = [
            (rest(one, q - _STEP * seen) - rest(arm, q)) / _STEP
            for one, seen in zip(self._tilted, turn.T, strict=True)
        ]
        load = arm.tip_mass_force(q, state.rate, state.acceleration)
        pressed = np.array(
            [[weight @ arm.pressure_force(q, p * one) for one in ones] for p in state.pressure_pa]
        )
        unknown = weight @ np.column_stack([arm.elastic_force(q), load, *tilt])
        made = np.linalg.norm(weight @ arm.pressure_force(q, state.pressure_pa))
        elastic = np.linalg.norm(unknown[:, 0])
        std = float(_SEEN * arm.length + _ELASTIC * elastic + _PRESSED * made)
        return _Rows(unknown / std, pressed / std, weight @ (arm.gravity_force(q) + moving) / std, std)

    def _motions(self, q: Array) -> tuple[Array, Array]:
        """Return how forces move the ends of all links (n, n_q), and the q (n_q, 2) of a turned base.

        Motions are those of the elastic arm, as positions [m] and rotations times half its length [m].
        """
        arm, half = self._arm, 0.5 * self._arm.length
        base = np.asarray(arm.robot.base_position, dtype=np.float64)
        axes = matrix_from_quaternion(np.asarray(arm.robot.base_quaternion, dtype=np.float64))[:, :2]
        motions, turned = [], []
        for s in self._ends:
            pose, jacobian = arm.pose_and_jacobian(q, float(s))
            own = pose[:3, :3].T
            motions += [half * jacobian[:3], jacobian[3:]]
            turned += [half * own @ axes, own @ np.cross(axes, pose[:3, 3] - base, axisa=0, axisc=0)]
        seen = np.linalg.lstsq(np.vstack(motions), np.vstack(turned), rcond=None)[0]
        return np.vstack(motions) @ inverse(arm.stiffness_matrix(q)), seen

    def _fit(self, rows: Sequence[_Rows], wiring: tuple[int, ...], changed: int = 0) -> WiringFit:
        """Return the fit of a wiring; with another load in state `changed`, if it is not 0, and after it."""
        n, most = self._arm.n_u, max(0.5 * self._heaviest_kg, _FIXED_KG)
        extra = 2 if changed else 0
        columns = []
        for k, one in enumerate(rows):
            gains = [-one.pressed[j, wiring[j]] for j in range(n)]
            # The load may change in the middle of a state.
            later = [one.unknown[:, 1] * now for now in (k == changed, k > changed)[:extra]]
            columns.append(np.column_stack([one.unknown, *gains, *later]))
        left = np.vstack([*columns, np.repeat([0.0, 1.0 / (n * _MEAN), 0.0], [4, n, extra])])
        right = np.append(-np.concatenate([one.known for one in rows]), 1.0 / _MEAN)
        mean = np.array([1.0, 0.0, 0.0, 0.0, *np.ones(n), *np.zeros(extra)])
        std = np.array([_SOFT, most, _TILT, _TILT, *np.full(n, _GAIN), *np.full(extra, most)])
        x, covariance, cost = _solve(left, right, mean, std)
        if not 0.0 <= x[1] <= self._heaviest_kg:
            mean[1], std[1] = np.clip(x[1], 0.0, self._heaviest_kg), _FIXED_KG
            x, covariance, cost = _solve(left, right, mean, std)
        # Where the model is worse than expected, so are the numbers.
        covariance *= max(1.0, cost / (_SPREAD * len(rows)))
        tilt_std = float(np.sqrt(np.trace(covariance[2:4, 2:4])))
        left_m, moved_m = 0.0, 0.0
        for one, by_x in zip(rows, columns, strict=True):
            residual = by_x @ x + one.known
            left_m += one.std_m**2 * float(residual @ residual)
            elastic = _STIFF * float(np.sum(one.unknown[:, 0] ** 2))
            made = by_x[:, 4 : 4 + n] @ np.ones(n)
            moved_m += one.std_m**2 * (elastic + float(made @ made))
        residual_part = float(np.sqrt(left_m / max(moved_m, _LEAST_M**2)))
        gain, of_gain = x[4 : 4 + n], covariance[4 : 4 + n, 4 : 4 + n]
        fitted = float(x[0]), float(x[1]), x[2:4], tilt_std, gain, of_gain
        changed_kg = float(x[-2:][-1 if changed < len(rows) - 1 else 0]) if changed else 0.0
        return WiringFit(wiring, cost, residual_part, *fitted, changed_kg)


def _solve(left: Array, right: Array, mean: Array, std: Array) -> tuple[Array, Array, float]:
    """Return the x nearest to ``left x = right`` and to a mean, its covariance, and the cost."""
    left, right = np.vstack([left, np.diag(1.0 / std)]), np.append(right, mean / std)
    covariance = np.asarray(np.linalg.inv(left.T @ left), dtype=np.float64)
    x = covariance @ (left.T @ right)
    return x, covariance, float(np.sum((left @ x - right) ** 2))


def _tilted(robot: Robot, turn: Array) -> Robot:
    base = matrix_from_quaternion(np.asarray(robot.base_quaternion, dtype=np.float64))
    return robot.replace(base_quaternion=tuple(quaternion_from_matrix(base @ rotation_exp(turn)).tolist()))
