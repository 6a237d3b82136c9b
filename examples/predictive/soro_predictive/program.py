"""The quadratic program of one tick: pressures with the least tip error within range and rates."""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np

from soro_core.arrays import Array
from soro_predictive.horizon import Course

# Unit of the pressures in the program [Pa].
UNIT_PA = 1e4


class Supply(NamedTuple):
    """What set points may be: range [Pa gauge], rates [Pa/s]; one is pressure + lead (wish - pressure)."""

    low_pa: float
    high_pa: float
    rise_pa_s: float
    fall_pa_s: float
    lead: float


def best_wish(
    course: Course,
    missed: Array,
    weight: Array,
    change: float,
    wish_pa: Array,
    steps_s: Array,
    supply: Supply,
) -> tuple[Array, int]:
    """Return the wished pressures (N - 1, n_u) [Pa gauge], and the flag of daqp, below 1 without a solution.

    The course is linearised about the wishes (N, n_u), of which the first one stays. `missed` (N, 3 + n_q)
    are its places less those of the reference, `weight` are their weights, `change` is the weight of a
    difference of `UNIT_PA` from step to step, `steps_s` (N,) are the lengths of the steps [s].
    """
    (N, n_u), lead, each = wish_pa.shape, supply.lead, np.eye(wish_pa.shape[1])
    jump = np.diff(wish_pa, axis=0).ravel()
    back = np.kron(np.eye(N) - np.eye(N, k=-1), each)[n_u:, n_u:]
    by_place = (weight[..., None] * course.place_by_wish).reshape(-1, N * n_u)[:, n_u:]
    rows = np.vstack([UNIT_PA * by_place, change * back])
    errors = np.concatenate([(weight * missed).ravel(), change * jump / UNIT_PA])
    # Set points follow from wishes and pressures: their range, and their change from step to step.
    by_wish = np.kron(lead * np.eye(N) + (1.0 - lead) * course.pressure_by_wish, each)[n_u:, n_u:]
    command = lead * wish_pa + (1.0 - lead) * course.pressure_pa
    rise, fall = (rate * np.repeat(steps_s[1:], n_u) for rate in (supply.rise_pa_s, supply.fall_pa_s))
    both = np.concatenate([wish_pa[1:].ravel(), command[1:].ravel()])
    most = np.concatenate([supply.high_pa - both, rise - lead * jump]) / UNIT_PA
    least = np.concatenate([supply.low_pa - both, -fall - lead * jump]) / UNIT_PA
    # The range of set points is soft, so that a noisy reading leaves a solution; the controller bounds them.
    sense = np.repeat(np.array([0, 8, 0], dtype=np.int32), (N - 1) * n_u)
    limited = np.vstack([by_wish, lead * back])
    x, _, flag, _ = daqp.solve(rows.T @ rows, rows.T @ errors, limited, most, least, sense)
    return wish_pa[1:] + UNIT_PA * x.reshape(-1, n_u), flag if np.isfinite(x).all() else 0
