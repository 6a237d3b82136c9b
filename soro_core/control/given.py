"""References that others give: trajectories and poses of the tip, checked against one arm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.control.command import ControllerState
from soro_core.control.config import ControllerConfig
from soro_core.control.passage import Bounds
from soro_core.control.references import tip_reference, trajectory_reference
from soro_core.control.trajectory import Reference
from soro_core.model import SoftArm
from soro_core.robot import Robot
from soro_core.robot.coordinates import StrainFields

Array: TypeAlias = NDArray[np.float64]


class GivenReferences:
    """Makes references of one arm.

    Attributes
    ----------
    arm, robot : SoftArm, Robot
        Discretised model and its robot.
    fields : StrainFields
        Its strains.
    config : ControllerConfig
    bounds : Bounds
        Limits of references.
    limit : ndarray (n_q,)
        Largest absolute strain.
    """

    arm: SoftArm
    robot: Robot
    fields: StrainFields
    config: ControllerConfig
    bounds: Bounds
    limit: Array

    def trajectory(
        self,
        t: float,
        names: Sequence[str],
        times_s: Sequence[float],
        positions: Array | Sequence[Sequence[float]],
        velocities: Array | Sequence[Sequence[float]] | None = None,
        accelerations: Array | Sequence[Sequence[float]] | None = None,
        stamp_ns: int = 0,
    ) -> Reference:
        """Return a reference from a JointTrajectory that starts at `t` [s].

        Other parameters as in `trajectory_reference`.

        Returns
        -------
        Reference

        Raises
        ------
        ConfigError
            If names, times or numbers are wrong, or a strain or a rate is beyond `bounds`.
        """
        return trajectory_reference(
            self.bounds,
            self.robot.coordinate_names,
            names,
            times_s,
            positions,
            velocities,
            accelerations,
            start_s=t,
            stamp_ns=stamp_ns,
        )

    def tip(self, state: ControllerState, position: Array, quaternion: Array | None = None) -> Reference:
        """Return a set point that brings the tip to a pose.

        Parameters
        ----------
        state : ControllerState
            The search starts at its reference.
        position : ndarray (3,)
            Position of the tip in the world frame [m].
        quaternion : ndarray (4,), optional
            Orientation (x, y, z, w), weighted with `reference.rotation_weight_m`.

        Returns
        -------
        Reference

        Raises
        ------
        ConfigError
            If a number is not finite, or the arm misses the position by more than the configured tolerance.
        """
        # From the reference in force, so that neighbouring poses get neighbouring coordinates.
        start = np.zeros(self.arm.n_q) if state.following is None else state.following.passage.at.q
        return tip_reference(
            self.arm, self.fields, self.config.reference, self.limit, start, position, quaternion
        )
