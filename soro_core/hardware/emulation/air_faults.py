"""What faults do to a chamber's pressure and to its reading: pure functions, the same for every family."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from soro_core.hardware.emulation.faults import KINDS
from soro_core.pneumatics.regulator import RegulatorModel

PNEUMATIC = frozenset(name for name, kind in KINDS.items() if kind.group == "pneumatic")
SENSOR = frozenset(name for name, kind in KINDS.items() if kind.group == "sensor")
# A valve without lag would make the rates below infinite.
SHORTEST_LAG_S = 1e-4


def faulty_pressure(
    faults: Mapping[str, float],
    model: RegulatorModel,
    before_pa: float,
    target_pa: float,
    venting: bool,
    dt: float,
) -> float:
    """Pressure [Pa gauge] after `dt`, of a chamber with pneumatic faults.

    The valve pulls towards its target with a rate 1/tau, the leak towards 0 with its own:
    p' = (target - p) / tau - leak p, solved exactly.

    Parameters
    ----------
    faults : mapping
        Active faults with their parameters.
    before_pa, target_pa : float
        Pressure at the start of the step, and what a healthy valve would bring it to.
    venting : bool
        Whether the valve has let go (fail-safe), so that its spring opens it to the air.
    """
    lag = max(model.tau_s, SHORTEST_LAG_S)
    if "slow_valve" in faults and not venting:
        lag *= faults["slow_valve"]
    if "kinked_line" in faults:
        lag *= faults["kinked_line"]
    rate = 1.0 / lag
    if "supply_drop" in faults:
        target_pa = min(target_pa, faults["supply_drop"])
    if "stuck_at" in faults:
        target_pa = faults["stuck_at"]
    if "stuck_open" in faults:
        target_pa = faults["stuck_open"]
    if "stuck_closed" in faults:
        rate = 0.0
    loss = faults.get("leak", 0.0) + faults.get("burst", 0.0)
    total = rate + loss
    if total == 0.0:
        return before_pa
    rest = rate * target_pa / total
    after = rest + (before_pa - rest) * math.exp(-total * dt)
    return max(after, before_pa) if "vent_blocked" in faults else after


def faulty_reading(
    faults: Mapping[str, float], reading_pa: float, held_pa: float, rng: np.random.Generator
) -> float:
    """Reading [Pa gauge] of a sensor with faults; `held_pa` is the last one before it got stuck."""
    if "sensor_open_circuit" in faults:
        return faults["sensor_open_circuit"]
    if "sensor_stuck" in faults:
        return held_pa
    reading = reading_pa * faults.get("sensor_scale", 1.0) + faults.get("sensor_offset", 0.0)
    if "sensor_noise" in faults:
        reading += faults["sensor_noise"] * float(rng.standard_normal())
    if "sensor_saturate" in faults:
        reading = min(reading, faults["sensor_saturate"])
    if "sensor_quantise" in faults:
        step = faults["sensor_quantise"]
        reading = round(reading / step) * step
    return reading
