"""The closed loop on plants whose structure differs from the robot file: how far off, and what it says."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from benchmarks.options import Options
from benchmarks.report import table
from soro_core.adaptation.kept import KeptNumbers, keep
from soro_core.config import with_changes
from soro_core.errors import SoroError
from soro_core.loop import Tick
from soro_core.robot import Link, Robot, load_robot
from soro_core.robot.discretisation import with_basis
from soro_core.robot.parts import fields
from soro_core.twin import Twin
from soro_lab.scene import Scene, load_scene
from soro_lab.scene.loop import loop_of

TITLE = "Mismatch: arms that differ from their file"
LAWS = ("composite", "adaptive")
LAST_S = 5.0

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


@dataclass(frozen=True)
class Outcome:
    """RMS of the tip error of the last seconds, part of the length, its verdict, and the last notes."""

    error: float
    verdict: str
    notes: str


def relinked(robot: Robot, change: Callable[[Link], Mapping[str, Any]]) -> Robot:
    """Return the robot with changed keys of each link."""
    return robot.replace(links=[{**fields(link), **change(link)} for link in robot.links])


def sloped(slope: float, stiffness: float = 1.0, order: int = 0) -> Callable[[Robot], Robot]:
    """Truth with another area slope, part of the bending stiffness, and strains of a Legendre order."""

    def change(link: Link) -> Mapping[str, Any]:
        a4, a5, a6 = link.k_b
        chambers = [{**fields(chamber), "area_slope": slope} for chamber in link.chambers]
        return {"chambers": chambers, "k_b": [stiffness * a4, stiffness * a5, a6]}

    return lambda robot: varying(order)(relinked(robot, change))


def weak(number: int, part: float) -> Callable[[Robot], Robot]:
    """Truth with one chamber of each link that gives a part of its force."""

    def change(link: Link) -> Mapping[str, Any]:
        return {
            "chambers": [scaled(one, part if i == number else 1.0) for i, one in enumerate(link.chambers)]
        }

    return lambda robot: relinked(robot, change)


def scaled(chamber: Any, part: float) -> dict[str, Any]:
    """Return the keys of a chamber that gives a part of the force."""
    found = fields(chamber)
    return {
        k: part * v if k in ("alpha_eps", "alpha_kappa", "area_m2") and v else v for k, v in found.items()
    }


def varying(order: int) -> Callable[[Robot], Robot]:
    """Truth with strains that vary along each link."""
    return lambda robot: with_basis(robot, "legendre", order) if order else robot


def four_chambers() -> Robot:
    """A hanging arm of one link with four chambers at uneven angles."""
    chambers = [
        {"angle_rad": float(np.deg2rad(angle)), "area_m2": 1.2e-4, "offset_m": 0.012}
        for angle in (0.0, 70.0, 170.0, 280.0)
    ]
    link = {
        "length": 0.12,
        "radius": 0.018,
        "mass": 0.08,
        "k_e": [1500.0, 0.0, 0.0],
        "k_b": [0.06, 0.0, 0.0],
        "damping": [0.08, 3e-6, 3e-6],
        "chambers": chambers,
    }
    return Robot(
        name="four_chambers",
        base_quaternion=(1.0, 0.0, 0.0, 0.0),
        pressure_range_pa=(0.0, 90e3),
        links=[link],
    )


def four_uneven(robot: Robot) -> Robot:
    """Truth of `four_chambers`: one weak chamber, strains that vary, creep."""

    def change(link: Link) -> Mapping[str, Any]:
        creep = [{"tau": [0.5], "stiffness": [0.0, 1e-4, 1e-4]}]
        return {
            "chambers": [scaled(c, 0.55 if i == 2 else 1.0) for i, c in enumerate(link.chambers)],
            "creep": creep,
        }

    return varying(1)(relinked(robot, change))


def guessed() -> Robot:
    """The guess with which the identification of the fabric arm begins."""
    return load_robot(Path(__file__).parents[1] / "examples" / "asu_two_segment_guess.yaml")


CASES = (
    Case("standing, area slope -2", 0.007, sloped(-2.0), {**STANDING, **EMPTY}),
    Case("hanging, area slope -2", 0.010, sloped(-2.0), {**HANGING, **EMPTY}),
    Case("hanging, area slope 0", 0.015, sloped(0.0), {**HANGING, **EMPTY}),
    Case("standing, k_b x 0.75, slope 0, order 1, 20 g", 0.02, sloped(0.0, 0.75, 1), WHOLE),
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


def write_robot(robot: Robot, path: Path, keys: Mapping[str, Any] | None = None) -> str:
    """Write the file of a robot, or of some of its keys beside others; return its path."""
    own = robot.model_dump(mode="json", exclude_defaults=True)
    found = own if keys is None else {**keys, "links": own["links"]}
    # Coordinates have the order of the strains.
    path.write_text(yaml.safe_dump(found, sort_keys=False))
    return str(path)


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


def ticks_of(scene: Scene) -> Iterator[Tick[Any, Any]]:
    """Run the loop of a scene in lockstep, without ROS."""
    changes: dict[str, Any] = {"pressures": "regulators", "plant_link": ""}
    if scene.loaded_platform:
        changes["regulator"] = scene.loaded_platform.regulator
    twin = Twin(scene.loaded_robot, with_changes(scene.twin_node(), **changes))
    ticks = round(scene.duration_s * scene.rate_hz)
    return loop_of(scene).run(twin, ticks, twin.dt, before_s=-twin.dt)


def square_of(tick: Tick[Any, Any]) -> float:
    """Return the square of the tip error [m^2]."""
    missed = tick.seen.tip[:3, 3] - tick.command.tip_reference[:3, 3]
    return float(missed @ missed)


def outcome(scene: Scene, say: Callable[[str], None] = lambda text: None) -> Outcome:
    """Run the loop of a scene, and judge its end."""
    notes, squares = "", []
    late = round((scene.duration_s - LAST_S) * scene.rate_hz)
    try:
        for k, tick in enumerate(ticks_of(scene)):
            status = tick.command.status
            notes = "; ".join(filter(None, (status.message, status.note, tick.estimate.status.note)))
            if k >= late:
                squares.append(square_of(tick))
    except SoroError as error:  # the plant of a lost arm has no step any more
        return Outcome(np.inf, "lost", str(error))
    part = float(np.sqrt(np.mean(squares))) / scene.loaded_robot.length
    return Outcome(part, verdict_of(part, scene), notes)


def opening(scene: Scene) -> tuple[list[float], KeptNumbers]:
    """Return the RMS of the tip error, part of the length, in two spans, and what was kept at the end."""
    squares = []
    for tick in ticks_of(scene):
        squares.append(square_of(tick))
    kept = keep(scene.loaded_robot, tick.command.estimates, tick.command.deviations())
    cuts = [round(t * scene.rate_hz) for t in (0.0, *OPENING_S)]
    means = [float(np.mean(squares[a:b])) for a, b in pairwise(cuts)]
    return [float(np.sqrt(mean)) / scene.loaded_robot.length for mean in means], kept


def kept_rows(options: Options) -> list[list[object]]:
    """Return the first seconds of a run alone, and started from what an earlier one has learned."""
    rows = []
    for case in options.pick(KEPT, KEPT[:1]):
        options.say(f"{case.name}, kept")
        with TemporaryDirectory() as folder:
            scene = scene_of(case, "composite", 1, Path(folder))
            _, kept = opening(scene)
            again = with_changes(scene, seed=2, duration_s=OPENING_S[-1])
            found = [opening(one)[0] for one in (again, again.with_learned(kept))]
        row = (f"{100 * value:.2f}" for pair in zip(*found, strict=True) for value in pair)
        rows.append([case.name, *row])
    return rows


def verdict_of(error: float, scene: Scene) -> str:
    """Return the verdict on a tip error, part of the length; bounds of set points are not judged."""
    limits = scene.verdict
    if not error <= limits.tip_error_part:
        return "lost"
    return "good" if error <= limits.good_part else "poor"


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
            f"automatic: tip error RMS of the last {LAST_S:g} s, % of the length. Means of seeds "
            f"{', '.join(map(str, seeds))}; the verdict is that of the tip error alone, the notes are those "
            "of the last tick of the first seed.",
            table(head, rows),
            "Alone, and started from what an earlier run of 12 s has learned (`--learn-from`): tip error "
            "RMS, % of the length, `composite`, seed 2, the earlier run seed 1.",
            table(
                ["case", *(f"{span}, {how}" for span in SPANS for how in ("alone", "started"))],
                kept_rows(options),
            ),
        ]
    )


def cells(found: Sequence[Outcome]) -> list[str]:
    """Return the figures of one law."""
    error = float(np.mean([one.error for one in found]))
    verdicts = "; ".join(sorted({one.verdict for one in found}))
    return [f"{100 * error:.2f}", verdicts, found[0].notes]
