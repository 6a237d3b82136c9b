"""Extended Kalman filter on (q, qd, disturbance): prediction with the arm's model, update with a sample.

The disturbance is an acceleration per coordinate that the model does not explain (a payload, a wrong
stiffness), with its rate: an integrated random walk follows a disturbance that turns with the arm without
falling behind, as a plain random walk would. Both are forgotten slowly, so that they stay bounded where
nothing observes them.

Noise is configured for strains that are uniform along a link; what it means for several coefficients does not
depend on the basis (`soro_core.robot.coordinates`). At the start every shape of the arm is as likely as any
other: variance times W^-1. What the model does not explain accelerates the strain uniformly: it then pulls
like the inertia of a bending arm, mostly on its outer part, as a payload does, and the model says what that
does to the higher coefficients. Free disturbances of each coefficient, most of which no sensor at the tip
tells apart, wander off until the prediction fails (docs/adr/0010).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.estimation.config import EstimatorConfig
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
    """Mean and covariance of (q, qd, disturbance, its rate), and the internal states that go with it."""

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
        """Whether every number is one."""
        return bool(np.isfinite(self.mean).all() and np.isfinite(self.covariance).all())


class Filter:
    """The filter's pure functions for one arm; nothing in it changes after construction."""

    def __init__(self, arm: SoftArm, config: EstimatorConfig) -> None:
        self.arm, self.config = arm, config
        self.n = arm.n_q
        self.n_d = arm.n_q if config.disturbance else 0
        # Its linearisation is that of the rule alone, and the same in whatever basis the strain is written.
        self.stepper = make_stepper(config.integrator, arm, guarded=False)
        self.fields = strain_fields(arm.robot)
        stretch, lengths = self.fields.stretch, self.fields.length
        white = self.fields.root.T @ self.fields.root
        same = self.fields.index[:, None] == self.fields.index
        uniform = np.outer(self.fields.uniform, self.fields.uniform) * same
        noise, start = config.process, config.initial
        self.limit = np.where(stretch, config.stretch_limit, config.bend_limit_rad / lengths)
        acceleration = np.where(stretch, noise.stretch_acceleration, noise.curvature_acceleration_per_m)
        drift = np.where(stretch, noise.stretch_disturbance, noise.curvature_disturbance_per_m)
        none = np.zeros((self.n, self.n))
        self.process = self._blocks(
            none, acceleration[:, None] ** 2 * uniform, none, drift[:, None] ** 2 * uniform
        )
        disturbance = np.where(stretch, start.stretch_disturbance_std, start.curvature_disturbance_std_per_m)
        position = np.where(stretch, start.stretch_std, start.curvature_std_per_m)
        rate = np.where(stretch, start.stretch_rate_std_per_s, start.curvature_rate_std_per_m_s)
        # The disturbance is as fast as to change by itself within a second.
        self.initial = self._blocks(
            *(std[:, None] ** 2 * white for std in (position, rate)),
            *(std[:, None] ** 2 * uniform for std in (disturbance, disturbance)),
        )
        stds = [position, rate, disturbance, disturbance] if self.n_d else [position, rate]
        # Variances of what no noise reaches (disturbances of higher coefficients) are round-off.
        self._negligible = np.maximum(1e-12 * np.concatenate(stds) ** 2, 1e-300)
        self._increment = np.where(stretch, 1e-6, 1e-6 / lengths) / np.sqrt(np.diag(self.fields.weight))

    def _blocks(self, *four: Array) -> Array:
        """Covariance of (q, qd, disturbance, drift), without the last two where they are not estimated."""
        count = 4 if self.n_d else 2
        matrix = np.zeros((count, self.n, count, self.n))
        for i in range(count):
            matrix[i, :, i, :] = four[i]
        return matrix.reshape(count * self.n, count * self.n)

    def start(self, q: Array | None = None) -> Belief:
        """Return the belief before anything was measured."""
        return Belief(
            q=np.zeros(self.n) if q is None else np.array(q, dtype=np.float64),
            qd=np.zeros(self.n),
            disturbance=np.zeros(self.n_d),
            drift=np.zeros(self.n_d),
            internal=np.zeros(self.arm.n_internal),
            covariance=self.initial.copy(),
        )

    def widen(self, belief: Belief) -> Belief:
        """Forget what is known, keep the mean: the next sample decides."""
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

    def transition(self, belief: Belief, pressure_pa: Array) -> Transition:
        """Return how errors move from the belief on, as long as the pressures are about these."""
        return Transition(self.linearise(belief, pressure_pa), self.process)

    def predict(
        self, belief: Belief, pressure_pa: Array, transition: Transition, dt: float
    ) -> tuple[Belief, bool]:
        """Advance by `dt` with the pressures held; False where the stepper failed and the mean was held.

        The disturbance acts as half a kick before and half a kick after the step (Strang splitting): second
        order, and the equilibrium under a constant disturbance is exact.
        """
        if dt <= 0.0:
            return belief, True
        n = self.n
        push, disturbance, drift = np.zeros(n), belief.disturbance, belief.drift
        if self.n_d:
            fade = np.exp(-dt / self.config.process.disturbance_time_s)
            push = 0.5 * dt * (disturbance + 0.5 * dt * drift)
            disturbance, drift = fade * (disturbance + dt * drift), fade * drift
        state, status = self.stepper.step(State(belief.q, belief.qd + push, belief.internal), pressure_pa, dt)
        ok = bool(status.ok)
        q, qd, internal = (
            (state.q, state.qd + push, state.internal) if ok else (belief.q, 0.0 * belief.qd, belief.internal)
        )
        whole, noise = transition.over(dt)
        spread = whole @ belief.covariance @ whole.T + noise
        if not ok:
            spread += self.initial * dt
        q = self.fields.within(q, self.limit)
        return Belief(q, qd, disturbance, drift, internal, 0.5 * (spread + spread.T)), ok

    def distance(self, belief: Belief, innovation: Innovation) -> float:
        """Return the normalised innovation squared: chi-square distributed for a good sample."""
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
        """Fuse one sample (iterated update, Joseph form); None where that gives no finite result.

        Parameters
        ----------
        seen : Innovation
            Of the sample at the belief's mean.
        measure : callable
            The same at another (q, qd).
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
