"""What every driver checks before anything goes over the wire."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.port import Array, Fault

if TYPE_CHECKING:
    from soro_core.hardware.platform import PressureRange


def setpoints(values: Array, n: int) -> Array:
    """Set points (n,) [Pa gauge] as floats.

    Raises
    ------
    HardwareError
        If there are not `n` of them.
    """
    found = np.asarray(values, dtype=np.float64)
    if found.shape != (n,):
        raise HardwareError(f"{found.shape} set points for {n} chambers")
    return found


def refused(allowed: PressureRange, names: tuple[str, ...], setpoint_pa: Array) -> list[Fault]:
    """Faults of the set points [Pa gauge] (n,) that are not finite or out of range."""
    slack = 1e-6 * (allowed.maximum_pa - allowed.minimum_pa)  # rounding of a limiter's arithmetic
    good = (setpoint_pa >= allowed.minimum_pa - slack) & (setpoint_pa <= allowed.maximum_pa + slack)
    return [
        Fault("refused_setpoint", names[n], f"{setpoint_pa[n]} Pa is not within the platform's range")
        for n in map(int, np.flatnonzero(~good))  # a comparison with NaN is false, so NaN is refused here
    ]
