"""Forward dynamics of an arm, of one state or many, and their exact derivatives."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from soro_core._box import Box
from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.model import dynamics, entries
from soro_core.model.arm_base import ArmBase
from soro_core.model.checks import (
    dimensions,
    fault,
    finite,
    flat_wrench,
    refuse_push,
    refuse_underivable,
    shaped,
)


class Derivatives(NamedTuple):
    """Derivatives of the acceleration, docs/model.md (47)."""

    by_q: Array
    """(n_q, n_q)."""
    by_qd: Array
    """(n_q, n_q)."""
    by_p: Array
    """(n_q, n_u), per Pa; of tendons per N."""


class ForwardDynamics(ArmBase):
    """Acceleration of an arm from its state and pressures."""

    method: str
    n_u: int
    n_internal: int
    _no_wrench: Array
    _no_internal: Array

    def acting_pressure(self, p: ArrayLike) -> Array:
        """Effective pressures of gauge pressures p (n_u,) [Pa]: beyond dead bands, on areas that they swell.

        Tensions of tendons, behind the pressures [N], act as they are.

        Raises
        ------
        ModelError
            If a pressure is not below that at which the area of its chamber has no bound, or a tension is
            below 0.
        """
        p, acting = self._vector(p, self.n_u, "p"), np.empty(self.n_u)
        refuse_push(self.robot, p, "p")
        u = entries.acting(self._box, p, acting)
        if u >= 0:
            chamber = self.robot.chamber_names[u]
            raise ModelError(f"p: got {p[u]:g} Pa of {chamber}; allowed: less, by its swell_per_pa", "p")
        return acting

    def forward_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        p: ArrayLike,
        wrench: ArrayLike | None = None,
        internal: ArrayLike | None = None,
    ) -> Array:
        """Acceleration (n_q,), or of m states (m, n_q).

        Parameters
        ----------
        q, qd : (n_q,) or (m, n_q)
        p : (n_u,) or, of m states, (m, n_u) or (n_u,)
            Gauge pressures of the chambers [Pa], then tensions of the tendons [N].
        wrench : (6,) or (n_wrenches, 6), optional
            Torque [N m], force [N] in the body frame: at the tip, or at each of the robot's `wrench_places`.
        internal : (n_internal,) or, of m states, (m, n_internal), optional
            States of creep and hysteresis, default 0.
        """
        # The kernel sees whether all is finite: here only the shapes, and the cause when it is not.
        try:
            q = self._shaped(q, self.n_q, "q")
        except ModelError:
            if dimensions(q) != 2:
                raise
            return self._of_many(q, qd, p, wrench, internal)
        qd = self._shaped(qd, self.n_q, "qd")
        p = self._shaped(p, self.n_u, "p")
        if self.robot.tendons:
            refuse_push(self.robot, p, "p")
        w = self._no_wrench if wrench is None else flat_wrench(self.robot, wrench)
        z = self._no_internal if internal is None else self._shaped(internal, self.n_internal, "internal")
        qdd = np.empty(self.n_q)
        code = entries.accelerations(self._box, (q, qd, z), p, w, qdd)
        if code != dynamics.GOOD:
            for values, name in ((p, "p"), (w, "wrench"), (z, "internal")):
                finite(values, name)
            self.acting_pressure(p)
            raise fault(code, q, qd)
        return qdd

    def _of_many(
        self, q: ArrayLike, qd: ArrayLike, p: ArrayLike, wrench: ArrayLike | None, internal: ArrayLike | None
    ) -> Array:
        name, m = self.robot.name, len(np.asarray(q))
        z = self._no_internal if internal is None else internal
        q, qd = shaped(q, (m, self.n_q), "q", name), shaped(qd, (m, self.n_q), "qd", name)
        p, z = self._for_each(p, m, self.n_u, "p"), self._for_each(z, m, self.n_internal, "internal")
        refuse_push(self.robot, p, "p")
        w = self._no_wrench if wrench is None else flat_wrench(self.robot, wrench)
        qdd = np.empty((m, self.n_q))
        states = q.ravel(), qd.ravel(), z.ravel()
        code = entries.accelerations(self._box, states, p.ravel(), w, qdd.reshape(-1))
        if code != dynamics.GOOD:
            for k in range(m):
                try:
                    self.forward_dynamics(q[k], qd[k], p[k], wrench, z[k])
                except ModelError as error:
                    raise ModelError(f"state {k}: {error}", error.key) from None
        return qdd

    def _for_each(self, values: ArrayLike, m: int, n: int, name: str) -> Array:
        """Rows (m, n), or one row for all of them."""
        if dimensions(values) == 2:
            return shaped(values, (m, n), name, self.robot.name)
        return np.tile(shaped(values, (n,), name, self.robot.name), (m, 1))

    def derivatives(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        p: ArrayLike,
        wrench: ArrayLike | None = None,
        internal: ArrayLike | None = None,
    ) -> Derivatives:
        """Exact derivatives of `forward_dynamics` at one state.

        Internal states and a wrench at the tip are held: they act on the state where it is derived.

        Parameters
        ----------
        q, qd, p, internal : array_like
            As in `forward_dynamics`, of one state.
        wrench : (6,), optional
            Torque [N m], force [N] at the tip, in its body frame.

        Returns
        -------
        Derivatives
            A tuple of (n_q, n_q), (n_q, n_q) and (n_q, n_u).

        Raises
        ------
        ModelError
            As `forward_dynamics`; and with the method "mde", contacts, a held tip or `wrench_places`.
        """
        from soro_core.model.derivative.entries import acceleration_derivatives

        room, n, n_u = self._room, self.n_q, self.n_u
        qdd = self.forward_dynamics(q, qd, p, wrench, internal)
        if qdd.ndim > 1:
            raise ModelError(f"q: derivatives of {len(qdd)} states; allowed is one, ({n},)", "q")
        q, qd, p = self._shaped(q, n, "q"), self._shaped(qd, n, "qd"), self._shaped(p, n_u, "p")
        w = self._no_wrench if wrench is None else flat_wrench(self.robot, wrench)
        by_q, by_qd, by_p = np.empty((n, n)), np.empty((n, n)), np.empty((n, n_u))
        code = acceleration_derivatives(self._box, room, (q, qd, qdd), p, w, (by_q, by_qd, by_p))
        if code != dynamics.GOOD:
            raise fault(code, q, qd)
        return Derivatives(by_q, by_qd, by_p)

    @cached_property
    def _room(self) -> Box:
        """Workspace of the derivatives, made at their first use."""
        from soro_core.model.derivative.entries import make_derivative_box

        refuse_underivable(self.robot, self.method)
        return make_derivative_box(self._box)
