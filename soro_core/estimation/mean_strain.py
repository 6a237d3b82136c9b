"""Mean strain of a link that a load bends non-uniformly: what an IMU sees there.

q is what has the tip where it is; the strain of a link that carries a load at its end is not uniform, and its
mean is less. With a first polynomial z beside each uniform strain, and each link's end held where q has it,
the arm rests at the z that pressures and weight ask for; the load need not be known. docs/estimation.md.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core.adaptation.scales import q_scale_of
from soro_core.arrays import Array
from soro_core.errors import ConfigError, ModelError
from soro_core.linear import solve
from soro_core.model import SoftArm
from soro_core.robot.basis import shape_values
from soro_core.robot.coordinates import strain_fields
from soro_core.robot.discretisation import with_basis

# Part of a unit of a coordinate for difference quotients of the static force.
_STEP = 1e-5
# Part of a unit of bend below which the direction of the bend does not count.
_STRAIGHT = 0.1
# Two Gauss points integrate the two shape functions exactly.
_GAUSS = (np.array([0.5 - np.sqrt(1.0 / 12.0), 0.5 + np.sqrt(1.0 / 12.0)]), np.array([0.5, 0.5]))


class StrainProfile(NamedTuple):
    """The strain up to a place, about one q.

    Attributes
    ----------
    mean : ndarray (n_q,)
        Mean strains between the base of each link and the place: an arm of these uniform strains has the
        orientation of the place.
    by_q, by_rate : ndarray (n_q, n_q)
        Their derivatives by q, the pressures held; their rates by those of q, the load held.
    """

    mean: Array
    by_q: Array
    by_rate: Array


class MeanStrain:
    """The non-uniform strain of one arm of uniform strains.

    Parameters
    ----------
    arm : SoftArm
        Discretised model.
    pieces : int
        Number of pieces into which each link is discretised.

    Raises
    ------
    ConfigError
        If its strains cannot be expanded, or vary already.
    """

    def __init__(self, arm: SoftArm, pieces: int = 1) -> None:
        robot = arm.robot
        if robot.varies:
            raise ConfigError(robot.name, "basis", "strain that varies", "uniform strain of each link")
        self.arm, self.fine = arm, SoftArm(with_basis(robot, "legendre", 1))
        self.fields = strain_fields(robot)
        self.ends = np.cumsum([link.length for link in robot.links])
        self.base, self.rest = np.arange(0, 2 * arm.n_q, 2), np.arange(1, 2 * arm.n_q, 2)
        unit = q_scale_of(arm, pieces)
        self.unit, self.step = unit, _STEP * np.repeat(unit, 2)

    def at(self, q: Array, pressure_pa: Array, internal: Array, s: float) -> StrainProfile | None:
        """Return the strain up to a place, or None where the arm has no such shape.

        Parameters
        ----------
        q : ndarray (n_q,)
            Coordinates.
        pressure_pa : ndarray (n_u,)
            Pressures [Pa gauge].
        internal : ndarray (n_internal,)
            Creep and hysteresis states.
        s : float
            The place, along the whole arm [m].
        """
        base, rest, n = self.base, self.rest, self.arm.n_q
        try:
            x = np.zeros(2 * n)
            x[base] = q
            force = self._static(x, pressure_pa)
            steps = np.diag(self.step)
            slope = (
                np.stack([self._static(x + e, pressure_pa) for e in steps], axis=1) - force[:, None]
            ) / self.step
            force[base] += self.arm.internal_force(q, internal)
            jacobian = self._positions(x)
            held = np.zeros((2 * n, n))  # what z changes while the ends stay
            held[base] = -np.linalg.lstsq(jacobian[:, base], jacobian[:, rest], rcond=None)[0]
            held[rest] = np.eye(n)
            solved = solve(held.T @ slope @ held, held.T @ np.column_stack([force, slope[:, base]]))
        except (ModelError, np.linalg.LinAlgError):  # far from any rest of an arm
            return None
        z, z_by_q = -solved[:, 0], -solved[:, 1:]
        mean = self._means(min(max(s, 0.0), self.arm.length))
        until = mean @ (x + held @ z)
        by_q = np.eye(n) + mean @ held @ z_by_q
        return StrainProfile(until, by_q, self._turned(q, until))

    def _static(self, x: Array, pressure_pa: Array) -> Array:
        """Return weight, elastic force and pressures (2 n_q,) on the left-hand side."""
        fine = self.fine
        return fine.gravity_force(x) + fine.elastic_force(x) - fine.pressure_force(x, pressure_pa)

    def _positions(self, x: Array) -> Array:
        """Return the Jacobian (3 n_links, 2 n_q) of the positions of the links' ends."""
        places = [self.fine.pose_and_jacobian(x, float(end)) for end in self.ends]
        return np.concatenate([pose[:3, :3] @ jacobian[3:] for pose, jacobian in places])

    def _means(self, s: float) -> Array:
        """Return the matrix (n_q, 2 n_q) of mean strains up to a place; of later links, of the whole link."""
        rows, first, base = np.zeros((self.arm.n_q, 2 * self.arm.n_q)), 0, 0.0
        for link in self.fine.robot.links:
            part = s - base if base < s < base + link.length else link.length
            means = shape_values(link, _GAUSS[0] * part) @ _GAUSS[1]
            for i in range(link.n_q // 2):
                rows[first + i, 2 * (first + i) : 2 * (first + i) + 2] = means[2 * i : 2 * i + 2]
            first, base = first + link.n_q // 2, base + link.length
        return rows

    def _turned(self, q: Array, until: Array) -> Array:
        """Return the derivative of the mean by q where it turns with the bend of its link."""
        ratio = np.ones(len(q))
        links = np.array(self.fields.links)[self.fields.index]
        for link in set(self.fields.links):
            bends = (links == link) & ~self.fields.stretch
            unit = self.unit[bends]
            bent, least = q[bends] / unit, _STRAIGHT**2
            ratio[bends] = (bent @ (until[bends] / unit) + least) / (bent @ bent + least)
        return np.diag(ratio)


def mean_strain_of(arm: SoftArm, pieces: int = 1) -> MeanStrain | None:
    """Return the non-uniform strain of an arm in pieces of each link, None where there is none to compute."""
    try:
        return MeanStrain(arm, pieces)
    except (ConfigError, ModelError):
        return None
