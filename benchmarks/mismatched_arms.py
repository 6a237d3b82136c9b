"""Arms whose truth differs from the file in structure, drawn at random: are they held, or well judged?"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.judged_loop import Outcome, outcome
from benchmarks.mismatched_robots import relinked, scaled, varying, write_robot
from benchmarks.options import Options
from benchmarks.report import table
from benchmarks.timing import all_cores
from soro_core import SoftArm
from soro_core.adaptation.chamber_gains import NAMED_PART
from soro_core.config import with_changes
from soro_core.errors import SoroError
from soro_core.jobs import Executor, executor_of, map_jobs
from soro_core.robot import Robot, load_robot
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix, rotation_exp
from soro_lab.scene import Scene, load_scene
from soro_ros.recordings.report import WINDOW_S
from soro_ros.study.closed_loop import ticks_of

# Bounds of what is drawn: relative gains; area slope; parts of the bending stiffness in a creep branch and in
# a Dahl element, time of the first [s] and range of the second [1/m]; tilt [deg]; payload [kg]; curvature of
# the circle [1/m].
GAIN, SLOPE = (0.5, 1.5), (-6.0, 0.0)
CREEP, CREEP_S, DAHL, DAHL_RANGE = (0.0, 0.2), (0.1, 2.0), (0.0, 0.5), (0.3, 1.5)
TILT_DEG, PAYLOAD_KG, CURVATURE = (0.0, 3.0), (0.0, 0.02), (4.0, 8.0)
MEAN_PA = 30e3
# Time of the law behind the probe.
LAW_S = 20.0
# A chamber that is named is at least this far from the middle one.
LEAST_APART = 0.1
# What a probe finds that is wrong here; a tilt that it finds is at least so large.
_WRONG_FINDINGS = ("chambers are", "the load has changed", "in directions", "set points act", "are stamped")
_LEAST_TILT_DEG = 1.5
_CHAMBER = re.compile(r"(link\d+/chamber\d+) gives ([\d.]+) of the force")
# Words of the causes that may be true here; any other one is wrong.
_KINDS = {
    "limit": ("holds set points back", "pressure saturated", "limits.rise_pa_s"),
    "load": ("fallen over", "an elongation"),
    "file": ("differs from its robot file", "swings about", "at its bound", "NIS", "estimated tip is"),
}


@dataclass(frozen=True)
class Drawn:
    """One arm.

    Attributes
    ----------
    robot : str
        What the controller has.
    gain : tuple of float
        Of each chamber, by their mean.
    slope, order, creep, creep_s, dahl, dahl_range : float
        As the bounds above have them; order of the Legendre polynomials.
    tilt_deg : tuple of float
        About the x and y axes [deg].
    payload_kg, curvature_per_m : float
    """

    robot: str
    gain: tuple[float, ...]
    slope: float
    order: int
    creep: float
    creep_s: float
    dahl: float
    dahl_range: float
    tilt_deg: tuple[float, float]
    payload_kg: float
    curvature_per_m: float


def drawn(number: int) -> Drawn:
    """Return one arm; the number is the seed. Odd ones stand, the others hang."""
    rng = np.random.default_rng(number)
    gain = np.zeros(3)
    while not (np.min(gain) >= GAIN[0] and np.max(gain) <= GAIN[1]):
        gain = rng.uniform(*GAIN, 3)
        gain /= gain.mean()
    tilt, towards = rng.uniform(*TILT_DEG), rng.uniform(0.0, 2.0 * np.pi)
    return Drawn(
        robot="tue_three_bellow" if number % 2 else "three_bellow_hanging",
        gain=tuple(gain.tolist()),
        slope=rng.uniform(*SLOPE),
        order=int(rng.integers(3)),
        creep=rng.uniform(*CREEP),
        creep_s=rng.uniform(*CREEP_S),
        dahl=rng.uniform(*DAHL),
        dahl_range=rng.uniform(*DAHL_RANGE),
        tilt_deg=(tilt * np.cos(towards), tilt * np.sin(towards)),
        payload_kg=rng.uniform(*PAYLOAD_KG),
        curvature_per_m=rng.uniform(*CURVATURE),
    )


def truth(arm: Drawn, robot: Robot) -> Robot:
    """Return the true robot."""
    stiffness = float(SoftArm(robot).stiffness_matrix(np.zeros(3))[1, 1])

    def changed(link: Any) -> dict[str, Any]:
        creep = {"tau": [arm.creep_s], "stiffness": [0.0, arm.creep * stiffness, arm.creep * stiffness]}
        chambers = [
            {**scaled(chamber, gain), "area_slope": arm.slope}
            for chamber, gain in zip(link.chambers, arm.gain, strict=True)
        ]
        dahl = {"stiffness": [0.0, arm.dahl * stiffness, arm.dahl * stiffness], "range": [arm.dahl_range] * 3}
        # A Dahl element acts on a constant strain alone.
        hysteresis = [] if arm.order else [dahl]
        return {"chambers": chambers, "creep": [*link.creep, creep], "hysteresis": hysteresis}

    turned = matrix_from_quaternion(np.array(robot.base_quaternion)) @ rotation_exp(
        np.radians([*arm.tilt_deg, 0.0])
    )
    found = varying(arm.order)(relinked(robot, changed))
    return found.replace(base_quaternion=tuple(quaternion_from_matrix(turned).tolist()))


def scene_of(arm: Drawn, number: int, folder: Path, known: bool = False) -> Scene:
    """Return the scene of an arm; `known`: its controller has the true file."""
    robot = load_robot(arm.robot)
    true = truth(arm, robot)
    base = write_robot(robot, folder / "robot.yaml")
    keys = {"based_on": "robot.yaml", "base_quaternion": list(true.base_quaternion)}
    plant = write_robot(true, folder / "plant.yaml", keys)
    return load_scene(
        "track_circle",
        {
            "platform": "",
            "mode": "lockstep",
            "robot": plant if known else base,
            "twin.plant": plant,
            "twin.payload_kg": arm.payload_kg,
            "duration_s": LAW_S,
            "controller.gains": "auto",
            "controller.probe_at_enable": "warn",
            "controller.reference.curvature_per_m": arm.curvature_per_m,
            "controller.reference.mean_pressure_pa": MEAN_PA,
            "seed": number,
        }
        | ({"twin.refine": 1} if arm.order else {}),
    )


@dataclass(frozen=True)
class Judged:
    """One arm with what was said of it.

    Attributes
    ----------
    found : Outcome
    right, wrong : tuple of str
        True causes that it names, and other ones.
    refused : bool
        Whether the probe refuses it where it does not only warn.
    """

    found: Outcome
    right: tuple[str, ...]
    wrong: tuple[str, ...]
    refused: bool = False


def measured(number: int, known: bool = False) -> Outcome:
    """Run one arm; `known`: with the true file."""
    with TemporaryDirectory() as folder:
        return outcome(scene_of(drawn(number), number, Path(folder), known))


def is_refused(number: int) -> bool:
    """Whether the probe refuses an arm by default in real time."""
    with TemporaryDirectory() as folder:
        scene = scene_of(drawn(number), number, Path(folder))
        control = with_changes(scene.controller, probe_at_enable="refuse")
        try:
            for tick in ticks_of(with_changes(scene, controller=control)):
                if tick.command is not None and tick.command.terms is not None:  # the law has begun
                    return False
        except SoroError:
            return True
    return True


def judged(number: int) -> Judged:
    """Run one arm, and sort the causes that it names: a right one is what makes the run bad."""
    found, refused = measured(number), is_refused(number)
    text = "; ".join((found.verdict.reason, *found.verdict.notes))
    said = dict.fromkeys(_CHAMBER.findall(text))
    gain = drawn(number).gain
    right, wrong = [], []
    for name, ratio in said:
        true = gain[int(name[-1])] / float(np.median(gain))
        near = (float(ratio) - 1.0) * (true - 1.0) > 0.0 and abs(true - 1.0) > LEAST_APART
        (right if near else wrong).append(f"{name} at {ratio}")
    wrong += [f"probe: {words}" for words in _WRONG_FINDINGS if words in text]
    if "base were tilted" in text and np.linalg.norm(drawn(number).tilt_deg) < _LEAST_TILT_DEG:
        wrong.append("probe: tilted")
    if found.verdict.word == "good":
        return Judged(found, tuple(right), tuple(wrong), refused)
    cause = found.verdict.reason.partition("probable cause: ")[2].partition("; next:")[0]
    if cause and not _CHAMBER.search(cause):
        (right if is_true(cause, number) else wrong).append(cause)
    return Judged(found, tuple(right), tuple(wrong), refused)


def is_true(cause: str, number: int) -> bool:
    """Whether a cause that names no chamber is true: of the file, of a limit or of the load.

    With the true file the run is good where the file was the cause, and bad where it was another one.
    """
    kind = next((kind for kind, words in _KINDS.items() if any(word in cause for word in words)), "")
    if not kind:
        return False
    is_good = measured(number, known=True).verdict.word == "good"
    if kind == "file":
        # A chamber would have to be named.
        return is_good and _apart(drawn(number).gain) < NAMED_PART
    return not is_good


def _apart(gain: Sequence[float]) -> float:
    """Return how far the chamber is from the middle one that is furthest."""
    return float(np.max(np.abs(np.array(gain) / np.median(gain) - 1.0)))


def _all(numbers: Sequence[int], executor: Executor, say: Callable[[str], None]) -> Iterator[Judged]:
    """Yield the arms in their order; each core has one of them at a time."""
    with closing(map_jobs(judged, numbers, executor)) as every:
        for number, found in zip(numbers, every, strict=True):
            causes = f"right: {', '.join(found.right)}; wrong: {', '.join(found.wrong)}"
            say(f"random arm {number}: {100 * found.found.error:.2f} %, {found.found.verdict.word}; {causes}")
            yield found


def run(options: Options) -> str:
    """Measure the first of the arms and return text and table."""
    with all_cores(), executor_of(options.jobs, options.dask) as executor:
        return written(list(_all(range(1, options.pick(options.arms, 1) + 1), executor, options.say)))


def written(found: Sequence[Judged]) -> str:
    """Return text and table of some arms."""
    errors = 100.0 * np.array([one.found.error for one in found])
    words = [one.found.verdict.word for one in found]
    middle, most, worst = np.quantile(errors, [0.5, 0.95, 1.0], method="lower")
    moved = [100.0 * one.found.configured for one in found if np.isfinite(one.found.configured)]
    bad = [one for one in found if one.found.verdict.word != "good"]
    text = (
        "Arms drawn evenly, each half of them standing and hanging: gains of chambers by their mean "
        f"{GAIN[0]:g} to {GAIN[1]:g}; area slope {SLOPE[0]:g} to {SLOPE[1]:g} (the file: -4.6); strains of "
        f"Legendre order 0 to 2; a creep branch of up to {CREEP[1]:.0%} of the bending stiffness, "
        f"{CREEP_S[0]:g} to {CREEP_S[1]:g} s; at order 0 a Dahl element of up to {DAHL[1]:.0%}, range "
        f"{DAHL_RANGE[0]:g} to {DAHL_RANGE[1]:g} 1/m; base tilted by up to {TILT_DEG[1]:g} degrees; up to "
        f"{1e3 * PAYLOAD_KG[1]:g} g; a circle of {CURVATURE[0]:g} to {CURVATURE[1]:g} 1/m about "
        f"{1e-3 * MEAN_PA:g} kPa. `composite`, {LAW_S:g} s behind the probe, which is on by "
        f"default in real time; tip error RMS of the last {WINDOW_S:g} s. The probe is at `warn`: the law "
        "drives each arm (`soro enable --anyway`), and begins with the gains that the probe has measured. "
        "`refused` are those that the default, `refuse`, does not let begin: it names the cause instead.\n\n"
        f"A named chamber is right if its true gain is more than {LEAST_APART:.0%} from the middle one of "
        "its link, on that side. Any other cause of a bad run is right if it is one of the file, the same "
        f"run with the true file is good, and no chamber is more than {NAMED_PART:.0%} off, or if it is a "
        "limit or a load, and the run with the true file is bad, too. Of what the probe finds, any wiring, "
        f"load, delay or stamp is wrong, and a tilt if the true one is below {_LEAST_TILT_DEG:g} degrees."
    )
    head = [
        "arms",
        "median, %",
        "95 % below, %",
        "worst, %",
        "good",
        "poor",
        "lost or vented",
        "refused",
        "refused without a right cause",
        "with a right cause",
        "with a wrong cause",
        "poor without a right one",
        "lost without a right one",
        "circle chosen anew",
        "worst of these to the configured circle, %",
    ]
    row = [
        str(len(found)),
        *(f"{value:.2f}" for value in (middle, most, worst)),
        *(str(words.count(word)) for word in ("good", "poor")),
        str(sum(word not in ("good", "poor") for word in words)),
        str(sum(one.refused for one in found)),
        str(sum(one.refused and not one.right for one in found)),
        str(sum(bool(one.right) for one in found)),
        str(sum(bool(one.wrong) for one in found)),
        str(sum(one.found.verdict.word == "poor" and not one.right for one in bad)),
        str(sum(one.found.verdict.word != "poor" and not one.right for one in bad)),
        str(len(moved)),
        f"{max(moved):.2f}" if moved else "",
    ]
    return f"{text}\n\n{table(head, [row])}"
