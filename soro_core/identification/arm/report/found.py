"""The part of a report on the numbers: values, laws, correlations, profiles, what is open, frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from soro_core.identification.arm.physical import Unphysical
from soro_core.identification.arm.predict import tracker
from soro_core.identification.arm.profile import Profile
from soro_core.identification.arm.stages import Identified
from soro_core.identification.arm.written import experiment, marks, origin


def numbers_of(found: Identified, unphysical: Sequence[Unphysical]) -> list[dict[str, Any]]:
    """Return an entry for each number.

    Parameters
    ----------
    found : Identified
    unphysical : sequence of Unphysical
    """
    sure = found.certainty
    return [
        {
            "name": n.name,
            "value": found.solution.values[n.name],
            "unit": n.unit,
            "kind": n.kind,
            "deviation": None if "at its bound" in marks(n.name, found, ()) else sure.deviations[n.name],
            "prior": n.value,
            "prior_deviation": n.doubt,
            "lower": n.lower,
            "upper": n.upper,
            "origin": origin(n.name, found),
            "marks": list(marks(n.name, found, unphysical)),
        }
        for n in found.problem.numbers
    ]


def correlation_of(found: Identified) -> dict[str, Any]:
    """Return the names and the matrix of the correlations."""
    return {
        "names": [n.name for n in found.problem.numbers],
        "matrix": np.round(found.certainty.correlation, 4).tolist(),
    }


def laws_of(found: Identified) -> list[dict[str, Any]]:
    """Return each set of laws that was tried, with the standard error of its difference to the best."""
    if found.choice is None:
        return []
    best = min(found.choice.tried, key=lambda trial: trial.error)
    rows = []
    for trial in found.choice.tried:
        apart = np.subtract(trial.squares, best.squares)
        spread = float(apart.std(ddof=1) / np.sqrt(len(apart))) if len(apart) > 1 else 0.0
        rows.append(
            {
                "name": trial.name,
                "error": trial.error,
                # Of the mean square, carried over to its root.
                "standard_error": spread / (2.0 * trial.error) if trial.error > 0.0 else 0.0,
                "stretches": len(trial.squares),
                "chosen": trial is found.choice.chosen,
                "interrupted": trial.interrupted,
            }
        )
    return rows


def profiles_of(profiles: Sequence[Profile]) -> list[dict[str, Any]]:
    """Return each profile."""
    return [
        {
            "name": each.name,
            "simulated": each.is_searched,
            "points": [{"at": p.at, "rise": p.rise, "rise_of_data": p.of_data} for p in each.points],
            "below": each.below,
            "above": each.above,
            "text": each.text,
        }
        for each in profiles
    ]


def undetermined_of(found: Identified) -> list[dict[str, Any]]:
    """Return each number that the data leave open, the combinations, and an experiment."""
    return [
        {"name": name, "open": list(found.kept[name]), "experiment": experiment(name)} for name in found.kept
    ]


def frames_of(found: Identified) -> dict[str, Any]:
    """Return where the tracker stands, and how bodies and cameras sit."""
    values = found.solution.values
    frames = {name: value for name, value in values.items() if name.startswith("frame/")}
    turn, place = tracker(frames)
    names = dict.fromkeys(name.split("/")[1] for name in frames)
    result: dict[str, Any] = {"tracker": None, "bodies": [], "cameras": []}
    if "tracker" in names:
        own = _three(frames, "tracker/turn")
        result["tracker"] = {
            "position_m": place.tolist(),
            "rotation_vector_rad": own,
            "rotation": turn.tolist(),
        }
    for name in names:
        if name == "tracker":
            continue
        if f"frame/{name}/turn" in frames:
            result["cameras"].append(
                {
                    "name": name,
                    "turn_rad": frames[f"frame/{name}/turn"],
                    "curvature_per_m": [frames[f"frame/{name}/offset_{axis}"] for axis in "xy"],
                }
            )
        else:
            result["bodies"].append(
                {
                    "name": name,
                    "offset_m": _three(frames, f"{name}/offset"),
                    "rotation_vector_rad": _three(frames, f"{name}/turn"),
                }
            )
    return result


def _three(frames: dict[str, float], name: str) -> list[float] | None:
    if f"frame/{name}_x" not in frames:
        return None
    return [frames[f"frame/{name}_{axis}"] for axis in "xyz"]
