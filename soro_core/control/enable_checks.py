"""Checks before a controller is enabled: pressures near zero, and sensors that agree with the model at rest.

The load is not known, so the arm may rest under any load from none to the largest that the law learns. A
standing arm may lean in any direction then: the search for its rest starts where the sensors see it.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soro_core.arrays import Array
from soro_core.control.motion_config import EnableBounds
from soro_core.control.motions.kinematics import inverse_kinematics
from soro_core.control.motions.references import bounds_of
from soro_core.errors import ConfigError, ModelError
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot.coordinates import StrainFields, strain_fields
from soro_core.robot.description import END_TOLERANCE
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix, rotation_log

if TYPE_CHECKING:
    from soro_core.control.controller import Controller


# Links of the arm that is compared with the samples.
_PARTS = 4
# Loads that are tried beside the one that is nearest to balance, relative to it.
_AROUND = (-0.1, 0.1, -0.2, 0.2)
# Evenly spaced loads up to the largest one, for an arm that lies over: the shape with its tip that comes from
# kinematics is bent elsewhere, and says little of the load.
_LOADS = 12
# Halvings of the distance to the best of them.
_HALVINGS = 3


@dataclass(frozen=True)
class SensorSample:
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

    def findings(
        self, seen: Sequence[SensorSample], bounds: EnableBounds, between: Callable[[], None] = lambda: None
    ) -> list[str]:
        """Return a line for each sensor that fits the model under no load; none without a position.

        An orientation alone belongs to an arm that leans under its load as well as to a turned base.

        Parameters
        ----------
        seen : sequence of SensorSample
            Samples of the sensors.
        bounds : EnableBounds
        between : callable
            Called after each rest that is tried: the search takes longer than a tick.
        """
        if all(one.position is None for one in seen):
            return []
        tried: list[Array] = []
        for q in self._rests(seen, bounds):
            between()
            if self._worst(seen, q, bounds) <= 1.0:
                return []
            tried.append(q)
        tried = tried or [np.zeros(self.arm.n_q)]
        best = min(tried, key=lambda q: self._worst(seen, q, bounds))
        wrong = [one for one in seen if self._misfit(one, best, bounds) > 1.0]
        return [self._text(one, best, bounds) + self._turn(one, tried, bounds) for one in wrong]

    def _rests(self, seen: Sequence[SensorSample], bounds: EnableBounds) -> Iterator[Array]:
        """Yield coordinates at rest: from where the sensors see the tip, and upright."""
        upright, start = np.zeros(self.arm.n_q), self._bent(seen, bounds)
        likely = self._load_at(start)
        yield from self._rest(likely, start)
        yield from self._rest(0.0, upright)
        near = [(load, q) for x in _AROUND for load in (likely * (1.0 + x),) for q in self._rest(load, start)]
        yield from (q for _, q in near)
        yield from self._nearer(near, 0.5 * abs(_AROUND[0]) * likely, seen, bounds)
        apart = self.heaviest_kg / _LOADS
        wide = [
            (load, q) for k in range(_LOADS) for load in (apart * (k + 1),) for q in self._rest(load, start)
        ]
        yield from (q for _, q in wide)
        yield from self._nearer(wide, 0.5 * apart, seen, bounds)

    def _bent(self, seen: Sequence[SensorSample], bounds: EnableBounds) -> Array:
        """Return coordinates like those of the arm that the outermost pose belongs to."""
        zero = np.zeros(self.arm.n_q)
        last = max((one for one in seen if one.position is not None), key=lambda one: one.s)
        if last.position is not None and last.s >= self.arm.length - END_TOLERANCE:
            # Weighted so that both bounds count the same.
            weight = bounds.distance_m / math.radians(bounds.angle_deg)
            return inverse_kinematics(
                self.arm, last.position, last.quaternion, zero, self.limit, weight, fields=self.fields
            ).q
        if last.quaternion is None or last.s <= END_TOLERANCE:
            return zero
        # The rest of the arm is bent as the part before the pose is.
        base = self.arm.pose(zero, 0.0)[:3, :3]
        turn = rotation_log(base.T @ matrix_from_quaternion(last.quaternion))
        bends = np.array([self.fields.of(f"bending_{axis}") for axis in "xy"]) * self.fields.uniform
        turns = self.arm.jacobian(zero, last.s)[:3] @ bends.T
        return self.fields.within(np.linalg.lstsq(turns, turn, rcond=None)[0] @ bends, self.limit)

    def _nearer(
        self,
        tried: list[tuple[float, Array]],
        step: float,
        seen: Sequence[SensorSample],
        bounds: EnableBounds,
    ) -> Iterator[Array]:
        """Yield rests under loads [kg] nearer and nearer to the one that fits best, from its coordinates."""
        for _ in range(_HALVINGS if tried else 0):
            # Near buckling the tip moves far with little load.
            load, best = min(tried, key=lambda pair: self._worst(seen, pair[1], bounds))
            found = [(load + x, q) for x in (-step, step) for q in self._rest(load + x, best)]
            yield from (q for _, q in found)
            tried, step = [(load, best), *found], 0.5 * step

    def _rest(self, load: float, start: Array) -> Iterator[Array]:
        """Yield the rest under a load [kg] that a search from `start` finds, if it finds one."""
        if 0.0 <= load <= self.heaviest_kg:
            with contextlib.suppress(ModelError):
                yield equilibrium(self.arm, np.zeros(self.arm.n_u), start, load)

    def _load_at(self, q: Array) -> float:
        """Return the load [kg] that is nearest to balance in `q`."""
        rest = np.zeros(self.arm.n_q)
        force = self.arm.gravity_force(q) + self.arm.elastic_force(q)
        weight = self.arm.mass_regressor(q, rest, rest, rest)[:, 0]
        # The forces of bendings alone: an elongation says little of a load.
        bend = ~self.fields.stretch
        square = float(weight[bend] @ weight[bend])
        load = -float(weight[bend] @ force[bend]) / square if square > 0.0 else 0.0
        return min(max(load, 0.0), self.heaviest_kg)

    def _worst(self, seen: Sequence[SensorSample], q: Array, bounds: EnableBounds) -> float:
        """Return the misfit of the sample that fits least."""
        return max((self._misfit(one, q, bounds) for one in seen), default=0.0)

    def _misfit(self, one: SensorSample, q: Array, bounds: EnableBounds) -> float:
        """Return distance and angle of a sample from the model, the larger one, in bounds."""
        distance, angle = self._apart(one, q)
        return max(distance / bounds.distance_m, math.degrees(angle) / bounds.angle_deg)

    def _apart(self, one: SensorSample, q: Array) -> tuple[float, float]:
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

    def _text(self, one: SensorSample, q: Array, bounds: EnableBounds) -> str:
        distance, angle = self._apart(one, q)
        apart = [] if one.position is None else [f"{1e3 * distance:.0f} mm"]
        apart += [f"{math.degrees(angle):.0f} degrees"]
        return (
            f"{one.name} is {' and '.join(apart)} from the model at rest under any load from 0 to "
            f"{1e3 * self.heaviest_kg:.0f} g, allowed: {1e3 * bounds.distance_m:g} mm and "
            f"{bounds.angle_deg:g} degrees (enable)"
        )

    def _turn(self, one: SensorSample, rests: Sequence[Array], bounds: EnableBounds) -> str:
        """Return the rotation of a pose that would make it fit one of these rests, as an end of the line."""
        if one.quaternion is None:
            return ""
        base = np.asarray(self.arm.robot.base_position, dtype=np.float64)
        found = []
        for q in rests:
            pose = self.arm.pose(q, one.s)
            turn = pose[:3, :3] @ matrix_from_quaternion(one.quaternion).T
            away = 0.0 if one.position is None else base + turn @ (one.position - base) - pose[:3, 3]
            found.append((float(np.linalg.norm(away)), quaternion_from_matrix(turn)))
        distance, quaternion = min(found, key=lambda pair: pair[0])
        if distance > bounds.distance_m:
            return "; no rotation about the base makes it fit"
        rounded = quaternion.round(3)
        if rounded[3] == 0.0 and rounded.sum() < 0.0:  # half a turn has two signs
            rounded = -rounded
        rotation = ", ".join(f"{x:.3f}" for x in rounded + 0.0)
        return f"; turned by the quaternion [{rotation}] it fits: see base_quaternion, or the sensor's frame"


def resting_arm(controller: Controller) -> RestingArm:
    """Return the model at rest, with loads up to the bound of the mass that the law learns."""
    robot = controller.robot
    # A load bends a link non-uniformly: constant strain would match its tip or its angle, not both.
    with contextlib.suppress(ConfigError):  # modes cannot be split
        robot = robot if robot.varies else robot.refine(math.ceil(_PARTS / len(robot.links)))
    fields = strain_fields(robot)
    limit = bounds_of(fields, controller.config.reference, 1).strain
    return RestingArm(SoftArm(robot), fields, limit, controller.law.heaviest_kg())


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
