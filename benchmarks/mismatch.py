"""The closed loop on plants whose structure differs from the robot file: how far off, and what it says."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks import mismatched_arms
from benchmarks.judged_loop import Outcome, outcome
from benchmarks.mismatched_robots import (
    four_chambers,
    four_uneven,
    guessed,
    sloped,
    varying,
    weak,
    write_robot,
)
from benchmarks.options import Options
from benchmarks.report import table
from soro_core.adaptation.kept import KeptNumbers, keep
from soro_core.config import with_changes
from soro_core.robot import Robot, load_robot
from soro_lab.scene import Scene, load_scene
from soro_ros.recordings.report import WINDOW_S
from soro_ros.study.closed_loop import ticks_of

TITLE = "Mismatch: arms that differ from their file"
LAWS = ("composite", "adaptive")

HANGING = {
    "robot": "three_bellow_hanging",
    "controller.reference.curvature_per_m": 7.0,
    "controller.reference.mean_pressure_pa": 40e3,
}
STANDING = {
    "controller.reference.curvature_per_m": 8.0,
    "controller.reference.mean_pressure_pa": 40e3,
}
EMPTY = {"twin.payload_kg": 0.0}
# Bend of the standing arm: three times the automatic k_p, twice k_d.
FIRM = {"k_p": [0.194, 6.87e-6, 6.87e-6], "k_d": [0.0, 4.96e-7, 4.96e-7], "lambda_per_s": [3.59, 3.59, 3.59]}
# A link whose strains vary is not divided.
WHOLE = {"twin.refine": 1}


@dataclass(frozen=True)
class Case:
    """One row.

    Attributes
    ----------
    name : str
    goal : float
        Tip error to reach, part of the length.
    truth : callable
        Gives the true robot from that of the controller.
    keys : mapping
        Changes of the scene.
    scene : str
    robot : callable, optional
        Gives a robot of the controller that is not shipped.
    """

    name: str
    goal: float
    truth: Callable[[Robot], Robot]
    keys: Mapping[str, Any] = field(default_factory=dict)
    scene: str = "track_circle"
    robot: Callable[[], Robot] | None = None


CASES = (
    Case("standing, area slope -2", 0.007, sloped(-2.0), {**STANDING, **EMPTY}),
    Case("hanging, area slope -2", 0.010, sloped(-2.0), {**HANGING, **EMPTY}),
    Case("hanging, area slope 0", 0.015, sloped(0.0), {**HANGING, **EMPTY}),
    Case("standing, k_b x 0.75, slope 0, order 1, 20 g", 0.02, sloped(0.0, 0.75, 1), WHOLE),
    Case(
        "the same with k_p of the bend times 3, k_d times 2",
        0.02,
        sloped(0.0, 0.75, 1),
        {**WHOLE, "controller.gains": FIRM},
    ),
    Case("standing, k_b x 0.75, slope 0, order 0, 20 g", 0.02, sloped(0.0, 0.75), WHOLE),
    Case("hanging, chamber 1 at 60 %", 0.005, weak(1, 0.6), {**HANGING, **EMPTY}),
    Case(
        "the same about 30 kPa, which 90 kPa allow",
        0.005,
        weak(1, 0.6),
        {**HANGING, **EMPTY, "controller.reference.mean_pressure_pa": 30e3},
    ),
    Case(
        "four uneven chambers, one at 55 %, order 1, creep, 10 g",
        0.007,
        four_uneven,
        {
            **WHOLE,
            "twin.payload_kg": 0.01,
            "controller.reference.curvature_per_m": 2.5,
            "controller.reference.mean_pressure_pa": 40e3,
        },
        robot=four_chambers,
    ),
    Case(
        "asu_two_segment from its guess, 100 g, two poses",
        0.015,
        lambda robot: load_robot("asu_two_segment"),
        scene="two_links",
        robot=guessed,
    ),
    Case("standing, order 1, 20 g", 0.00154, varying(1), {**WHOLE, "duration_s": 20.0}),
    Case("standing, order 2, 20 g", 0.00154, varying(2), {**WHOLE, "duration_s": 20.0}),
)


KEPT = (
    *(case for case in CASES if "slope -2" in case.name or "30 kPa" in case.name or "four" in case.name),
    Case("hanging, as its file", 0.005, lambda robot: robot, {**HANGING, **EMPTY}),
)
OPENING_S = (2.0, 4.0)
SPANS = ("0 to 2 s", "2 to 4 s")


def scene_of(case: Case, law: str, seed: int, folder: Path) -> Scene:
    """Return the scene of a case; the files of robot and plant stand in a folder."""
    keys = {"platform": "", "mode": "lockstep", "duration_s": 12.0, "controller.gains": "auto", **case.keys}
    robot = (
        load_robot(str(keys.pop("robot", load_scene(case.scene).robot)))
        if case.robot is None
        else case.robot()
    )
    base = write_robot(robot, folder / "robot.yaml")
    plant = write_robot(case.truth(robot), folder / "plant.yaml", {"based_on": "robot.yaml"})
    keys |= {"robot": base, "twin.plant": plant, "controller.law": law, "seed": seed}
    return load_scene(case.scene, keys)


def opening(scene: Scene) -> tuple[list[float], KeptNumbers]:
    """Return the RMS of the tip error, part of the length, in two spans of the law, and what was kept."""
    squares = []
    for tick in ticks_of(scene):
        command = tick.command
        assert command is not None
        if command.terms is not None:  # the law has begun
            missed = tick.seen.tip[:3, 3] - command.tip_reference[:3, 3]
            squares.append(float(missed @ missed))
    kept = keep(scene.loaded_robot, command.estimates, command.deviations())
    cuts = [round(t * scene.rate_hz) for t in (0.0, *OPENING_S)]
    means = [float(np.mean(squares[a:b])) for a, b in pairwise(cuts)]
    return [float(np.sqrt(mean)) / scene.loaded_robot.length for mean in means], kept


def kept_rows(options: Options) -> list[list[object]]:
    """Return the first seconds of a run alone, from the probe, and from what an earlier one has learned."""
    rows = []
    for case in options.pick(KEPT, KEPT[:1]):
        options.say(f"{case.name}, kept")
        with TemporaryDirectory() as folder:
            scene = scene_of(case, "composite", 1, Path(folder))
            _, kept = opening(scene)
            again = with_changes(scene, seed=2, duration_s=OPENING_S[-1])
            control = with_changes(scene.controller, probe_at_enable="warn")
            probed = with_changes(again, controller=control)
            found = [opening(one)[0] for one in (again, probed, again.with_learned(kept))]
        row = (f"{100 * value:.2f}" for pair in zip(*found, strict=True) for value in pair)
        rows.append([case.name, *row])
    return rows


def measured(case: Case, law: str, seed: int) -> Outcome:
    """Run a case once."""
    with TemporaryDirectory() as folder:
        return outcome(scene_of(case, law, seed, Path(folder)))


def run(options: Options) -> str:
    """Measure and write."""
    seeds = range(1, options.pick(options.seeds, 1) + 1)
    rows = []
    for case in options.pick(CASES, CASES[:1]):
        row: list[object] = [case.name, f"{100 * case.goal:.2g}"]
        for law in LAWS:
            found = []
            for seed in seeds:
                options.say(f"{case.name}, {law}, seed {seed}")
                found.append(measured(case, law, seed))
            row += cells(found)
        rows.append(row)
    head = [
        "case",
        "to reach, %",
        *(f"{law}: {what}" for law in LAWS for what in ("RMS, %", "verdict", "notes")),
    ]
    return "\n\n".join(
        [
            "The truth differs from the robot file in structure (`twin.plant`), all in lockstep, gains "
            f"automatic: tip error RMS of the last {WINDOW_S:g} s, % of the length. Means of seeds "
            f"{', '.join(map(str, seeds))}; the verdict is that of `soro run`, the notes are the last ones "
            "of the first seed. In brackets: to the configured circle, where the law has chosen another "
            "elongation for it.",
            table(head, rows),
            "Alone, started from the gains that the probe has measured (`probe_at_enable: warn`, on in real "
            "time), and from what an earlier run of 12 s has learned (`--learn-from`): tip error RMS behind "
            "the probe, % of the length, `composite`, seed 2, the earlier run seed 1.",
            table(
                ["case", *(f"{span}, {how}" for span in SPANS for how in ("alone", "probed", "kept"))],
                kept_rows(options),
            ),
            "### Random arms",
            mismatched_arms.run(options),
        ]
    )


def cells(found: Sequence[Outcome]) -> list[str]:
    """Return the figures of one law."""
    error = float(np.mean([one.error for one in found]))
    verdicts = "; ".join(sorted({one.verdict.word for one in found}))
    configured = [one.configured for one in found]
    moved = np.isfinite(configured)
    asked = np.where(moved, configured, [one.error for one in found])
    also = f" ({100 * float(np.mean(asked)):.2f})" if moved.any() else ""
    return [f"{100 * error:.2f}{also}", verdicts, found[0].notes]
