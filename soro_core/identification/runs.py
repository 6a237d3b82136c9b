"""The recorded runs again, with a robot model in place of the robot.

A measured curvature is the bending angle over the length. Of a strain that varies along the link that is its
mean; of a release, the start is a curvature that is uniform along the link.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.errors import ModelError
from soro_core.identification.records import ForcedRun
from soro_core.integrate import simulate
from soro_core.model import SoftArm
from soro_core.model.statics import equilibrium
from soro_core.robot.coordinates import StrainFields, strain_fields

Array: TypeAlias = NDArray[np.float64]


def forced_curvature(arm: SoftArm, run: ForcedRun, dt: float = 0.02, link: int = 0) -> tuple[Array, Array]:
    """Let the measured pressures act on the chambers directly, from rest at the first of them.

    Parameters
    ----------
    arm : SoftArm
        With bending_x and bending_y on `link`.
    run : ForcedRun
        Its first sample is the time at which the arm is at rest.
    dt : float
        Time step [s]; the recorded runs are slow against the arm, so 20 ms serve for fitting.
    link : int
        The link whose curvature is returned.

    Returns
    -------
    t : array of shape (n,)
        In the time of the run [s].
    curvature : array of shape (n, 2)
        kx, ky [1/m] of the model, in its own frame: means over the link.

    Raises
    ------
    ModelError
        If the link lacks one of the two bendings, or the simulation fails.
    """
    fields = strain_fields(arm.robot)
    means = np.stack([_mean(fields, strain, link) for strain in ("bending_x", "bending_y")])
    begin = float(run.t[0])
    q0 = equilibrium(arm, run.pressure[0])
    steps = int((float(run.t[-1]) - begin) / dt + 1e-9)
    result = simulate(
        arm, q0, np.zeros(arm.n_q), t_end=steps * dt, dt=dt, pressure=lambda t: run.pressure_at(begin + t)
    )
    q = np.asarray(result.q, float)
    if len(q) != steps + 1 or not np.isfinite(q).all():
        raise ModelError(
            f"the forced run failed after {len(q)} of {steps + 1} samples: {result.status.message}"
        )
    return begin + np.asarray(result.t, float), q @ means.T


def release_bend(arm: SoftArm, bend: float, t_end: float, dt: float = 1e-3) -> tuple[Array, Array]:
    """Let the arm go from a bending angle, at rest, relaxed and without pressure.

    Parameters
    ----------
    arm : SoftArm
        One link with bending_y, along which it is bent.
    bend : float
        Bending angle at the start [rad].
    t_end, dt : float
        [s].

    Returns
    -------
    t, bend : arrays of shape (n,)
        Time [s] and bending angle kappa L (1 + eps) [rad], both strains as means over the link.

    Raises
    ------
    ModelError
        If the arm has more than one link or no bending_y, or the simulation fails.
    """
    if len(arm.robot.links) != 1:
        raise ModelError(f"release of {arm.robot.name}: got {len(arm.robot.links)} links; allowed is one")
    fields = strain_fields(arm.robot)
    curvature, stretch = _mean(fields, "bending_y", 0), fields.of("elongation") * fields.mean
    length = arm.robot.links[0].length
    q0 = equilibrium(arm, np.zeros(arm.n_u))
    shape = fields.of("bending_y") * fields.uniform
    q0 += shape * bend / (length * (1 + stretch @ q0) * (curvature @ shape))
    result = simulate(arm, q0, np.zeros(arm.n_q), t_end=t_end, dt=dt, pressure=None)
    q = np.asarray(result.q, float)
    if not np.isfinite(q).all() or result.t[-1] < t_end - 1.5 * dt:
        raise ModelError(f"the release failed at {result.t[-1]} s: {result.status.message}")
    return np.asarray(result.t, float), (q @ curvature) * length * (1 + q @ stretch)


def _mean(fields: StrainFields, strain: str, link: int) -> Array:
    """Row (n_q,) that gives the mean of a strain over a link."""
    row = fields.of(strain, link)
    if not row.any():
        found = ", ".join(f"link{i}/{name}" for i, name in zip(fields.links, fields.strains, strict=True))
        raise ModelError(f"recorded run: got an arm with {found}; required is link{link}/{strain}")
    return row * fields.mean
