"""Extended Kalman filter on (q, qd, disturbance): prediction with the arm's model, update with a sample.

The disturbance is an acceleration of each coordinate that the model does not explain (a payload, a wrong
stiffness), with its rate: an integrated random walk follows a disturbance that turns with the arm, while a
plain random walk would lag behind. Both decay slowly, so that they stay bounded if no sample observes them.

The configured noise is that of strains that are uniform along a link; its meaning for several coefficients
does not depend on the basis (`soro_core.robot.coordinates`). The initial covariance of the coefficients is
the variance times W^-1, W of docs/model.md (4): all shapes of the arm are equally likely. The disturbance
accelerates the strain uniformly. It then acts like the inertia of a bending arm, mostly on the outer part, as
a payload does, and the model gives its effect on the higher coefficients. Independent disturbances of all
coefficients are mostly unobservable from the tip, and drift until the prediction fails (docs/adr/0010).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.adaptation.force import LearnedForce
from soro_core.estimation.config import EstimatorConfig, ProcessNoise
from soro_core.estimation.known import Known
from soro_core.estimation.measurement import Innovation
from soro_core.estimation.transition import Transition
from soro_core.integrate import State, make_stepper
from soro_core.model import SoftArm
from soro_core.robot.coordinates import strain_fields

Array: TypeAlias = NDArray[np.float64]

# Gauss-Newton passes of one update: the measurement is nearly linear over the uncertainty of a running
# filter, and far from it only at the start and after a re-acquisition.
_PASSES = 6
_CONVERGED = 1e-3


@dataclass(frozen=True)
class Belief:
    """Mean and covariance of (q, qd, disturbance, drift), and the internal states at this mean.

    Attributes
    ----------
    q, qd : ndarray (n_q,)
        Coordinates and rates.
    disturbance, drift : ndarray (n_d,)
        Disturbance, an acceleration of the coordinates, and its rate; n_d is n_q, or 0 without disturbance.
    internal : ndarray (n_internal,)
        Creep and hysteresis states.
    covariance : ndarray (m, m)
        Covariance, m = 2 n_q + 2 n_d.
    """

    q: Array
    qd: Array
    disturbance: Array
    drift: Array
    internal: Array
    covariance: Array

    @property
    def mean(self) -> Array:
        """(q, qd, disturbance, drift) in one vector."""
        return np.concatenate([self.q, self.qd, self.disturbance, self.drift])

    def finite(self) -> bool:
        """Whether all numbers are finite."""
        return bool(np.isfinite(self.mean).all() and np.isfinite(self.covariance).all())


class Filter:
    """The filter's pure functions for one arm; nothing in it changes after construction.

    Parameters
    ----------
    arm : SoftArm
        Discretised model.
    config : EstimatorConfig
        Noise and limits.
    pieces : int
        Number of pieces into which each link is discretised.
    """

    def __init__(self, arm: SoftArm, config: EstimatorConfig, pieces: int = 1) -> None:
        self.arm, self.config = arm, config
        self._pieces = pieces
        self.n = arm.n_q
        self.n_d = arm.n_q if config.disturbance else 0
        # Unguarded, the step has the same linearisation in every basis of the strains.
        self.stepper = make_stepper(config.integrator, arm, guarded=False)
        self.fields = strain_fields(arm.robot)
        stretch, lengths = self.fields.stretch, self.fields.length
        white = self.fields.root.T @ self.fields.root
        same = self.fields.index[:, None] == self.fields.index
        uniform = np.outer(self.fields.uniform, self.fields.uniform) * same
        start = config.initial
        self.limit = np.where(stretch, config.stretch_limit, config.bend_limit_rad / lengths)
        self.process = self._process(config.process, stretch, uniform)
        self.learned_process = self._process(config.learned_process, stretch, uniform)
        disturbance = np.where(stretch, start.stretch_disturbance_std, start.curvature_disturbance_std_per_m)
        position = np.where(stretch, start.stretch_std, start.curvature_std_per_m)
        rate = np.where(stretch, start.stretch_rate_std_per_s, start.curvature_rate_std_per_m_s)
        # Standard deviation of the drift: the disturbance can change by its own size within a second.
        self.initial = self._blocks(
            *(std[:, None] ** 2 * white for std in (position, rate)),
            *(std[:, None] ** 2 * uniform for std in (disturbance, disturbance)),
        )
        stds = [position, rate, disturbance, disturbance] if self.n_d else [position, rate]
        # Variances that no noise reaches (disturbances of higher coefficients) are round-off.
        self._negligible = np.maximum(1e-12 * np.concatenate(stds) ** 2, 1e-300)
        self._increment = np.where(stretch, 1e-6, 1e-6 / lengths) / np.sqrt(np.diag(self.fields.weight))

    def _process(self, noise: ProcessNoise, stretch: NDArray[np.bool_], uniform: Array) -> Array:
        """Return the spectral density of the process noise."""
        acceleration = np.where(stretch, noise.stretch_acceleration, noise.curvature_acceleration_per_m)
        drift = np.where(stretch, noise.stretch_disturbance, noise.curvature_disturbance_per_m)
        none = np.zeros((self.n, self.n))
        return self._blocks(none, acceleration[:, None] ** 2 * uniform, none, drift[:, None] ** 2 * uniform)

    def _blocks(self, *four: Array) -> Array:
        """Return the covariance of (q, qd, disturbance, drift) with these diagonal blocks; n_d may be 0."""
        count = 4 if self.n_d else 2
        matrix = np.zeros((count, self.n, count, self.n))
        for i in range(count):
            matrix[i, :, i, :] = four[i]
        return matrix.reshape(count * self.n, count * self.n)

    def start(self, q: Array | None = None) -> Belief:
        """Return the initial belief, at `q` (n_q,) or straight."""
        return Belief(
            q=np.zeros(self.n) if q is None else np.array(q, dtype=np.float64),
            qd=np.zeros(self.n),
            disturbance=np.zeros(self.n_d),
            drift=np.zeros(self.n_d),
            internal=np.zeros(self.arm.n_internal),
            covariance=self.initial.copy(),
        )

    def widen(self, belief: Belief) -> Belief:
        """Return the initial belief at the mean `q` of this one, with its internal states."""
        return replace(self.start(belief.q), internal=belief.internal)

    def linearise(self, belief: Belief, pressure_pa: Array) -> Array:
        """Return the system matrix of the linearised dynamics by forward differences, (m, m)."""
        n, arm = self.n, self.arm
        q, qd, internal = belief.q, belief.qd, belief.internal
        size = 2 * n + 2 * self.n_d
        system = np.zeros((size, size))
        system[:n, n : 2 * n] = np.eye(n)
        here = arm.forward_dynamics(q, qd, pressure_pa, internal=internal)
        for i in range(n):
            h = self._increment[i]
            moved = q.copy()
            moved[i] += h
            system[n : 2 * n, i] = (
                arm.forward_dynamics(moved, qd, pressure_pa, internal=internal) - here
            ) / h
            moved = qd.copy()
            moved[i] += h
            system[n : 2 * n, n + i] = (
                arm.forward_dynamics(q, moved, pressure_pa, internal=internal) - here
            ) / h
        if self.n_d:
            one, fade = np.eye(n), np.eye(n) / self.config.process.disturbance_time_s
            system[n : 2 * n, 2 * n : 3 * n] = one
            system[2 * n : 3 * n, 2 * n : 3 * n] = -fade
            system[2 * n : 3 * n, 3 * n :] = one
            system[3 * n :, 3 * n :] = -fade
        return system

    @cached_property
    def force(self) -> LearnedForce:
        """The learned force, made where one comes first: not every arm has units for it."""
        return LearnedForce(self.arm, self._pieces)

    def transition(self, belief: Belief, pressure_pa: Array, known: Known = Known()) -> Transition:  # noqa: B008 -- frozen
        """Return the linearised dynamics about the belief.

        Parameters
        ----------
        belief : Belief
            Where it is linearised.
        pressure_pa : ndarray (n_u,)
            Pressures [Pa gauge].
        known : Known
            The learned force in force.
        """
        system, process, n = self.linearise(belief, pressure_pa), self.process, self.n
        if known.learned is not None:
            part = known.learned.scaled(known.share)
            factor, slope = self.force.linearise(part, belief.q, belief.qd)
            system[n : 2 * n, : 2 * n] = factor @ system[n : 2 * n, : 2 * n]
            system[n : 2 * n, :n] += slope
            process = process + known.share * (self.learned_process - process)
        return Transition(system, process)

    def predict(
        self,
        belief: Belief,
        pressure_pa: Array,
        transition: Transition,
        dt: float,
        known: Known = Known(),  # noqa: B008 -- frozen
    ) -> tuple[Belief, bool]:
        """Return the belief after `dt` with the pressures held.

        Half of the impulse of disturbance and learned force acts before the step and half after it (Strang
        splitting): second order, and exact for the equilibrium under a constant disturbance. The learned
        force is that of the state before, and of the state after: held from another time it diverges.

        Parameters
        ----------
        belief : Belief
            Belief at the start.
        pressure_pa : ndarray (n_u,)
            Pressures [Pa gauge].
        transition : Transition
            Linearised dynamics.
        dt : float
            Time step [s].
        known : Known
            The learned force in force.

        Returns
        -------
        belief : Belief
        ok : bool
            False if the stepper failed; the mean is then held at rest.
        """
        if dt <= 0.0:
            return belief, True
        n = self.n
        push, disturbance, drift = np.zeros(n), belief.disturbance, belief.drift
        if self.n_d:
            fade = np.exp(-dt / self.config.process.disturbance_time_s)
            push = 0.5 * dt * (disturbance + 0.5 * dt * drift)
            disturbance, drift = fade * (disturbance + dt * drift), fade * drift
        begun = push + 0.5 * dt * self._learned(known, belief.q, belief.qd, belief.internal, pressure_pa)
        state, status = self.stepper.step(
            State(belief.q, belief.qd + begun, belief.internal), pressure_pa, dt
        )
        ok = bool(status.ok)
        q, qd, internal = belief.q, 0.0 * belief.qd, belief.internal
        if ok:
            end = state.qd + push
            # At about the velocity after the second half: before it, damping would see the first half alone.
            qd = state.qd + begun
            kick = 0.5 * dt * self._learned(known, state.q, qd, state.internal, pressure_pa)
            q, qd, internal = state.q, end + kick, state.internal
        whole, noise = transition.over(dt)
        spread = whole @ belief.covariance @ whole.T + noise
        if not ok:
            spread += self.initial * dt
        q = self.fields.within(q, self.limit)
        return Belief(q, qd, disturbance, drift, internal, 0.5 * (spread + spread.T)), ok

    def _learned(
        self, known: Known, q: Array, qd: Array, internal: Array, pressure_pa: Array
    ) -> Array | float:
        """Return the acceleration (n_q,) by the learned force, 0 without one."""
        if known.learned is None:
            return 0.0
        q = self.fields.within(q, self.limit)  # a step may end where the model has no value
        alone = self.arm.forward_dynamics(q, qd, pressure_pa, internal=internal)
        return self.force.acceleration(known.learned.scaled(known.share), q, qd, alone)

    def distance(self, belief: Belief, innovation: Innovation) -> float:
        """Return the normalised innovation squared, chi-square distributed for a good sample."""
        H = innovation.jacobian
        P = belief.covariance[: 2 * self.n, : 2 * self.n]
        try:
            solved = np.linalg.solve(_plus_diagonal(H @ P @ H.T, innovation.variance), innovation.residual)
        except np.linalg.LinAlgError:
            return float("inf")
        return float(innovation.residual @ solved)

    def update(
        self, belief: Belief, seen: Innovation, measure: Callable[[Array, Array], Innovation]
    ) -> Belief | None:
        """Fuse one sample by an iterated update in Joseph form.

        Parameters
        ----------
        belief : Belief
            Belief before the sample.
        seen : Innovation
            Innovation of the sample at the mean of the belief.
        measure : callable
            Function that returns the innovation of the sample at other (q, qd).

        Returns
        -------
        Belief or None
            None if the result is not finite.
        """
        n, size = self.n, belief.covariance.shape[0]
        prior = belief.mean
        mean: Array = np.array(prior)
        scale = np.sqrt(np.maximum(np.diag(belief.covariance), self._negligible))
        for left in reversed(range(_PASSES)):
            jacobian = np.zeros((seen.residual.shape[0], size))
            jacobian[:, : 2 * n] = seen.jacobian
            crossed = belief.covariance @ jacobian.T
            try:
                solved = np.linalg.solve(_plus_diagonal(jacobian @ crossed, seen.variance), crossed.T)
            except np.linalg.LinAlgError:
                return None
            gain = solved.T
            step = prior + gain @ (seen.residual + jacobian @ (mean - prior)) - mean
            if not np.isfinite(step).all():
                return None
            mean += step
            mean[:n] = self.fields.within(mean[:n], self.limit)
            if left == 0 or float((np.abs(step) / scale).max()) < _CONVERGED:
                break
            seen = measure(mean[:n], mean[n : 2 * n])
        rest = np.eye(size) - gain @ jacobian
        covariance = rest @ belief.covariance @ rest.T + (gain * seen.variance) @ gain.T
        updated = Belief(
            q=mean[:n],
            qd=mean[n : 2 * n],
            disturbance=mean[2 * n : 2 * n + self.n_d],
            drift=mean[2 * n + self.n_d :],
            internal=belief.internal,
            covariance=0.5 * (covariance + covariance.T),
        )
        return updated if updated.finite() else None


def _plus_diagonal(matrix: Array, diagonal: Array) -> Array:
    """Add to the diagonal of a matrix, in place."""
    matrix.flat[:: len(diagonal) + 1] += diagonal
    return matrix
