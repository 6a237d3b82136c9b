"""Extended Kalman filter on (q, qd, disturbance, drift): prediction with the model, update with samples.

The disturbance is an acceleration of each coordinate that the model does not explain (a payload, a wrong
stiffness), with its rate: an integrated random walk follows a disturbance that turns with the arm, while a
plain random walk would lag behind. Both decay slowly, so that they stay bounded if no sample observes them.
A learned force is part of the model. All is computed by the kernels of `soro_core.estimation.kernel`.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._box import Box
from soro_core.adaptation.learned import size_of
from soro_core.errors import ModelError
from soro_core.estimation.belief import Belief
from soro_core.estimation.config import EstimatorConfig
from soro_core.estimation.kernel import entries
from soro_core.estimation.kernel.parts import (
    AFTER,
    BEFORE,
    IMU,
    IMU_ORIENTED,
    N_REPORTED,
    POSE,
    Settings,
)
from soro_core.estimation.kernel.update import FUSED, OUTLIER
from soro_core.estimation.known import Known
from soro_core.estimation.samples import PoseSample, Sample
from soro_core.estimation.settings import settings_of
from soro_core.model import SoftArm
from soro_core.model.build import find_site
from soro_core.model.checks import flat_wrench, refuse_underivable
from soro_core.model.dynamics import GOOD
from soro_core.model.tables import Site

Array: TypeAlias = NDArray[np.float64]

_NO_ORIENTATION = np.zeros(4)


class Fused(NamedTuple):
    """Result of one sample.

    Attributes
    ----------
    belief : Belief or None
        Belief with the sample; None where it is an outlier or has no finite result.
    outlier : bool
        Whether the gate has refused it.
    nis : float
        Normalised innovation squared, chi-square distributed for a good sample.
    position_nis : float
        The same of its position; NaN of an IMU.
    before, after : ndarray (3,)
        Predicted position at its place before the sample and with it [m].
    """

    belief: Belief | None
    outlier: bool
    nis: float
    position_nis: float
    before: Array
    after: Array


class Filter:
    """The filter's pure functions for one arm; nothing in it changes after construction but workspace.

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
        self.arm, self.n = arm, arm.n_q
        self.settings = settings_of(arm, config, pieces)
        self.n_d = self.settings.n_d
        self.box = _box_of(arm, self.settings)
        self._nothing = np.zeros(size_of(self.n))
        self.site = lru_cache(maxsize=64)(self._find)

    def _find(self, s: float) -> Site:
        return find_site(self.arm.robot, self.arm.tables, min(max(s, 0.0), self.arm.length))

    def start(self, q: Array | None = None, internal: Array | None = None) -> Belief:
        """Return the initial belief, at `q` (n,) or straight, with internal states or none."""
        mean = np.zeros(2 * self.n + 2 * self.n_d)
        if q is not None:
            mean[: self.n] = q
        internal = np.zeros(self.arm.n_internal) if internal is None else internal
        return Belief(mean, internal, self.settings.initial.copy(), self.n)

    def widen(self, belief: Belief) -> Belief:
        """Return the initial belief at the mean `q` of this one, with its internal states."""
        return self.start(belief.q, belief.internal)

    def predict(
        self,
        belief: Belief,
        pressure_pa: Array,
        dt: float,
        known: Known = Known(),  # noqa: B008 -- frozen
    ) -> tuple[Belief, bool]:
        """Return the belief after `dt` with the pressures held.

        Parameters
        ----------
        belief : Belief
            Belief at the start.
        pressure_pa : ndarray (n_u,)
            Pressures [Pa gauge].
        dt : float
            Time step [s].
        known : Known
            The learned force in force.

        Returns
        -------
        belief : Belief
        ok : bool
            False if the step failed; the mean is then held at rest.
        """
        if dt <= 0.0:
            return belief, True
        theta, share = self._nothing, 0.0
        if known.learned is not None:
            theta, share = known.learned.theta, known.share
        old = belief.mean, belief.internal, belief.covariance
        new = np.empty(old[0].shape), np.empty(old[1].shape), np.empty(old[2].shape)
        code = entries.predict(self.box, theta, share, *old, pressure_pa, dt, *new)
        return Belief(*new, self.n), code == GOOD

    def fuse(self, belief: Belief, sample: Sample, gated: bool = True) -> Fused:
        """Return the belief with one sample: an iterated update in Joseph form.

        Parameters
        ----------
        belief : Belief
            Belief before the sample.
        sample : PoseSample or ImuSample
            Finite.
        gated : bool
            Whether the chi-square gate is applied.
        """
        # Copies: a compiled function is compiled anew for arrays of other types, or that cannot be written.
        if isinstance(sample, PoseSample):
            kind, first, quaternion = POSE, np.array(sample.position, float), sample.quaternion
            second = first
        else:
            first = np.array(sample.angular_velocity, float)
            second = np.array(sample.linear_acceleration, float)
            kind, quaternion = IMU, _NO_ORIENTATION
            if sample.orientation is not None:
                kind, quaternion = IMU_ORIENTED, sample.orientation
        turn = np.array(quaternion, float)
        mean, covariance = np.empty(belief.mean.shape), np.empty(belief.covariance.shape)
        found = np.empty(N_REPORTED)
        code, nis, position_nis = entries.fuse(
            self.box,
            *self.site(sample.s),
            kind,
            first,
            second,
            turn,
            gated,
            belief.mean,
            belief.covariance,
            mean,
            covariance,
            found,
        )
        return Fused(
            Belief(mean, belief.internal, covariance, self.n) if code == FUSED else None,
            code == OUTLIER,
            nis,
            position_nis,
            found[BEFORE : BEFORE + 3],
            found[AFTER : AFTER + 3],
        )

    def tip(self, belief: Belief, pressure_pa: Array) -> tuple[Array, Array, Array]:
        """Return pose of the tip (4, 4), its covariance (6, 6) in the world, and the force H p (n,)."""
        pose, spread, force = np.empty((4, 4)), np.empty((6, 6)), np.empty(self.n)
        entries.tip(self.box, belief.mean, belief.covariance, pressure_pa, pose, spread, force)
        return pose, spread, force


def _box_of(arm: SoftArm, settings: Settings) -> Box:
    """Return arm and filter for the kernels; its mass at the tip is its own."""
    tables = arm.tables._replace(tip_mass=arm.tables.tip_mass.copy())
    n_wrench = len(flat_wrench(arm.robot, None))
    try:
        refuse_underivable(arm.robot, arm.method)
    except ModelError:
        return entries.make_differenced(tables, settings, n_wrench)
    return entries.make_exact(tables, settings, n_wrench)
