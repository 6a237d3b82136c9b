"""The delay of a sensor that its stamps do not declare, from what the model alone expects of its position.

A filter and a learner follow a delayed sensor: the innovation does not show the delay, and the force that
they find does. The unmodelled force, r = H p - [M q'' + C q' + G + f_e + R q' + creep], moves the place of
the sensor by J K^-1 r against the model. A delay d leaves J K^-1 K_t q' d there, K_t the stiffness with the
weight; a load, a soft arm and a shifted frame leave a displacement that the pose explains. All are fitted at
once:

    position - J K^-1 r = d (-J K^-1 K_t q') + m (-J K^-1 Y_m) + shift + soft J q
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.linear import inverse

if TYPE_CHECKING:
    from soro_core.estimation.config import EstimatorConfig
    from soro_core.estimation.kernel.belief import Belief
    from soro_core.model import SoftArm


# Deviations of the prior: a delay of 0.1 s, a load of twice the arm's own mass, which is also its bound, a
# shift of the frame by 0.1 mm, and an arm 30 % softer or stiffer.
_DELAY_S, _LOAD, _SHIFT_M, _SOFT = 0.1, 2.0, 1e-4, 0.3
# The stiffness along the motion is that over this time of it [s].
_AHEAD_S = 0.01
# An arm moves whose speed is above that many of its deviations: with a learned force, and without one, where
# the filter's noise allows for unmodelled forces and the rates err by less.
_MOVES, _MOVES_ALONE = 3.0, 0.5
# Rows are forgotten with this part of the fit's age, and this time constant at least [s]: what the first ones
# say of load and softness is wrong, because creep and filter have not settled.
_AGE_PART, _SHORTEST_S = 0.25, 0.2
# Bounds of the misfit by which the deviation is judged: below, few rows fit by chance; above, the rows of an
# arm without a learned force miss in elongation, which says nothing of the delay.
_LEAST_MISFIT, _LARGEST_MISFIT = 0.3, 5.0
# Part of the prior deviation below which the rows have said something of the delay: at rest they do not.
_KNOWN_PART = 0.5
# A delay is named after so many rows in sequence that find it.
_LATE_ROWS = 3
# Delay, mass, shift (3), softness.
_SIZE = 6
# Components of a position.
_POSITION = 3
_NO_RESIDUALS = np.zeros(_POSITION + 1)
# Round-off of times [s].
_SAME_S = 1e-9


class Instant(NamedTuple):
    """What a row is made of.

    Attributes
    ----------
    t_s : float
        Time of the row [s].
    belief : Belief
        At this time.
    pressure_pa, mean_pa : ndarray (n_u,)
        Pressures at this time, and their mean since the last row [Pa gauge].
    share : float
        Part of a learned force that the filter uses, 0 to 1.
    s : float
        Place of the sensor [m].
    residuals : ndarray (4,)
        Sum of position less estimate over all samples of the sensor [m], and their number.
    """

    t_s: float
    belief: Belief
    pressure_pa: Array
    mean_pa: Array
    share: float
    s: float
    residuals: Array


class RegressionRow(NamedTuple):
    """One row of the fit, without the acceleration.

    Attributes
    ----------
    rate : ndarray (n_q,)
        Rate of q.
    regressor : ndarray (3, 6)
    value : ndarray (3,)
        Position less that of the model [m].
    pressure_pa : ndarray (n_u,)
        Pressures at its time [Pa gauge].
    """

    rate: Array
    regressor: Array
    value: Array
    pressure_pa: Array


class DelayFit(NamedTuple):
    """Recursive least squares of one sensor.

    Attributes
    ----------
    t_s, start_s : float
        Time of the last row, and of the prior [s].
    information, moment : ndarray (6, 6), (6,)
        A and b of A x = b, x = (delay [s], mass [kg], shift (3) [m], softness).
    solution : ndarray (6,)
        x.
    deviation_s : float
        Deviation of the delay [s].
    residuals : ndarray (4,)
        Those of the last row, see `Instant`.
    misfit, counted : float
        Mean square by which the rows miss the fit, over that of the noise; and how much of its time
        constant this mean has seen, 0 to 1.
    late_rows : int
        Rows in sequence with a delay that is not allowed.
    last : Row or None
        The last row.
    """

    t_s: float
    start_s: float
    information: Array
    moment: Array
    solution: Array
    deviation_s: float
    residuals: Array
    misfit: float = 0.0
    counted: float = 0.0
    late_rows: int = 0
    last: RegressionRow | None = None

    @property
    def delay_s(self) -> float:
        """The delay [s]; positive where the stamps are later than the truth."""
        return float(self.solution[0])

    @property
    def is_late(self) -> bool:
        """Whether the delay has not been allowed for some rows."""
        return self.late_rows >= _LATE_ROWS


class DelayModel:
    """What the model of one arm expects of a position sensor.

    Parameters
    ----------
    arm : SoftArm
        Model of the filter.
    config : EstimatorConfig
        Noise of positions, and the watch's keys.
    """

    def __init__(self, arm: SoftArm, config: EstimatorConfig) -> None:
        self.arm, self.config, pose = arm, config.watch, config.pose
        self._none = np.zeros(arm.n_q)
        stiffness = arm.stiffness_matrix(self._none)
        # Without stiffness a force moves a place by no known way; and what a position does not show of more
        # coordinates looks like a delay (20 to 100 ms on arms of two links). No delay is then estimated.
        try:
            self._compliance = inverse(stiffness)
            self.usable = arm.n_q <= _POSITION
        except np.linalg.LinAlgError:
            self._compliance, self.usable = stiffness, False
        robot = arm.robot
        heaviest = _LOAD * (robot.tip_mass + sum(link.mass for link in robot.links))
        deviations = np.array([_DELAY_S, heaviest, _SHIFT_M, _SHIFT_M, _SHIFT_M, _SOFT])
        self._heaviest_kg = heaviest
        self._prior = np.diag(deviations**-2)
        self._noise = pose.position_std_m**2 + pose.position_model_std_m**2

    def start(self, t_s: float, residuals: Array = _NO_RESIDUALS) -> DelayFit:
        """Return the prior at a time [s], with the sums of the residuals (4,) there."""
        return DelayFit(t_s, t_s, self._prior, np.zeros(_SIZE), np.zeros(_SIZE), _DELAY_S, residuals)

    def step(self, state: DelayFit, at: Instant) -> DelayFit:
        """Return the fit, with the last row `state`, with one more row."""
        belief, t_s = at.belief, at.t_s
        n, rows = belief.n, self.arm.jacobian(belief.q, at.s)[3:]
        place, speed = (rows @ belief.covariance[k : k + n, k : k + n] @ rows.T for k in (0, n))
        if np.trace(place) > 3.0 * self._noise:  # the filter has not found the arm yet, or lost it
            return self.start(t_s, at.residuals)
        load = float(min(max(state.solution[1], -self._heaviest_kg), self._heaviest_kg))
        row = RegressionRow(belief.qd, *self._sides(belief, at.pressure_pa, rows, load), at.pressure_pa)
        last = state.last
        if last is None:
            return self.start(t_s, at.residuals)._replace(last=row)
        # Both at the middle of the interval, as the acceleration is: else the noise of the rates, which is in
        # the regressor too, is a delay. The noise of single readings of the pressures moves the place by as
        # much as that of the sensor: their mean counts.
        regressor = 0.5 * (row.regressor + last.regressor)
        value = 0.5 * (row.value + last.value)
        acceleration = (row.rate - last.rate) / (t_s - state.t_s)
        inertia, none = rows @ self._compliance, self._none
        beside = self.arm.pressure_force(belief.q, at.mean_pa)
        beside -= self.arm.pressure_force(belief.q, 0.5 * (at.pressure_pa + last.pressure_pa))
        value -= inertia @ beside
        heavier = self.arm.tip_mass_force(belief.q, none, acceleration)
        regressor[:, 1] -= inertia @ (heavier - self.arm.tip_mass_force(belief.q, none, none))
        value += inertia @ self.arm.inertia_matrix(belief.q) @ acceleration
        new = at.residuals - state.residuals
        value += new[:3] / max(new[3], 1.0)
        moves = _MOVES_ALONE + at.share * (_MOVES - _MOVES_ALONE)
        if np.sum((rows @ belief.qd) ** 2) < moves**2 * np.trace(speed):
            regressor[:, 0] = 0.0  # an arm at rest shows no delay, and the noise of its rates none either
        fit = self._fitted(state, regressor, value, t_s)
        return fit._replace(residuals=at.residuals, last=row)

    def _sides(self, belief: Belief, pressure_pa: Array, rows: Array, mass_kg: float) -> tuple[Array, Array]:
        """Return regressor (3, 6) and position less that of the model (3,) [m], without the acceleration.

        Parameters
        ----------
        belief : Belief
        pressure_pa : ndarray (n_u,)
            Pressures [Pa gauge].
        rows : ndarray (3, n_q)
            Jacobian of the place.
        mass_kg : float
            Load whose weight is part of the stiffness [kg].
        """
        arm, q, qd, none = self.arm, belief.q, belief.qd, self._none
        ahead = q + _AHEAD_S * qd
        here, weight = self._static(q, pressure_pa), arm.tip_mass_force(q, none, none)
        missing = -here - arm.damping_force(q, qd) - arm.internal_force(q, belief.internal)
        heavier = arm.tip_mass_force(ahead, none, none) - weight
        along = (self._static(ahead, pressure_pa) - here + mass_kg * heavier) / _AHEAD_S
        moved = rows @ self._compliance
        return np.column_stack([moved @ -along, moved @ -weight, np.eye(3), rows @ q]), moved @ -missing

    def _static(self, q: Array, pressure_pa: Array) -> Array:
        """Return the forces of the arm at rest (n_q,), on the left-hand side."""
        arm = self.arm
        return arm.elastic_force(q) + arm.gravity_force(q) - arm.pressure_force(q, pressure_pa)

    def _fitted(self, state: DelayFit, regressor: Array, value: Array, t_s: float) -> DelayFit:
        """Return the fit with one more row.

        Parameters
        ----------
        state : DelayFit
            After the last row.
        regressor : ndarray (3, 6)
        value : ndarray (3,)
            Position less that of the model [m].
        t_s : float
            Time of the row [s].
        """
        config, age_s = self.config, t_s - state.start_s
        time_s = min(config.delay_time_s, max(_SHORTEST_S, _AGE_PART * age_s))
        dt = min(t_s - state.t_s, time_s)
        weight, forgotten = dt / (self._noise * config.delay_correlation_s), dt / time_s
        information = (
            state.information
            + weight * regressor.T @ regressor
            - forgotten * (state.information - self._prior)
        )
        moment = (1.0 - forgotten) * state.moment + weight * regressor.T @ value
        covariance = inverse(information)
        solution = covariance @ moment
        if not np.isfinite(solution).all():
            return self.start(t_s)
        missed = value - regressor @ solution
        counted = (1.0 - forgotten) * state.counted + forgotten
        square = float(missed @ missed) / (_POSITION * self._noise)
        misfit = state.misfit + forgotten / counted * (square - state.misfit)
        deviation = float(np.sqrt(max(covariance[0, 0], 0.0)))
        doubt = config.delay_deviations * min(max(misfit, _LEAST_MISFIT), _LARGEST_MISFIT) * deviation
        # No sensor is earlier than the truth: below 0 it is another error of the model, as after a load step.
        known = age_s >= config.delay_known_after_s - _SAME_S and deviation < _KNOWN_PART * _DELAY_S
        late = known and solution[0] - doubt > config.delay_allowed_s
        late_rows = state.late_rows + 1 if late else 0
        solved = information, moment, solution, deviation, state.residuals
        return DelayFit(t_s, state.start_s, *solved, misfit, counted, late_rows)
