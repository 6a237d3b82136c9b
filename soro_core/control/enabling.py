"""Checks before a controller is enabled: pressures near zero, and sensors that agree with the model at rest.

The load is not known, so the arm may rest under any load from none to the largest that the law learns. A
standing arm may lean in any direction then: the search for its rest starts where the sensors see it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.control.config import EnableBounds
from soro_core.control.kinematics import inverse_kinematics
from soro_core.errors import ModelError
from soro_core.model import SoftArm
from soro_core.model.statics import equilibrium
from soro_core.robot.coordinates import StrainFields
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix, rotation_log

if TYPE_CHECKING:
    from soro_core.control.controller import Controller

Array: TypeAlias = NDArray[np.float64]

# Loads between none and the largest that are tried, and halvings of the distance to the best one.
_LOADS, _HALVINGS = 6, 4


@dataclass(frozen=True)
class Seen:
    """A sample of a sensor on the arm.

    Attributes
    ----------
    name : str
        Topic of the sensor.
    s : float
        Its place along the arm [m].
    position : ndarray (3,) or None
        Position in the world [m].
    quaternion : ndarray (4,) or None
        Orientation in the world (x, y, z, w).
    up : ndarray (3,) or None
        Specific force in its own frame [m/s^2], which points up at rest.
    """

    name: str
    s: float
    position: Array | None = None
    quaternion: Array | None = None
    up: Array | None = None


@dataclass(frozen=True)
class RestingArm:
    """The model at rest without pressure, under loads from none to the largest.

    Attributes
    ----------
    arm : SoftArm
    fields : StrainFields
        Strains of its robot.
    limit : ndarray (n_q,)
        Largest absolute strains.
    heaviest_kg : float
        Largest load at the tip, beside the tip mass of the robot [kg].
    """

    arm: SoftArm
    fields: StrainFields
    limit: Array
    heaviest_kg: float

    def findings(self, seen: Sequence[Seen], bounds: EnableBounds) -> list[str]:
        """Return a line for each sensor that fits the model under no load."""
        best, fitting = math.inf, np.zeros(self.arm.n_q)
        for q in self._rests(seen, bounds):
            misfit = max((self._misfit(one, q, bounds) for one in seen), default=0.0)
            if misfit <= 1.0:
                return []
            if misfit < best:
                best, fitting = misfit, q
        return [self._text(one, fitting, bounds) for one in seen if self._misfit(one, fitting, bounds) > 1.0]

    def _rests(self, seen: Sequence[Seen], bounds: EnableBounds) -> Iterator[Array]:
        """Yield coordinates at rest, under the loads that fit best towards the end."""
        start = np.zeros(self.arm.n_q)
        tip = next((one for one in seen if one.position is not None and one.s >= self.arm.length), None)
        if tip is not None and tip.position is not None:
            start = inverse_kinematics(self.arm, self.fields, tip.position, None, start, self.limit).q
        found: list[tuple[float, float]] = []

        def rest(load: float) -> Iterator[Array]:
            try:
                q = equilibrium(self.arm, np.zeros(self.arm.n_u), start, load)
            except ModelError:  # near buckling the search may fail; a load beside it is found
                return
            found.append((max((self._misfit(one, q, bounds) for one in seen), default=0.0), load))
            yield q

        step = self.heaviest_kg / _LOADS
        for k in range(_LOADS + 1):
            yield from rest(k * step)
        for _ in range(_HALVINGS if found and step > 0.0 else 0):
            step *= 0.5
            _, load = min(found)
            for near in (load - step, load + step):
                if 0.0 <= near <= self.heaviest_kg:
                    yield from rest(near)

    def _misfit(self, one: Seen, q: Array, bounds: EnableBounds) -> float:
        """Return distance and angle of a sample from the model, the larger one, in bounds."""
        distance, angle = self._apart(one, q)
        return max(distance / bounds.distance_m, math.degrees(angle) / bounds.angle_deg)

    def _apart(self, one: Seen, q: Array) -> tuple[float, float]:
        """Return distance [m] and angle [rad] of a sample from the model."""
        pose = self.arm.pose(q, one.s)
        distance = 0.0 if one.position is None else float(np.linalg.norm(one.position - pose[:3, 3]))
        angle = 0.0
        if one.quaternion is not None:
            turn = rotation_log(pose[:3, :3].T @ matrix_from_quaternion(one.quaternion))
            angle = float(np.linalg.norm(turn))
        if one.up is not None:
            up = pose[:3, :3].T @ -np.asarray(self.arm.robot.gravity, dtype=np.float64)
            size = float(np.linalg.norm(up) * np.linalg.norm(one.up))
            if size > 0.0:
                angle = max(angle, math.acos(min(max(float(up @ one.up) / size, -1.0), 1.0)))
        return distance, angle

    def _text(self, one: Seen, q: Array, bounds: EnableBounds) -> str:
        distance, angle = self._apart(one, q)
        apart = [] if one.position is None else [f"{1e3 * distance:.0f} mm"]
        apart += [f"{math.degrees(angle):.0f} degrees"]
        text = (
            f"{one.name} is {' and '.join(apart)} from the model at rest under any load from 0 to "
            f"{1e3 * self.heaviest_kg:.0f} g, allowed: {1e3 * bounds.distance_m:g} mm and "
            f"{bounds.angle_deg:g} degrees (enable)"
        )
        if one.quaternion is None:
            return text
        pose, base = self.arm.pose(q, one.s), np.asarray(self.arm.robot.base_position, dtype=np.float64)
        turn = pose[:3, :3] @ matrix_from_quaternion(one.quaternion).T
        if one.position is not None:
            turned = base + turn @ (one.position - base)
            if float(np.linalg.norm(turned - pose[:3, 3])) > bounds.distance_m:
                return f"{text}; no rotation about the base makes it fit"
        rotation = ", ".join(f"{x:.3f}" for x in quaternion_from_matrix(turn))
        cure = "see base_quaternion, or the sensor's frame"
        return f"{text}; turned by the quaternion [{rotation}] it fits: {cure}"


def resting_arm(controller: Controller) -> RestingArm:
    """Return the model at rest, with loads up to the bound of the mass that the law learns."""
    parameters, tip = controller.parameters, controller.robot.tip_mass
    upper = dict(zip(parameters.names, parameters.polytope.upper, strict=True)).get("tip_mass", tip)
    return RestingArm(controller.arm, controller.fields, controller.limit, max(float(upper) - tip, 0.0))


def pressure_findings(names: Sequence[str], pressure_pa: Array, bounds: EnableBounds) -> list[str]:
    """Return a line if a chamber is not empty.

    Parameters
    ----------
    names : sequence of str
        Names of the chambers.
    pressure_pa : ndarray (n_u,)
        Measured pressures [Pa gauge].
    bounds : EnableBounds

    Returns
    -------
    list of str
    """
    worst = int(np.argmax(np.abs(pressure_pa))) if len(pressure_pa) else 0
    if not len(pressure_pa) or abs(float(pressure_pa[worst])) <= bounds.pressure_pa:
        return []
    most, found = 1e-3 * bounds.pressure_pa, 1e-3 * float(pressure_pa[worst])
    return [f"{names[worst]} is at {found:.1f} kPa, allowed: {-most:g} to {most:g} kPa (enable)"]
