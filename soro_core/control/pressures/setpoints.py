"""From a desired generalised force to set points: allocation, the regulators' lag, bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array, all_finite
from soro_core.control.pressures.actuation import CompletePressures, pressure_bounds
from soro_core.control.pressures.allocation import Allocation, allocate, balanced_weight
from soro_core.control.pressures.effective_pressure import check_dead_bands, effective_pressure_of
from soro_core.control.pressures.lag_compensation import compensate
from soro_core.control.reference.coordinate_values import per_coordinate
from soro_core.frozen import replaced
from soro_core.pneumatics.lag import follow as follow_lag
from soro_core.robot import Robot
from soro_core.robot.coordinates import StrainFields

# Margin of a wide search, in ranges of the set points; regularised as before it would keep to the range.
_WIDE, _WIDE_REGULARISATION = 1e3, 1e-12


@dataclass(frozen=True)
class Setpoints:
    """Set points of one tick.

    Attributes
    ----------
    wish : Allocation
        Pressures for the desired force.
    command_pa : ndarray (n_u,)
        Set points [Pa gauge].
    model_pa : ndarray (n_u,)
        Pressures that the lag model predicts from them [Pa gauge].
    at_bound : ndarray of bool (n_u,)
        Chambers whose wish or set point lies at a bound of the range.
    ok : bool
        Whether there are pressures for the desired force, and the set points are finite.
    """

    wish: Allocation
    command_pa: Array
    model_pa: Array
    at_bound: NDArray[np.bool_]
    ok: bool


class SetpointMaker:
    """Makes set points of one robot.

    A chamber with a dead band is kept at the band or above, where its force has no step. Forces are allocated
    to effective pressures, in which they are linear. On the way to the limiter `make` alone checks and
    bounds set points.

    Parameters
    ----------
    robot : Robot
        Discretised robot.
    fields : StrainFields
        Its strains.
    pressures : CompletePressures
        Bounds, weights and regulators.

    Raises
    ------
    ConfigError
        If the bounds leave no range, or lie on both sides of a dead band.
    """

    def __init__(self, robot: Robot, fields: StrainFields, pressures: CompletePressures) -> None:
        self.fields, self.pressures = fields, pressures
        if (weight := pressures.force_weight) is None:
            # Bending moves the tip most: where not all forces can be made, elongation gives way first.
            turns = fields.of("bending_x") + fields.of("bending_y") + fields.of("torsion")
            self.force_weight = np.where(turns > 0.0, 1.0, 0.3)
        else:
            self.force_weight, _ = per_coordinate(fields, weight, "pressures.force_weight")
        low, high = pressure_bounds(pressures, robot)
        check_dead_bands(robot, low, high)
        self.effective = effective_pressure_of(robot)
        band = self.effective.dead_band_pa
        # Without a band a chamber takes pressures below zero too.
        self.minimum_pa = np.where(band > 0.0, np.maximum(low, band), low)
        self.maximum_pa = np.full(robot.n_u, high)
        self._least, self._most = (
            self.effective.from_setpoint(self.minimum_pa),
            self.effective.from_setpoint(self.maximum_pa),
        )
        self.preferred_pa = np.clip(pressures.preferred_pa, self.minimum_pa, self.maximum_pa)
        self._preferred = self.effective.from_setpoint(self.preferred_pa)
        self._edge = edge = 1e-9 * (self.maximum_pa - self.minimum_pa)  # round-off
        self._low, self._high = self.minimum_pa + edge, self.maximum_pa - edge

    def allocate(self, actuation: Array, desired: Array, start_pa: Array, wide: bool = False) -> Allocation:
        """Return the pressures for a force.

        Parameters
        ----------
        actuation : ndarray (n_q, n_u)
            H as the law believes it.
        desired : ndarray (n_q,)
            Desired generalised force.
        start_pa : ndarray (n_u,)
            Start of the search [Pa gauge].
        wide : bool
            Far beyond the bounds, for what a force would need.
        """
        margin = _WIDE * (self._most - self._least) if wide else 0.0
        found = allocate(
            actuation,
            desired,
            self._least - margin,
            self._most + margin,
            self.force_weight[:, None] * balanced_weight(actuation, self.fields),
            _WIDE_REGULARISATION if wide else self.pressures.regularisation,
            self._preferred,
            self.effective.from_setpoint(start_pa),
        )
        return replaced(found, pressure_pa=self.effective.to_setpoint(found.pressure_pa))

    def beyond_pa(self, pressure_pa: Array) -> Array:
        """Return how far set points (..., n_u) [Pa gauge] are beyond their range and its round-off."""
        beyond = np.maximum(pressure_pa - self.maximum_pa, self.minimum_pa - pressure_pa)
        return np.asarray(beyond - self._edge)

    def missing_pa(self, actuation: Array, desired: Array, wish: Allocation) -> Array:
        """Return the pressure (n_u,) [Pa] beyond its bound that a force needs of each chamber.

        Parameters
        ----------
        actuation : ndarray (n_q, n_u)
            H as the law believes it.
        desired : ndarray (n_q,)
            Desired generalised force.
        wish : Allocation
            Its pressures within the bounds, some of them at one.
        """
        free = self.allocate(actuation, desired, wish.pressure_pa, wide=True).pressure_pa
        return np.asarray(free - np.minimum(np.maximum(free, self.minimum_pa), self.maximum_pa))

    def make(
        self, wish: Allocation, model_pa: Array, setpoint_pa: Array, bias_pa: Array | float, dt: float
    ) -> Setpoints:
        """Return the set points that bring the pressures to a wish.

        Parameters
        ----------
        wish : Allocation
            Desired pressures.
        model_pa, setpoint_pa : ndarray (n_u,)
            Predicted pressures and set points of the last tick [Pa gauge].
        bias_pa : ndarray (n_u,) or float
            What each regulator adds to its command [Pa].
        dt : float
            Time since the last tick [s].
        """
        pressures = self.pressures
        # The limiter would clip a faster change as well; clipped here, the lag model includes it.
        command = compensate(
            wish.pressure_pa,
            model_pa,
            pressures.lag_s,
            pressures.lag_filter_s,
            np.maximum(self.minimum_pa, setpoint_pa - pressures.fall_pa_s * dt),
            np.minimum(self.maximum_pa, setpoint_pa + pressures.rise_pa_s * dt),
            bias_pa,
        )
        at_bound = (command <= self._low) | (command >= self._high)
        predicted = follow_lag(model_pa, command + bias_pa, dt, pressures.lag_s)
        ok = wish.ok and all_finite(command)
        return Setpoints(wish, command, predicted, wish.saturated | at_bound, ok)
