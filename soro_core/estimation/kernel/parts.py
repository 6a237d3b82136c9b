"""What the filter's kernels know and write into: settings, workspace, and the arm that they belong to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core._jit import inner
from soro_core.arrays import Array, Integers
from soro_core.model.derivative.work import DerivativeWork
from soro_core.model.tables import Site, Tables
from soro_core.model.work import Work

# Most components of one sample: angular velocity, orientation and direction of gravity of an IMU.
MOST_ROWS = 9
# Kinds of samples.
POSE, IMU, IMU_ORIENTED = 0, 1, 2
# Rows of `FilterSettings.process` and `FilterSettings.learned_process`.
OF_RATE, OF_DRIFT = 0, 1
# What an update reports: normalised innovation squared of the sample, and of its position; the predicted
# position at its place before and after it; residuals of position or angular velocity and of orientation, and
# their variance by that of the belief alone.
NIS, NIS_OF_POSITION, BEFORE, AFTER, FIRST_RESIDUAL, FIRST_SPREAD = 0, 1, 2, 5, 8, 14
N_REPORTED = 20


class FilterSettings(NamedTuple):
    """Noise, limits and units of one filter; n coordinates, n_d = n or 0 disturbances, m = 2 n + 2 n_d."""

    n_d: int
    time: float
    """Time constant with which a disturbance decays [s], and that with a learned force."""
    learned_time: float
    process: Array
    """Spectral density of the noise of rate and drift, (2, n, n)."""
    learned_process: Array
    """The same with a learned force."""
    pressure_process: float
    """Spectral density of the error of each measured pressure [Pa^2 s]."""
    initial: Array
    """Initial covariance, (m, m)."""
    first: Integers
    """First coordinate of each field of strain, and n behind the last."""
    samples: Array
    """Shape functions at points along the link, (n, n_points)."""
    largest: Array
    """Their largest absolute values, (n,)."""
    limit: Array
    """Largest strain, (n,)."""
    weight: Array
    """q' weight q is the sum over links of the mean squares of their strains, bends as angles, (n, n)."""
    increment: Array
    """Increment of each coordinate where differences replace derivatives, (n,)."""
    q_unit: Array
    """Unit of q in the learned force, (n,)."""
    force_unit: Array
    """Unit of the learned force, (n,)."""
    damping: Array
    """Damping of the robot file, as in `Tables.damping`."""
    damping_number: Integers
    """`DampingModel.number`, and its matrix, (n, n)."""
    damping_matrix: Array
    tip_mass: float
    """Mass at the tip in the robot file [kg]."""
    tip: Site
    """Place of the tip."""
    pose_variance: Array
    """Stated for the sensor's position and rotation, (2,)."""
    kinematic_variance: Array
    """That of the kinematics beside it, (6,)."""
    imu_variance: Array
    """Stated for angular velocity, orientation and specific force, (3,)."""
    imu_kinematic_variance: float
    """That of the kinematics beside the orientation's."""
    noise_time: float
    """Time constant of the noise that innovations show [s]; 0: it is the stated one."""
    gravity_tolerance: float
    """Accelerations whose length is farther from gravity are not used [m/s^2]; negative: none is."""
    gates: Array
    """Largest normalised innovation squared of a good sample by its number of components."""
    outlier_inflation: float
    """Factor on the covariance at an outlier."""
    most_refused: int
    """Outliers in a row after which the belief restarts."""
    frozen_m: float
    """Motion of the prediction beyond which a repeated pose is refused [m]."""


class Scratch(NamedTuple):
    """Workspace of the filter."""

    wrench: Array
    """At the tip, and none at other places."""
    fading: Array
    """Time constant with which a disturbance decays in this step [s], (1,)."""
    share: Array
    """Share of the learned model in this step, (1,)."""
    lost: Array
    """Learned mass that the arm does not have to lose [kg], (1,), 0 or less."""
    constant: Array
    """Learned force at q = 0, (n,), and its slope by q, (n, n)."""
    slope: Array
    acceleration: Array
    moved: Array
    """Coordinates or rates with one moved, (n,), and the acceleration there, (n,)."""
    moved_acceleration: Array
    pressure: Array
    """One of the pressures moved, (n_u,)."""
    internal: Array
    tangent: Array
    by_q: Array
    """Derivatives of the acceleration by q, qd and pressure; the last are what noise of pressures does."""
    by_v: Array
    by_p: Array
    change: Array
    """Change of the rates in a step, (n,)."""
    system: Array
    """(n, n)."""
    pivots: Integers
    response: Array
    """Change of the rates by q, qd and by an impulse, (n, 3 n)."""
    noise: Array
    """Spectral density of the noise of the rates, (n, n)."""
    spread: Array
    """Covariance under way, (m, m), its rows carried, and these transposed."""
    carried: Array
    turned: Array
    added: Array
    """(m,)."""
    rotation: Array
    """Predicted rotation at the place of a sample, and the measured one, (3, 3)."""
    measured: Array
    position: Array
    columns: Array
    """Body Jacobian there, transposed, (n, 6)."""
    residual: Array
    """Of a sample: measured less predicted (MOST_ROWS,), its variance, and the rows by (q, qd)."""
    variance: Array
    rows: Array
    last_residual: Array
    crossed: Array
    """Rows times covariance, (MOST_ROWS, m)."""
    gain: Array
    """Transposed, (MOST_ROWS, m)."""
    innovation: Array
    """(MOST_ROWS, MOST_ROWS), its factors, and its part without the sensor's variance."""
    factors: Array
    shared: Array
    solved: Array
    mean: Array
    """(m,)."""
    start: Array
    """State at the start of a part of a step, (m,) and (n_internal,)."""
    start_internal: Array
    reported: Array
    """See `N_REPORTED`."""
    prior: Array
    """Belief before a sample: (m,), (n_internal,), (m, m)."""
    prior_internal: Array
    prior_covariance: Array
    place: Array
    """Where `mean_strain` is linear, (n,): mean strains up to an IMU, (n,), and by q and rates."""
    mean_strain: Array
    mean_strain_by_q: Array
    mean_strain_by_rate: Array


class SampleValues(NamedTuple):
    """One sample as the kernels read it.

    A pose has its position in `first`; an IMU angular velocity and specific force in `first`, `second`.
    """

    site: Site
    """Place of the sensor."""
    kind: int
    """POSE, IMU or IMU_ORIENTED."""
    first: Array
    second: Array
    quaternion: Array
    """Orientation (x, y, z, w); not read without one."""
    stamp: float
    """Time of the sample [s]."""
    is_new: bool
    """False for a sample that has passed gate and checks before."""
    record: Array
    """Record of its sensor, renewed in place, see `advance`."""


class NoRoom(NamedTuple):
    """In place of the workspace of derivatives for an arm that has none."""

    nothing: Array


class FilterArm(NamedTuple):
    """One arm with its filter."""

    tables: Tables
    work: Work
    room: DerivativeWork
    settings: FilterSettings
    scratch: Scratch


@inner
def make_scratch(t: Tables, s: FilterSettings, n_wrench: int) -> Scratch:
    """Return the workspace for an arm."""
    n, n_z, n_u = t.basis.shape[0], t.internal_kind.shape[0], t.axial_gain.shape[1]
    m = 2 * n + 2 * s.n_d
    return Scratch(
        np.zeros(n_wrench),  # wrench
        np.zeros(1),  # fading
        np.zeros(1),  # share
        np.zeros(1),  # lost
        np.zeros(n),  # constant
        np.zeros((n, n)),  # slope
        np.zeros(n),  # acceleration
        np.zeros(n),  # moved
        np.zeros(n),  # moved_acceleration
        np.zeros(n_u),  # pressure
        np.zeros(n_z),  # internal
        np.zeros(n_z),  # tangent
        np.zeros((n, n)),  # by_q
        np.zeros((n, n)),  # by_v
        np.zeros((n, n_u)),  # by_p
        np.zeros(n),  # change
        np.zeros((n, n)),  # system
        np.zeros(max(n, MOST_ROWS), dtype=np.int64),  # pivots
        np.zeros((n, 3 * n)),  # response
        np.zeros((n, n)),  # noise
        np.zeros((m, m)),  # spread
        np.zeros((m, m)),  # carried
        np.zeros((m, m)),  # turned
        np.zeros(m),  # added
        np.zeros((3, 3)),  # rotation
        np.zeros((3, 3)),  # measured
        np.zeros(3),  # position
        np.zeros((n, 6)),  # columns
        np.zeros(MOST_ROWS),  # residual
        np.zeros(MOST_ROWS),  # variance
        np.zeros((MOST_ROWS, 2 * n)),  # rows
        np.zeros(MOST_ROWS),  # last_residual
        np.zeros((MOST_ROWS, m)),  # crossed
        np.zeros((MOST_ROWS, m)),  # gain
        np.zeros((MOST_ROWS, MOST_ROWS)),  # innovation
        np.zeros((MOST_ROWS, MOST_ROWS)),  # factors
        np.zeros((MOST_ROWS, MOST_ROWS)),  # shared
        np.zeros(MOST_ROWS),  # solved
        np.zeros(m),  # mean
        np.zeros(m),  # start
        np.zeros(n_z),  # start_internal
        np.zeros(N_REPORTED),  # reported
        np.zeros(m),  # prior
        np.zeros(n_z),  # prior_internal
        np.zeros((m, m)),  # prior_covariance
        np.zeros(n),  # place
        np.zeros(n),  # mean_strain
        np.eye(n),  # mean_strain_by_q
        np.eye(n),  # mean_strain_by_rate
    )
