"""Extended Kalman filter on (q, qd, disturbance, drift): prediction with the model, update with samples.

The disturbance is an acceleration of each coordinate that the model does not explain (a payload, a wrong
stiffness), with its rate: an integrated random walk follows a disturbance that turns with the arm, while a
plain random walk would lag behind. Both decay slowly, so that they stay bounded if no sample observes them.
A learned force is part of the model. All is computed by the kernels of `soro_core.estimation.kernel`.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from soro_core._box import Box
from soro_core.adaptation.learned import Learned, first_damping
from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.estimation.config import EstimatorConfig
from soro_core.estimation.kernel import entries
from soro_core.estimation.kernel.advance import N_RECORD, REFUSED
from soro_core.estimation.kernel.belief import Belief
from soro_core.estimation.kernel.noise import N_NOISE, NOISE
from soro_core.estimation.kernel.parts import (
    IMU,
    IMU_ORIENTED,
    POSE,
    FilterSettings,
)
from soro_core.estimation.learned_input import LearnedInput
from soro_core.estimation.mean_strain import mean_strain_of
from soro_core.estimation.sensors.samples import PoseSample, Sample
from soro_core.estimation.settings import settings_of
from soro_core.model import SoftArm
from soro_core.model.build import find_site
from soro_core.model.checks import flat_wrench, refuse_underivable
from soro_core.model.dynamics import GOOD
from soro_core.model.tables import Site

_NO_ORIENTATION = np.zeros(4)


class Advanced(NamedTuple):
    """Result of a step with a sample at its end.

    Attributes
    ----------
    belief : Belief
        Belief with what became of the sample.
    ok : bool
        False if the prediction failed.
    outcome : int
        What became of the sample, a code of `kernel.update` or `kernel.advance`.
    record : ndarray (N_RECORD,)
        Record of its sensor, see `kernel.advance`.
    nis : float
        Normalised innovation squared, chi-square distributed for a good sample.
    position_nis : float
        The same of its position; NaN of an IMU.
    """

    belief: Belief
    ok: bool
    outcome: int
    record: Array
    nis: float
    position_nis: float


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
    dt : float
        Time between two readings of the pressures [s].
    """

    def __init__(self, arm: SoftArm, config: EstimatorConfig, pieces: int = 1, dt: float = 0.005) -> None:
        self.arm, self.n = arm, arm.n_q
        self.settings = settings_of(arm, config, pieces, dt)
        self.n_d = self.settings.n_d
        self.box = _box_of(arm, self.settings)
        self.mean_strain = mean_strain_of(arm, pieces)
        # Nothing learned.
        self.nothing = Learned(np.zeros(first_damping(self.n) + self.settings.damping_number.max() + 1))
        self._same = np.eye(self.n)
        self._unknown = np.full(N_RECORD, np.nan)  # no sample, and so no outliers and the stated noise
        self._unknown[REFUSED] = 0.0
        self._unknown[NOISE : NOISE + N_NOISE] = 1.0
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
        known: LearnedInput = LearnedInput(),  # noqa: B008 -- frozen
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
        known : LearnedInput
            The learned force in force.

        Returns
        -------
        belief : Belief
        ok : bool
            False if the step failed; the mean is then held at rest.
        """
        if dt <= 0.0:
            return belief, True
        mean, internal, covariance, n = belief
        new = np.empty_like(mean), np.empty_like(internal), np.empty_like(covariance), n
        code = entries.predict(self.box, self._load(known), belief[:], pressure_pa, dt, new)
        return Belief(*new), code == GOOD

    def advance(
        self,
        belief: Belief,
        pressure_pa: Array,
        dt: float,
        known: LearnedInput,
        sample: Sample,
        record: Array | None = None,
        is_new: bool = True,
    ) -> Advanced:
        """Return the belief after `dt`, the pressures held, with a sample at the end.

        Parameters
        ----------
        belief : Belief
            Belief at the start.
        pressure_pa : ndarray (n_u,)
            Pressures [Pa gauge].
        dt : float
            Time step [s], may be 0.
        known : LearnedInput
            The learned force in force.
        sample : PoseSample or ImuSample
            Finite.
        record : ndarray (N_RECORD,), optional
            Record of its sensor; none before the first sample.
        is_new : bool
            False for a sample that has passed gate and checks before.
        """
        is_pose = isinstance(sample, PoseSample)
        if not is_pose:
            self._expect(belief, pressure_pa, sample.s, known.share)
        record = (self._unknown if record is None else record).copy()
        values = (self.site(sample.s)[:], *_values(sample), sample.stamp_s, is_new, record)
        mean, internal, covariance, n = belief
        new = np.empty_like(mean), np.empty_like(internal), np.empty_like(covariance), n
        code, outcome, nis, position_nis = entries.advance(
            self.box, self._load(known), belief[:], (pressure_pa, dt), values, new
        )
        if not is_pose and record[NOISE] < 1.0:
            # The stated one allows for what the predicted angular velocity leaves out, too.
            record[NOISE] = 1.0
        return Advanced(Belief(*new), code == GOOD, outcome, record, nis, position_nis)

    def _load(self, known: LearnedInput) -> entries.Known:
        """Return the learned model in force and its share."""
        learned = known.learned if known.held is None else known.held
        return (self.nothing.theta, 0.0) if learned is None else (learned.theta, known.share)

    def _expect(self, belief: Belief, pressure_pa: Array, s: float, share: float) -> None:
        """Set what an IMU sample is compared with; non-uniform strain comes and goes with the learned load.

        Without that load the elongation is wrong, and pressures would say a wrong load.
        """
        q, mean, by_q, by_rate = belief.q, belief.q, self._same, self._same
        shape = None
        if self.mean_strain is not None and share > 0.0:
            shape = self.mean_strain.at(q, pressure_pa, belief.internal, s)
        if shape is not None:
            mean = q + share * (shape.mean - q)
            by_q, by_rate = (
                by + share * (x - by) for by, x in ((by_q, shape.by_q), (by_rate, shape.by_rate))
            )
        entries.expect(self.box, q, mean, by_q, by_rate)

    def tip(self, belief: Belief, pressure_pa: Array) -> tuple[Array, Array, Array]:
        """Return pose of the tip (4, 4), its covariance (6, 6) in the world, and the force H p (n,)."""
        pose, spread, force = np.empty((4, 4)), np.empty((6, 6)), np.empty(self.n)
        entries.tip(self.box, belief[:], pressure_pa, pose, spread, force)
        return pose, spread, force


def _values(sample: Sample) -> tuple[int, Array, Array, Array]:
    """Return kind and arrays of a sample as kernels take it.

    Copies: a compiled function is compiled anew for arrays of other types, or that cannot be written.
    """
    if isinstance(sample, PoseSample):
        position = np.array(sample.position, float)
        return POSE, position, position, np.array(sample.quaternion, float)
    kind, quaternion = IMU, _NO_ORIENTATION
    if sample.orientation is not None:
        kind, quaternion = IMU_ORIENTED, np.array(sample.orientation, float)
    rate, force = np.array(sample.angular_velocity, float), np.array(sample.linear_acceleration, float)
    return kind, rate, force, quaternion


def _box_of(arm: SoftArm, settings: FilterSettings) -> Box:
    """Return arm and filter for the kernels; its mass at the tip and its damping are its own."""
    own = {name: getattr(arm.tables, name).copy() for name in ("tip_mass", "damping")}
    tables = arm.tables._replace(**own)
    n_wrench = len(flat_wrench(arm.robot, None))
    try:
        refuse_underivable(arm.robot, arm.method)
    except ModelError:
        return entries.make_differenced(tables, settings, n_wrench)
    return entries.make_exact(tables, settings, n_wrench)
