"""What faults do to a chamber's pressure and to its reading: pure functions, the same for every family."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from soro_core.hardware.emulation.faults import KINDS
from soro_core.pneumatics.regulator import RegulatorModel
from soro_core.pneumatics.valve_condition import ValveCondition

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
    share = _opening(faults, venting)
    rate = share / max(model.tau_s, SHORTEST_LAG_S)
    target_pa = faulty_target(faults, min(target_pa, faults.get("supply_drop", math.inf)))
    total = rate + _loss(faults)
    if total == 0.0:
        return before_pa
    rest = rate * target_pa / total
    after = rest + (before_pa - rest) * math.exp(-total * dt)
    return max(after, before_pa) if "vent_blocked" in faults else after


def faulty_target(faults: Mapping[str, float], target_pa: float) -> float:
    """What a valve brings its chamber to [Pa gauge], in place of a target."""
    return faults.get("stuck_open", faults.get("stuck_at", target_pa))


def condition_of(faults: Sequence[Mapping[str, float]], venting: Sequence[bool]) -> ValveCondition:
    """Condition of valves for a model of the flow; `venting` says which have let go.

    A valve that is stuck does not let go; what a chamber loses beside its valve it loses also while that is
    shut.
    """
    fill = np.array([_opening(active, gone) for active, gone in zip(faults, venting, strict=True)])
    is_open = [
        gone and "stuck_open" not in active and "stuck_at" not in active
        for active, gone in zip(faults, venting, strict=True)
    ]
    return ValveCondition(
        fill=fill,
        vent=np.where(["vent_blocked" in active for active in faults], 0.0, fill),
        supply_pa=np.array([active.get("supply_drop", math.inf) for active in faults]),
        loss_1_s=np.array([_loss(active) for active in faults]),
        is_open=np.array(is_open, dtype=np.float64),
    )


def _opening(faults: Mapping[str, float], venting: bool) -> float:
    """Part that valve and line let through of what they should."""
    if "stuck_closed" in faults:
        return 0.0
    slow = 1.0 if venting else faults.get("slow_valve", 1.0)
    return 1.0 / (slow * faults.get("kinked_line", 1.0))


def _loss(faults: Mapping[str, float]) -> float:
    """Part of its pressure that a chamber loses a second."""
    return faults.get("leak", 0.0) + faults.get("burst", 0.0)


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
