"""First guesses of an arm's numbers from what a controlled run has learned of it."""

from __future__ import annotations

from collections import defaultdict
from statistics import fmean

import numpy as np

from soro_core.adaptation.damping import LEAST_PART, damping_model
from soro_core.adaptation.kept import KeptNumbers
from soro_core.adaptation.scales import FORCE_PART
from soro_core.model import SoftArm
from soro_core.robot import Robot
from soro_lab.identification.arm.cases.parameters import numbers_of, with_numbers

# A smaller part of the described stiffness is no guess: load and gravity are in W too.
_LEAST_PART = 0.2


def with_learned(robot: Robot, kept: KeptNumbers, where: str = "learned") -> Robot:
    """Return the robot with learned gains, area slopes, stiffness and damping as its numbers.

    The slope of the learned force by a coordinate itself counts as stiffness. Other entries of W, and the
    load, have no number in a robot file.

    Parameters
    ----------
    robot : Robot
        As its file describes it.
    kept : KeptNumbers
    where : str
        File of the numbers, for the error.

    Raises
    ------
    ConfigError
        If they were learned of another robot, or with its links divided.
    """
    kept.require_robot(robot, where)
    learned = defaultdict(float, {name: value for name, (value, _) in kept.numbers.items()})
    present, values = numbers_of(robot), dict[str, float]()
    stiffness = dict(
        zip(robot.coordinate_names, np.diag(damping_model(SoftArm(robot)).matrix).tolist(), strict=True)
    )
    for index, link in enumerate(robot.links):
        name = f"link{index}"
        for key in ("e", "b"):
            own = [
                f"{name}/{s}" for s in link.strains if s.startswith({"e": "elongation", "b": "bending"}[key])
            ]
            if own:
                part = 1.0 + FORCE_PART * fmean(learned[f"{strain}/by {strain}"] for strain in own)
                # Retardation times are those beside the file's damping, with the file's stiffness.
                time_s = learned[f"{name}/{'stretch' if key == 'e' else 'bend'}_damping"]
                damping = present[f"{name}/damping_{key}"].value
                values[f"{name}/damping_{key}"] = max(
                    damping + time_s * stiffness[own[0]], LEAST_PART * damping
                )
                values[f"{name}/k_{key}"] = max(part, _LEAST_PART) * present[f"{name}/k_{key}"].value
        gains = [1.0 + learned[f"{name}/chamber{j}/gain"] for j in range(len(link.chambers))]
        if gains:
            values[f"{name}/gain"] = gains[0]
            values |= {f"{name}/chamber{j}/gain": gains[j] / gains[0] for j in range(1, len(gains))}
            slope = f"{name}/area_slope"
            if slope in present:  # a muscle has none: the law of its braid is kept
                values[slope] = present[slope].value + learned[slope]
    return with_numbers(robot, values)
