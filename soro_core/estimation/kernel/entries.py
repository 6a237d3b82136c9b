"""Entry points of the filter from Python: short compiled functions that take an arm with its filter."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from soro_core._box import Box, view
from soro_core._jit import entry, kernel
from soro_core.arrays import Array
from soro_core.estimation.kernel import advance as advancing
from soro_core.estimation.kernel import motion
from soro_core.estimation.kernel import predict as prediction
from soro_core.estimation.kernel.belief import Belief
from soro_core.estimation.kernel.parts import (
    NIS,
    NIS_OF_POSITION,
    FilterArm,
    FilterSettings,
    NoRoom,
    SampleValues,
    make_scratch,
)
from soro_core.model.derivative.work import derivative_workspace
from soro_core.model.forces.chambers import add_pressure_force
from soro_core.model.links.linear import assign, assign_matrix, clear
from soro_core.model.method import kinematics, make_work
from soro_core.model.records import CrossSection
from soro_core.model.tables import Site, Tables


@kernel
def make_exact(t: Tables, s: FilterSettings, n_wrench: int) -> Box:
    """Return an arm that has derivatives, with its filter."""
    return Box(FilterArm(t, make_work(t), derivative_workspace(t), s, make_scratch(t, s, n_wrench)))


@kernel
def make_differenced(t: Tables, s: FilterSettings, n_wrench: int) -> Box:
    """Return an arm without derivatives: differences replace them."""
    return Box(FilterArm(t, make_work(t), NoRoom(np.zeros(1)), s, make_scratch(t, s, n_wrench)))  # type: ignore[arg-type]


# What Python passes are the fields of a record as a plain tuple: numba takes a named one from Python in
# 0.5 us more.
Fields: TypeAlias = tuple[Array, Array, Array, int]
"""Of a `Belief`."""
Known: TypeAlias = tuple[Array, float]
"""The learned model theta, and its share."""


@entry
def predict(box: Box, known: Known, belief: Fields, pressure: Array, dt: float, out: Fields) -> int:
    """`predict.predict` with the learned model."""
    arm = view(box)
    motion.load(arm, *known)
    return prediction.predict(arm, Belief(*belief), pressure, dt, Belief(*out))


@entry
def advance(
    box: Box,
    known: Known,
    belief: Fields,
    held: tuple[Array, float],
    sample: tuple[tuple[int, float, int, float, Array, Array], int, Array, Array, Array, float, bool, Array],
    out: Fields,
) -> tuple[int, int, float, float]:
    """`advance.advance` with the learned model, and `held` the pressures and for how long [s].

    Gives its codes, and both normalised innovations squared.
    """
    arm = view(box)
    motion.load(arm, *known)
    values = SampleValues(Site(*sample[0]), *sample[1:])
    step, outcome = advancing.advance(arm, Belief(*belief), held[0], held[1], values, Belief(*out))
    reported = arm.scratch.reported
    return step, outcome, reported[NIS], reported[NIS_OF_POSITION]


@entry
def expect(box: Box, place: Array, mean: Array, by_q: Array, by_rate: Array) -> None:
    """Set what the next IMU sample is held against: `mean_strain.StrainProfile` about coordinates `place`."""
    w = view(box).scratch
    assign(place, w.place)
    assign(mean, w.mean_strain)
    assign_matrix(by_q, w.mean_strain_by_q)
    assign_matrix(by_rate, w.mean_strain_by_rate)


@entry
def see(box: Box, site: Site, q: Array, variance: float, covariance: Array) -> None:
    """covariance (n_q, n_q) <- the same with the position at a place known too."""
    arm = view(box)
    w = arm.scratch
    J, x, n = w.columns, w.added, q.shape[0]
    kinematics(arm.tables, arm.work, site, q, CrossSection(w.rotation, w.position, J))
    for r in range(3, 6):  # along the axes of the section, one by one: their errors are independent
        s = variance
        for i in range(n):
            x[i] = 0.0
            for j in range(n):
                x[i] += covariance[i, j] * J[j, r]
            s += J[i, r] * x[i]
        for i in range(n):
            for j in range(n):
                covariance[i, j] -= x[i] * x[j] / s


@entry
def tip(box: Box, belief: Fields, pressure: Array, pose: Array, of_tip: Array, force: Array) -> None:
    """pose, of_tip <- pose of the tip (4, 4) and its covariance (6, 6) in the world; force <- H p."""
    arm = view(box)
    t, s, w = arm.tables, arm.settings, arm.scratch
    mean, _, covariance, n = belief
    R = w.rotation
    q = mean[:n]
    kinematics(t, arm.work, s.tip, q, CrossSection(R, w.position, w.columns))
    for r in range(3):
        for c in range(3):
            pose[r, c] = R[r, c]
        pose[r, 3], pose[3, r] = w.position[r], 0.0
        for i in range(n):
            J = w.columns[i]
            w.rows[r, i] = R[r, 0] * J[3] + R[r, 1] * J[4] + R[r, 2] * J[5]
            w.rows[3 + r, i] = R[r, 0] * J[0] + R[r, 1] * J[1] + R[r, 2] * J[2]
    pose[3, 3] = 1.0
    for r in range(6):
        for i in range(n):
            x = 0.0
            for j in range(n):
                x += covariance[i, j] * w.rows[r, j]
            w.added[i] = x
        for e in range(r + 1):
            x = s.kinematic_variance[r] if e == r else 0.0
            for i in range(n):
                x += w.rows[e, i] * w.added[i]
            of_tip[r, e] = of_tip[e, r] = x
    clear(force)
    add_pressure_force(t, q, pressure, force)
