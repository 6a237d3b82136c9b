"""Force at the tip that brings the rest of a finer arm to where the tip is measured; docs/force.md.

A force at the tip bends a link non-uniformly, and one constant strain takes that for a force along the arm.
The finer arm has several pieces for each link of the model; inertia and damping of the motion, creep and what
is learned act on it as on the model, evenly along each link.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from soro_core.adaptation.scales import scales_of
from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_core.estimation.kernel import tip_force as kernel
from soro_core.model import SoftArm
from soro_core.model.build import find_site
from soro_core.model.checks import refuse_underivable
from soro_core.model.dynamics import GOOD
from soro_core.model.equilibrium.finer_arm import finer_arm

# Newton steps of a first balance, and of one that follows another.
_FIRST, _NEXT = 8, 1
# Largest change of a strain, in units of q, by one step of Newton, at which this is near to the balance.
_FAR = 0.4
# Tables to which the elastic force is proportional.
_OF_MODULUS = ("stiffness", "law_share")


class Measured(NamedTuple):
    """What the arm does, all behind one low-pass.

    Attributes
    ----------
    position : ndarray (3,)
        Position of the measured place [m].
    pressure_pa : ndarray (n_u,)
        Pressures [Pa gauge].
    qd, qdd : ndarray (n_q,)
        Rates and accelerations.
    force : ndarray (n_q,)
        Other generalised force on the left-hand side: damping, creep and hysteresis.
    """

    position: Array
    pressure_pa: Array
    qd: Array
    qdd: Array
    force: Array


@dataclass(frozen=True)
class TipBalance:
    """A balance and its derivatives.

    Attributes
    ----------
    x : ndarray (n_fine,)
        Coordinates of the finer arm.
    force_n : ndarray (3,)
        Force at the tip, in the world [N].
    by_position : ndarray (3, 3)
        Its derivatives by the measured position [N/m],
    by_force : ndarray (3, n_q)
        by a generalised force on the left-hand side, and
    by_pressure : ndarray (3, n_u)
        by the pressures [N/Pa].
    """

    x: Array
    force_n: Array
    by_position: Array
    by_force: Array
    by_pressure: Array


class TipBalancer:
    """Finds the balances of one arm.

    Parameters
    ----------
    arm : SoftArm
        Discretised model.
    links : int
        Number of pieces into which the model divides each link.
    pieces : int
        Number of pieces into which each of those is divided here.

    Raises
    ------
    ConfigError, ModelError
        If the arm has varying strain, no stiffness in one, or no derivatives.
    """

    def __init__(self, arm: SoftArm, links: int = 1, pieces: int = 4) -> None:
        robot = arm.robot
        if robot.varies:
            raise ConfigError(robot.name, "basis", "strain that varies", "uniform strain of each link")
        self.arm, self.scales = arm, scales_of(arm, links)
        self.fine, self.spread = finer_arm(arm, pieces)
        refuse_underivable(self.fine.robot, self.fine.method)
        file = self.fine.tables
        tables = file._replace(**{name: getattr(file, name).copy() for name in ("tip_mass", *_OF_MODULUS)})
        self._of_modulus = [(getattr(tables, name), getattr(file, name)) for name in _OF_MODULUS]
        self._box = kernel.make_fine_arm(
            tables,
            np.ascontiguousarray(self.spread.T / pieces),
            self.spread,
            self.scales.force,
            self.scales.q,
            float(tables.tip_mass[0]),
        )
        self._site = lru_cache(maxsize=16)(lambda s: find_site(self.fine.robot, self.fine.tables, s)[:])

    def step(
        self,
        before: TipBalance | None,
        measured: Measured,
        theta: Array,
        s: float,
        q: Array,
        modulus: float = 1.0,
    ) -> TipBalance | None:
        """Return the balance, None where Newton's method finds none.

        Parameters
        ----------
        before : TipBalance or None
            The last one; None for a first one.
        measured : Measured
        theta : ndarray
            Learned mass at the tip [kg] and W, as in `Learned.theta`.
        s : float
            The measured place, along the whole arm [m].
        q : ndarray (n_q,)
            Estimated coordinates, where a first one begins.
        modulus : float
            Elastic force of the arm as a part of that of its file.
        """
        for used, of_file in self._of_modulus:
            np.multiply(modulus, of_file, out=used)
        n, n_u = self.arm.n_q, self.arm.n_u
        x = self.spread @ q if before is None else before.x.copy()
        force = np.zeros(3) if before is None else before.force_n.copy()
        out = np.empty((3, 3)), np.empty((3, n)), np.empty((3, n_u))
        sites = self._site(self.fine.length), self._site(min(max(s, 0.0), self.fine.length))
        steps = _FIRST if before is None else _NEXT
        known = (*measured, theta)
        code = kernel.step(self._box, sites, known, steps, (x, force), out)
        if code == GOOD and before is not None and self._change(before.x, x) > _FAR:
            code = kernel.step(self._box, sites, known, _FIRST, (x, force), out)
            last = x.copy()
            if code == GOOD:
                code = kernel.step(self._box, sites, known, _NEXT, (x, force), out)
            if self._change(last, x) > _FAR:
                return None
        return TipBalance(x, force, *out) if code == GOOD else None

    def _change(self, before: Array, after: Array) -> float:
        """Return the largest change of a strain, in units of q."""
        return float(np.abs((after - before) / (self.spread @ self.scales.q)).max())
