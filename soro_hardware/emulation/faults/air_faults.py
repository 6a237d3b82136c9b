"""Effects of faults on a chamber's pressure and its reading: pure functions, the same for every family."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from soro_core.pneumatics.lag import follow
from soro_core.pneumatics.regulator import RegulatorModel
from soro_core.pneumatics.valve_condition import ValveCondition
from soro_hardware.emulation.faults.fault_types import KINDS

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
    """Return the pressure of a chamber with pneumatic faults after a step.

    The pressure p obeys p' = (target - p) / tau - leak p, which is solved exactly.

    Parameters
    ----------
    faults : mapping
        Active faults with their parameters.
    model : RegulatorModel
        Dynamics of the valve, with the time constant tau.
    before_pa, target_pa : float
        Pressure at the start of the step, and target of the valve without faults [Pa gauge].
    venting : bool
        Whether the valve vents (fail-safe): its spring opens the exhaust.
    dt : float
        Length of the step [s].

    Returns
    -------
    float
        Pressure [Pa gauge].
    """
    share = _opening(faults, venting)
    rate = share / max(model.tau_s, SHORTEST_LAG_S)
    target_pa = faulty_target(faults, min(target_pa, faults.get("supply_drop", math.inf)))
    total = rate + _loss(faults)
    if total == 0.0:
        return before_pa
    after = follow(before_pa, rate * target_pa / total, dt, 1.0 / total)
    return max(after, before_pa) if "vent_blocked" in faults else after


def faulty_target(faults: Mapping[str, float], target_pa: float) -> float:
    """Return the target [Pa gauge] of a valve with faults, given its target without them."""
    return faults.get("stuck_open", faults.get("stuck_at", target_pa))


def condition_of(faults: Sequence[Mapping[str, float]], venting: Sequence[bool]) -> ValveCondition:
    """Return the condition of n valves for a model of the flow.

    A stuck valve does not vent. A leaking chamber loses air also while its valve is closed.

    Parameters
    ----------
    faults : sequence of mapping
        Active faults of each valve with their parameters.
    venting : sequence of bool
        Whether each valve vents.
    """
    fill = np.array([_opening(active, vents) for active, vents in zip(faults, venting, strict=True)])
    is_open = [
        vents and "stuck_open" not in active and "stuck_at" not in active
        for active, vents in zip(faults, venting, strict=True)
    ]
    return ValveCondition(
        fill=fill,
        vent=np.where(["vent_blocked" in active for active in faults], 0.0, fill),
        supply_pa=np.array([active.get("supply_drop", math.inf) for active in faults]),
        loss_1_s=np.array([_loss(active) for active in faults]),
        is_open=np.array(is_open, dtype=np.float64),
    )


def _opening(faults: Mapping[str, float], venting: bool) -> float:
    """Return the flow through valve and line, relative to the flow without faults."""
    if "stuck_closed" in faults:
        return 0.0
    slow = 1.0 if venting else faults.get("slow_valve", 1.0)
    return 1.0 / (slow * faults.get("kinked_line", 1.0))


def _loss(faults: Mapping[str, float]) -> float:
    """Return the rate [1/s] at which a chamber loses its pressure."""
    return faults.get("leak", 0.0) + faults.get("burst", 0.0)


def faulty_reading(
    faults: Mapping[str, float], reading_pa: float, held_pa: float, rng: np.random.Generator
) -> float:
    """Return the reading of a sensor with faults.

    Parameters
    ----------
    faults : mapping
        Active faults with their parameters.
    reading_pa, held_pa : float
        Present reading without faults, and last reading, which `sensor_stuck` repeats [Pa gauge].
    rng : numpy Generator
        Source of the noise.

    Returns
    -------
    float
        Reading [Pa gauge].
    """
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
