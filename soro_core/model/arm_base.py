"""What the methods of `SoftArm` share: checks of arguments, default sizes, inertial forces."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from soro_core._box import Box
from soro_core.arrays import Array
from soro_core.model import dynamics, entries
from soro_core.model.checks import fault, finite, shaped
from soro_core.model.tables import Tables
from soro_core.robot import Robot

DEFAULT_STEPS = 20


def default_nodes(robot: Robot) -> int:
    """Quadrature nodes a link by default: 7 for constant strain, else more for a higher degree.

    Seven leave an error of 2e-9 in the inertia and Coriolis forces of a link bent to a half circle
    (docs/model.md). Where strain varies, a node is also a Magnus step, of fourth order.
    """
    most = max(field.size for link in robot.links for field in link.strains.values())
    return 8 + 2 * most if any(link.varies or link.varies_at_rest for link in robot.links) else 7


class ArmBase:
    """Tables of one robot, and the checks of the arguments that are computed with them."""

    robot: Robot
    tables: Tables
    n_q: int
    _box: Box
    _no_velocity: Array

    def _inverse(self, q: Array, qd: Array, v: Array, a: Array, gravity: Array) -> Array:
        row: Array = self._inertial(q, qd, v.reshape(1, -1), a.reshape(1, -1), gravity)[0]
        return row

    def _inertial(self, q: Array, qd: Array, v: Array, a: Array, gravity: Array) -> Array:
        t = self.tables
        masses = np.empty((len(v), len(t.mass)))
        masses[:] = t.mass
        forces = np.empty_like(v)
        entries.inertial_forces(
            self._box, (masses, np.full(len(v), t.tip_mass[0]), gravity), (q, qd, v, a), forces
        )
        return forces

    def _assemble(self, blocks: Array) -> Array:
        """Matrix (n_q, n_q) of the links' blocks (n_q, width)."""
        matrix = np.zeros((self.n_q, self.n_q))
        for first, behind in zip(self.tables.offset, self.tables.offset[1:], strict=False):
            matrix[first:behind, first:behind] = blocks[first:behind, : behind - first]
        return matrix

    def _state(self, q: ArrayLike, qd: ArrayLike | None = None) -> tuple[Array, Array]:
        q = self._shaped(q, self.n_q, "q")
        qd = self._no_velocity if qd is None else self._shaped(qd, self.n_q, "qd")
        code = entries.check(self._box, q, qd)
        if code != dynamics.GOOD:
            raise fault(code, q, qd)
        return q, qd

    def _vector(self, values: ArrayLike, n: int, name: str) -> Array:
        return finite(self._shaped(values, n, name), name)

    def _shaped(self, values: ArrayLike, n: int, name: str) -> Array:
        return shaped(values, (n,), name, self.robot.name)
