"""A hand of a scene: its fingers by their robot files, and the shapes that give them their pressures."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import NEXT_CONFIGURE, ConfigError
from soro_core.grasping.finger import Finger
from soro_core.grasping.settings import HandKeys
from soro_core.grasping.squeeze import Squeeze, SqueezeState
from soro_core.model.discretised import discretised
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Discretisation, Robot

# Steps of pressure between the shapes of a finger that are computed at the start.
_STEPS = 60


class Hand:
    """The law of a hand, and the coordinates that its fingers are asked for.

    A controller without feedback gives a finger the pressures of the shape that it is asked for: so each is
    asked for the shape that it would have under the wanted pressure without the object.

    Parameters
    ----------
    robots : sequence of Robot
        Of each finger, at its place.
    model : Discretisation
        How a finger is computed: as its controller does it.
    keys : HandKeys

    Raises
    ------
    ConfigError
        If the keys do not fit the fingers.
    """

    def __init__(self, robots: Sequence[Robot], model: Discretisation, keys: HandKeys) -> None:
        arms = [discretised(robot, model) for robot in robots]
        closing = np.array(keys.closing)
        fingers = []
        for arm in arms:
            if closing.shape != (arm.n_u,):
                raise ConfigError(
                    "hand", "closing", keys.closing, f"{arm.n_u} numbers, one a chamber of a finger"
                )
            by_place = np.linalg.pinv(arm.jacobian(np.zeros(arm.n_q), arm.length)[3:])
            noise = keys.pose_noise_m * np.linalg.norm(by_place, axis=1)
            fingers.append(Finger(arm, closing, keys.touch_m, noise, keys.off_m))
        self.keys, self.squeeze = keys, Squeeze(fingers, keys.squeeze)
        self._level_pa = np.linspace(0.0, keys.squeeze.most_pa, _STEPS + 1)
        self._shapes = [self._free_shapes(one) for one in fingers]

    def retuned(self, keys: HandKeys) -> Hand:
        """Return the same fingers with other forces and times.

        Raises
        ------
        ConfigError
            If the largest pressure or that of an open finger is another one: the shapes are of these.
        """
        for key in ("most_pa", "open_part"):
            asked, own = getattr(keys.squeeze, key), getattr(self.keys.squeeze, key)
            if asked != own:
                raise ConfigError("hand", f"squeeze.{key}", asked, f"{own:g}; another value {NEXT_CONFIGURE}")
        other = copy(self)
        other.keys, other.squeeze = keys, Squeeze(self.squeeze.fingers, keys.squeeze)
        return other

    def _free_shapes(self, finger: Finger) -> Array:
        """Coordinates (n, n_q) at rest under each level of pressure, without an object."""
        found: list[Array] = []
        for level in self._level_pa:
            pressures = self.keys.squeeze.pressures(finger.closing, level)
            found.append(equilibrium(finger.arm, pressures, found[-1] if found else None))
        return np.array(found)

    def shapes(self, state: SqueezeState) -> list[Array]:
        """Return the coordinates (n_q,) that each finger is asked for.

        Parameters
        ----------
        state : SqueezeState
        """
        return [
            np.array([np.interp(level, self._level_pa, column) for column in rows.T])
            for level, rows in zip(state.level_pa, self._shapes, strict=True)
        ]
