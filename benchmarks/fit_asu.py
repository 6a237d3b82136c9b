"""Find the robot asu_two_segment from its recorded runs: `python -m benchmarks.fit_asu DATA_FOLDER`.

DATA_FOLDER holds 2023_*.csv. Pressures are replayed; the places of the middle and of the tip plate, and the
lengths of both segments, are compared, each run as much as every other. Runs of even number are not read into
the fit, nor those in which a sensor froze, nor those whose set points never change (`identified_asu`).

Weights show little of the size of an area, so the area of the first chamber of each link stays as described.
Damping is one retardation time of 1 s: more, in an arm that moves this slowly, is creep.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from benchmarks.identified_asu import (
    ROBOT,
    cells,
    differences,
    is_driven,
    is_frozen,
    is_held_out,
    rms,
    squares,
)
from soro_core import SoftArm, load_robot
from soro_core.arrays import Array
from soro_core.errors import SoroError
from soro_core.jobs import Threads, map_jobs
from soro_core.robot import Robot
from soro_lab.identification.arm.cases.parameters import ArmParameter, numbers_of, with_numbers
from soro_lab.identification.recording import Recording, read_csv

GUESS = Path("examples/asu_two_segment_guess.yaml")
# Friction of the fabric against bending; where the search of it begins. Friction of elongation predicts other
# runs of the sessions in the fit, but no other session.
DAHL = {"dahl_b": 0.3, "dahl_b_range": 1.0}
SEARCHED = ("k_e", "k_b", "area_slope", "chamber1/gain", "chamber2/gain", *DAHL)
# Expected errors of tip and middle plate, and of the lengths of both segments [m].
EXPECTED = (0.015, 0.015, 0.005, 0.004)
# Doubt about a number over that of `soro identify`: a run is one witness here, and not its many samples.
DOUBT = 1.5
RETARDATION_S = 1.0
# Each error of a candidate that cannot be simulated, in expected errors.
HOPELESS = 30.0


def damped(robot: Robot) -> Robot:
    """Return the robot with the damping of its retardation time, from its stiffness at rest."""
    found, values = numbers_of(robot), {}
    for index, link in enumerate(robot.links):
        for key in "eb":
            rest = found[f"link{index}/k_{key}"].value * link.length**2
            values[f"link{index}/damping_{key}"] = RETARDATION_S * rest
    return with_numbers(robot, values)


def changed(robot: Robot, numbers: Sequence[ArmParameter], x: Array) -> Robot:
    """Return the robot whose numbers are off by `x` (n,), in doubts."""
    step = DOUBT * x
    values = {
        n.name: n.value * float(np.exp(v * n.doubt)) if n.kind == "factor" else n.value + float(v) * n.doubt
        for n, v in zip(numbers, step, strict=True)
    }
    return damped(with_numbers(robot, values))


def errors(arm: SoftArm, recording: Recording) -> Array:
    """Return the errors of a run in expected ones: the sum of their squares is four means."""
    parts = zip(differences(arm, recording), EXPECTED, strict=True)
    return np.concatenate([(off / size).ravel() / np.sqrt(len(off)) for off, size in parts])


def fit(robot: Robot, numbers: Sequence[ArmParameter], runs: Sequence[Recording]) -> OptimizeResult:
    """Return the result of least squares; its `x` (n,) is what `changed` takes."""
    size = sum(errors(SoftArm(damped(robot)), run).size for run in runs)

    def residuals(x: Array) -> Array:
        try:
            arm = SoftArm(changed(robot, numbers, x))
            parts = list(map_jobs(partial(errors, arm), runs, threads))
        except SoroError:
            return np.full(size + len(x), HOPELESS)
        return np.concatenate([*parts, x])

    with Threads() as threads:
        return least_squares(
            residuals, np.zeros(len(numbers)), diff_step=1e-3, x_scale=0.3, ftol=1e-4, max_nfev=30
        )


def session(name: str) -> str:
    """Return the day of a run."""
    return re.match(r"2023_([a-z]+_?\d+)_", name)[1]  # type: ignore[index]


def by_session(robot: Robot, numbers: Sequence[ArmParameter], runs: Sequence[Recording]) -> None:
    """Print the error of each session by a fit to all others, their spread, and that of all runs."""
    found, days = list[Array](), list[float]()
    for day in dict.fromkeys(session(run.name) for run in runs):
        others = [run for run in runs if session(run.name) != day]
        arm = SoftArm(changed(robot, numbers, fit(robot, numbers, others).x))
        own = [squares(arm, run) for run in runs if session(run.name) == day]
        found += own
        days.append(float(rms(own)[0]))
        print(f"{day}: {', '.join(cells(rms(own)))}")
    middle, spread = 1e3 * np.mean(days), 1e3 * np.std(days, ddof=1)
    print(f"tip of a session: {middle:.0f} mm, deviation between sessions {spread:.0f} mm")
    print(f"all: {', '.join(cells(rms(found)))}  (tip, length 0 and 1 in mm)")


def main() -> None:
    """Fit, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path, help="folder with 2023_*.csv")
    parser.add_argument(
        "--by-session",
        action="store_true",
        help="leave each session out in turn, of even and odd runs, and print its error",
    )
    arguments = parser.parse_args()
    guess = load_robot(GUESS)
    robot = with_numbers(guess, {f"link{i}/{key}": v for i in (0, 1) for key, v in DAHL.items()})
    numbers = [n for n in numbers_of(robot).values() if n.name.split("/", 1)[1] in SEARCHED]
    read = (read_csv(file, ROBOT, robot) for file in sorted(arguments.data.glob("2023_*.csv")))
    runs = [run for run in read if is_driven(run) and not is_frozen(run)]
    if arguments.by_session:
        by_session(robot, numbers, runs)
        return
    runs = [run for run in runs if not is_held_out(run.name)]
    print(f"{len(runs)} runs: {', '.join(run.name for run in runs)}")
    found = fit(robot, numbers, runs)
    print(f"{found.nfev} steps, cost {found.cost:.2f}")
    best = changed(robot, numbers, found.x)
    spread = DOUBT * np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    for number, x, part in zip(numbers, found.x, spread, strict=True):
        step, size = DOUBT * float(x) * number.doubt, float(part) * number.doubt
        if number.kind == "factor":
            print(f"{number.name} {number.value * np.exp(step):.4g} +- {100 * size:.2g} %")
        else:
            print(f"{number.name} {number.value + step:.4g} +- {size:.2g}")
    for link in best.links:
        stiffness = f"k_e: [{link.k_e[0]:.4g}, 0.0, 0.0]  k_b: [{link.k_b[0]:.4g}, 0.0, 0.0]"  # type: ignore[index]
        print(f"{stiffness}  damping: [{', '.join(f'{d:.4g}' for d in link.damping)}]")
        for h in link.hysteresis:
            parts = (
                f"{key}: [{', '.join(f'{v:.4g}' for v in getattr(h, key))}]" for key in ("stiffness", "range")
            )
            print(f"  hysteresis: {', '.join(parts)}")
        for c in link.chambers:
            area = f"alpha_eps: {c.alpha_eps:.4e}" if c.area_m2 is None else f"area_m2: {c.area_m2:.4e}"
            print(f"  {area}, area_slope: {c.area_slope:.4g}")


if __name__ == "__main__":
    main()
