"""Whether the filter's covariance is that of its error: in closed loop, matched and mismatched."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.mismatch import sloped, varying, weak
from benchmarks.options import Options
from benchmarks.report import met, table
from soro_core import load_robot
from soro_core.arrays import Array
from soro_core.config import find_config, parse
from soro_core.control import Controller, ControllerConfig
from soro_core.estimation import Estimate, Estimator, EstimatorState
from soro_core.loop import Loop
from soro_core.robot import Robot
from tests.soro_core.loop.loop_harness import Harness, Setup

# Seeds of each case, from 1 on.
SEEDS = 20
# The filter finds the arm before this time [s].
AFTER_S = 1.0
# A column that has no goal in a case.
NO_GOAL = (0.0, np.inf)


@dataclass(frozen=True)
class Case:
    """One row: changes of the setup and of the reference, and the least and largest values to reach.

    `state` means that q and qd of the plant are those of the filter's model, and are compared too;
    `truth` gives the plant that differs from the file.
    """

    name: str
    setup: Mapping[str, Any] = field(default_factory=dict)
    reference: Mapping[str, Any] = field(default_factory=dict)
    law_options: Mapping[str, Any] = field(default_factory=dict)
    nis: tuple[float, float] = NO_GOAL
    tip: tuple[float, float] = NO_GOAL
    state: tuple[float, float] | None = None
    error_mm: tuple[float, float] = NO_GOAL
    truth: Callable[[Robot], Robot] | None = None


CASES = (
    Case("20 g", nis=(2.4, 3.6), tip=(2.0, 4.0), error_mm=(0.0, 0.22)),
    Case("20 g, circle in 2 s", reference={"period_s": 2.0}, error_mm=(0.0, 0.25)),
    # Its strains are constant along the link, so the learned model has no non-uniform strain.
    Case(
        "matched plant",
        {"refine": 1, "payload_kg": 0.0},
        law_options={"nonuniform_strain": False},
        state=(4.0, 8.0),
    ),
    # What differs from the file without a goal: how far the filter may be believed.
    Case("20 g, chamber 1 at 60 %", truth=weak(1, 0.6)),
    Case("20 g, area slope -2", truth=sloped(-2.0)),
    Case("20 g, Legendre order 1", {"refine": 1}, truth=varying(1)),
    Case("20 g, stiffness 0.7", {"stiffness": 0.7}),
    Case("20 g, damping 2", {"damping": 2.0}),
    Case("20 g, noise 3 times the stated one", {"position_noise_m": 9e-4}),
)


class Watched(Estimator):
    """An estimator that keeps the normalised innovations of its positions."""

    nis: float = np.nan

    def step(self, *arguments: Any) -> tuple[EstimatorState, Estimate]:
        """Step, and keep the mean of the only sensor."""
        state, estimate = super().step(*arguments)
        for monitor in state.monitors.values():
            self.nis = monitor.position_nis
        return state, estimate


def run(options: Options) -> str:
    """Measure and write."""
    robot, rows, good = load_robot(find_config("tue_three_bellow", "robots")), [], True
    seeds = range(1, options.pick(SEEDS, 1) + 1)
    for case in CASES:
        found = []
        for seed in seeds:
            options.say(f"{case.name}, seed {seed}")
            found.append(measured(robot, case, seed, options.pick(20.0, 2.0)))
        means, reached = row(case, found)
        rows.append(means)
        good = good and reached
    head = ["case", "NIS of the position", "NEES of the tip", "NEES of (q, qd)", "tip error, mm"]
    return "\n\n".join(
        [
            "The covariance of the filter against its error: the circle of `tests/soro_core/loop` with "
            f"`law: composite`, from {AFTER_S:g} s on, means of seeds 1 to {len(seeds)} (smallest and "
            "largest of a seed). Position and tip have 3 components, (q, qd) has 6. The NIS is that of "
            "/diagnostics. A matched plant is the model of the filter, without a load and with strains that "
            "are constant along the link (`law_options: {nonuniform_strain: false}`); its sensors "
            "have the noise that is declared.",
            table(head, rows),
            f"Goals: {met(good)}",
        ]
    )


def measured(robot: Robot, case: Case, seed: int, duration_s: float) -> Array:
    """Return NIS of the position, NEES of the tip and of (q, qd), and tip error [mm] of one run.

    Parameters
    ----------
    robot : Robot
    case : Case
    seed : int
        Of all noise.
    duration_s : float
        Time of the run [s].
    """
    keys = {
        "law": "composite",
        "law_options": dict(case.law_options),
        "reference": dict(case.reference),
    }
    law = parse(keys, ControllerConfig, "benchmark")
    plant = None if case.truth is None else case.truth(robot)
    setup = Setup(seed=seed, control=law, duration_s=duration_s, plant=plant, **case.setup)
    estimator = Watched(robot, setup.estimation, setup.dt)
    rows, steps = [], round(setup.duration_s / setup.dt)
    for tick in Loop(estimator, Controller(robot, law)).run(Harness(robot, setup), steps, setup.dt, delay=0):
        if tick.t_s <= AFTER_S:
            continue
        estimate, state = tick.estimate, np.nan
        error = tick.seen.tip[:3, 3] - estimate.tip_pose[:3, 3]
        if case.state is not None:
            body = tick.plant.body
            missed = np.concatenate([body.q - estimate.q, body.qd - estimate.qd])
            state = squared(missed, estimate.covariance)
        rows.append([estimator.nis, squared(error, estimate.tip_covariance[:3, :3]), state, error @ error])
    nis, tip, state, square = np.mean(rows, axis=0)
    return np.array([nis, tip, state, 1e3 * np.sqrt(square)])


def squared(error: Array, covariance: Array) -> float:
    """Return the normalised square of an error."""
    return float(error @ np.linalg.solve(covariance, error))


def row(case: Case, found: Sequence[Array]) -> tuple[list[str], bool]:
    """Return the row of a case, and whether it reaches its goals."""
    goals = (case.nis, case.tip, NO_GOAL if case.state is None else case.state, case.error_mm)
    cells, good = [case.name], True
    for values, (least, most) in zip(np.transpose(found), goals, strict=True):
        mean = float(np.mean(values))
        if np.isnan(mean):
            cells.append("-")
            continue
        text = f"{mean:.2f} ({np.min(values):.2f} to {np.max(values):.2f})"
        if (least, most) != NO_GOAL:
            reached = least <= mean <= most
            good = good and reached
            limits = f"{least:g} to {most:g}" if least else f"below {most:g}"
            text += f", goal {limits}: {met(reached)}"
        cells.append(text)
    return cells, good
