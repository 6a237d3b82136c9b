"""The closed loop on a plant that it does not know, with `adaptive` and with `composite`, case by case."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks import law_packages, random_arms
from benchmarks.options import Options
from benchmarks.report import table
from soro_core import load_robot
from soro_core.config import find_config, parse
from soro_core.control import ControllerConfig, Point, Reference
from soro_core.control.reference.trajectory import smooth_step
from soro_core.errors import SoroError
from soro_core.pneumatics import RegulatorModel
from tests.soro_core.loop.loop_harness import Record, Setup
from tests.soro_core.loop.loop_harness import run as run_loop

TITLE = "Control: tip error of both laws"
LAWS = ("composite", "adaptive")
# Set points (elongation, bending about x and y [1/m]), way between them and time from one to the next [s].
SET_POINTS = ((0.05, 6.0, 0.0), (0.05, 6.0, 0.0), (0.06, -4.0, 8.0), (0.03, -8.0, -4.0), (0.07, 3.0, -9.0))
WAY_S, EVERY_S, HELD_S = 0.5, 4.0, 1.5


class SetPoints(Reference):
    """Set points in turn, with smooth ways between them."""

    def sample(self, t: float) -> Point:
        """Return the point at time `t` [s]."""
        i = max(0, min(int(t // EVERY_S), len(SET_POINTS) - 1))
        before, after = (np.array(SET_POINTS[k]) for k in (max(i - 1, 0), i))
        s, ds, dds = smooth_step((t - i * EVERY_S) / WAY_S)
        way = after - before
        return Point(before + s * way, ds / WAY_S * way, dds / WAY_S**2 * way)


@dataclass(frozen=True)
class Case:
    """One row: changes of the setup and of the configured reference, and the figure that stands for it."""

    name: str
    setup: Mapping[str, Any] = field(default_factory=dict)
    reference: Mapping[str, Any] = field(default_factory=dict)
    figure: Callable[[Record], float] = Record.rms


def held_rms(record: Record) -> float:
    """Return the mean RMS of the last part of each set point but the first [m]."""
    ends = np.arange(2, len(SET_POINTS) + 1) * EVERY_S
    parts = [record.error()[(record.t > end - HELD_S) & (record.t <= end)] for end in ends]
    return float(np.mean([np.sqrt(np.mean(part**2)) for part in parts]))


CASES = (
    Case("default, 20 g"),
    Case("0 g", {"payload_kg": 0.0}),
    Case("30 g", {"payload_kg": 0.03}),
    Case("35 g", {"payload_kg": 0.035}),
    Case("40 g", {"payload_kg": 0.04}),
    Case("stiffness 0.7", {"stiffness": 0.7}),
    Case("stiffness 1.3", {"stiffness": 1.3}),
    Case("tau 104 ms, delay 10 ms", {"regulator": RegulatorModel(tau_s=0.104, delay_s=0.010)}),
    Case("circle in 2 s", reference={"period_s": 2.0}),
    Case("drop 0.2, outlier 0.02, pose_delay 3", {"drop": 0.2, "outlier": 0.02, "pose_delay": 3}),
    Case("command_delay 4", {"command_delay": 4}),
    Case("0 to 20 g at 10 s", {"payload_kg": 0.0, "load_steps": ((10.0, 0.02),)}),
    Case("20 to 0 g at 10 s", {"load_steps": ((10.0, 0.0),)}),
    Case("10 to 11 s without poses", {"outage_s": (10.0, 11.0), "duration_s": 14.0}),
    Case("10 to 11 s frozen poses", {"frozen_s": (10.0, 11.0), "duration_s": 14.0}),
    Case("set points", {"reference": SetPoints()}, {"start_s": 0.5}, held_rms),
    Case("IMU alone", {"imu": True}),
)


def setup_of(case: Case, law: str, seed: int, quick: bool = False) -> Setup:
    """Return the setup of a case.

    Parameters
    ----------
    case : Case
    law : str
        Name of the law.
    seed : int
        Of all noise.
    quick : bool
        Whether a short run suffices.
    """
    control = parse({"law": law, "reference": dict(case.reference)}, ControllerConfig, "benchmark")
    setup = Setup(seed=seed, control=control, **case.setup)
    return replace(setup, duration_s=4.0) if quick else setup


def run(options: Options) -> str:
    """Measure and write."""
    robot = load_robot(find_config("tue_three_bellow", "robots"))
    rows, seeds = [], range(1, options.pick(options.seeds, 1) + 1)
    for case in options.pick(CASES, CASES[:1]):
        row: list[object] = [case.name]
        for law in LAWS:
            records = []
            for seed in seeds:
                options.say(f"{case.name}, {law}, seed {seed}")
                try:
                    records.append(run_loop(robot, setup_of(case, law, seed, options.quick)))
                except (SoroError, AssertionError):  # the plant of a lost arm has no step any more
                    records.append(None)
            row += cells(case, records)
        rows.append(row)
    columns = ("RMS, mm", "largest after 3 s, mm", "below 2 mm after, s", "rate, kPa/s")
    head = ["case", *(f"{law}: {column}" for law in LAWS for column in columns)]
    return "\n\n".join(
        [
            "Circle of 10 1/m in 4 s with 20 g that the loop does not know of, on a plant of four links "
            "behind lagging regulators, 20 s (`tests/soro_core/loop`): tip error RMS of the last 5 s "
            f"(set points: of the last {HELD_S:g} s of each), largest after 3 s, time after which the RMS "
            "over 0.25 s stays below 2 mm (from a step of the load on), RMS rate of the commands. Means of "
            f"seeds {', '.join(map(str, seeds))}; lost: the plant has no next step.",
            table(head, rows),
            random_arms.run(robot, options),
            law_packages.run(robot, options, CASES, setup_of),
        ]
    )


def cells(case: Case, records: Sequence[Record | None]) -> list[str]:
    """Return the figures of one law."""
    found = [record for record in records if record is not None]
    if len(found) < len(records):
        return ["lost", "-", "-", "-"]
    step_s = max((at for at, _ in case.setup.get("load_steps", ())), default=0.0)
    rows = [
        (1e3 * case.figure(r), 1e3 * r.peak(), r.settled_s(step_s), 1e-3 * r.command_rate()) for r in found
    ]
    rms, peak, settled, rate = np.mean(rows, axis=0)
    return [f"{rms:.3f}", f"{peak:.2f}", f"{settled:.2f}", f"{rate:.0f}"]
