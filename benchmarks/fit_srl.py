"""Find the robot srl_one_segment from its recorded steps.

    python -m benchmarks.fit_srl DATA_FOLDER [--out YAML]

DATA_FOLDER holds step_A_*.csv and step_C_*.csv. The pressure was not recorded, so the fit looks at figures
that hardly depend on how it rose: how far the tip is at the end of a fill, and frequency and damping ratio of
each sound ring-down. The chamber is of rubber: its area grows with the pressure, (57) of docs/model.md. Runs
that `is_held_out` names are not read into the fit.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import yaml
from scipy.optimize import least_squares

from benchmarks.tip_steps import (
    TipRun,
    are_sound,
    end_of,
    is_held_out,
    place_of,
    plane_of,
    read_tip_run,
    rings,
    shown,
    swung,
)
from soro_core import SoftArm, load_robot
from soro_core.errors import SoroError
from soro_core.robot import Robot
from soro_core.robot.parts import fields
from soro_lab.identification.arm.cases.parameters import with_numbers

GUESS = Path("examples/srl_guess.yaml")
MAPS = {"step_A": "srl_step_a", "step_C": "srl_step_c"}
DOWN = np.array([1.0, 0.0, 0.0])
# Expected relative errors of a displacement, and of frequency and damping ratio: the goals on unseen runs.
MOVED, RING = 0.06, np.array([0.03, 0.09])
# Where the search begins; each number is searched by its logarithm. `force`: gain over k_b.
START = {
    "force": 3.0,
    "k_b": 0.22,
    "dead_band": 2400.0,
    "damping_b": 6e-6,
    "swell": 1.5e-5,
}
# A candidate that cannot be simulated, or does not ring, is so many expected errors off.
HOPELESS = 30.0


def numbers(x: np.ndarray) -> dict[str, float]:
    """Return the numbers of a robot for a candidate (n,), 1 at the start."""
    found = {key: value * float(np.exp(v - 1.0)) for (key, value), v in zip(START.items(), x, strict=True)}
    found["gain"] = found.pop("force") * found["k_b"]
    return {f"link0/{key}": value for key, value in found.items()}


def certainty(x: np.ndarray, jac: np.ndarray) -> list[str]:
    """Return a line a number: value and deviation, by derivatives of the errors (m, n) at x (n,)."""
    rows, cover = [], np.linalg.inv(jac.T @ jac)
    for name, value in numbers(x).items():
        slope = np.array([np.log(numbers(x + 1e-3 * unit)[name] / value) / 1e-3 for unit in np.eye(len(x))])
        rows.append(f"{name} {value:.4g} +- {100 * np.sqrt(slope @ cover @ slope):.2g} %")
    return rows


class Tracker:
    """Runs of one tracker, and what is measured of them."""

    def __init__(self, runs: list[TipRun]) -> None:
        self.runs, self.plane = runs, plane_of(runs, DOWN)
        self.sound = [are_sound(r.t, self.plane.seen(r)[:, 0], r.levels) for r in runs]
        self.measured = [figures(run, self.plane.seen(run)) for run in runs]
        # Near collapse a small error of the pressure, which is the commanded one, moves the tip far.
        top = np.log([max(p for _, p in run.levels.steps) for run in runs])
        far = np.log([np.linalg.norm(end) for end, _ in self.measured])
        self.leverage = np.maximum(np.gradient(far, top), 1.0)

    @property
    def size(self) -> int:
        """Number of errors."""
        return sum(2 + 2 * sum(sound) for sound in self.sound)

    def errors(self, arm: SoftArm) -> list[float]:
        """Return the errors of an arm in parts of the expected ones."""
        paths = [swung(arm, run.levels, float(run.t[-1])) for run in self.runs]
        place = place_of(arm, self.runs, paths, self.plane)
        found: list[float] = []
        for run, path, seen, sound, leverage in zip(
            self.runs, paths, self.measured, self.sound, self.leverage, strict=True
        ):
            end, swings = figures(run, shown(arm, path, run.t, place))
            apart = (end - seen[0]) / np.linalg.norm(seen[0]) / MOVED / leverage
            found += list(apart)
            ring = (np.log(swings / seen[1]) / RING)[sound]
            found += list(np.nan_to_num(ring, nan=HOPELESS).ravel())
        return list(np.clip(found, -HOPELESS, HOPELESS))


def figures(run: TipRun, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the end of the fill (2,) [m], and frequency and ratio of each step (steps, 2)."""
    return end_of(run.t, moved, run.levels), np.array(rings(run.t, moved[:, 0], run.levels))


def fitted_runs(folder: Path, columns: str, start: str, robot: Robot) -> list[TipRun]:
    """Read the runs of a tracker that are not held out."""
    runs = [read_tip_run(file, columns, robot) for file in sorted(folder.glob(f"{start}_*.csv"))]
    top = {run.name: max(p for _, p in run.levels.steps) for run in runs}
    return [run for run in runs if not is_held_out(top, run.name)]


def plain(value: object) -> object:
    """Lists and plain numbers, as YAML writes them."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def main() -> None:
    """Fit, print, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path, help="folder with step_A_*.csv and step_C_*.csv")
    parser.add_argument("--out", type=Path, default=Path("srl_one_segment.yaml"))
    arguments = parser.parse_args()
    robot = load_robot(GUESS)
    trackers = [Tracker(fitted_runs(arguments.data, name, part, robot)) for part, name in MAPS.items()]

    def residuals(x: np.ndarray) -> np.ndarray:
        try:
            arm = SoftArm(with_numbers(robot, numbers(x)))
            return np.concatenate([tracker.errors(arm) for tracker in trackers])
        except SoroError:
            return np.full(sum(tracker.size for tracker in trackers), HOPELESS)

    x0 = np.ones(len(START))
    found = least_squares(residuals, x0, diff_step=4e-3, loss="soft_l1", x_scale=0.1, ftol=1e-6)
    lines = [f"cost {found.cost:.2f} of {found.fun.size} errors", *certainty(found.x, found.jac)]
    print("\n".join(lines))
    keys = fields(with_numbers(robot, numbers(found.x)))
    keys["links"] = [plain(link) for link in keys["links"]]
    body = yaml.safe_dump(plain(keys), sort_keys=False, default_flow_style=None, width=110)
    arguments.out.write_text("".join(f"# {line}\n" for line in lines) + body, encoding="utf-8")


if __name__ == "__main__":
    main()
