"""The part of a report on the numbers: values, laws, correlations, profiles, what is open, frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from soro_lab.identification.arm.cases.physical import Unphysical
from soro_lab.identification.arm.robot_yaml import experiment, marks, origin
from soro_lab.identification.arm.search.profile import Profile
from soro_lab.identification.arm.stages import ArmIdentification
from soro_lab.identification.recording.streams import Attitude, Curvature, Marker, Plate


def numbers_of(found: ArmIdentification, unphysical: Sequence[Unphysical]) -> list[dict[str, Any]]:
    """Return an entry for each number."""
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


def correlation_of(found: ArmIdentification) -> dict[str, Any]:
    """Return the names and the matrix of the correlations."""
    return {
        "names": [n.name for n in found.problem.numbers],
        "matrix": np.round(found.certainty.correlation, 4).tolist(),
    }


def laws_of(found: ArmIdentification) -> list[dict[str, Any]]:
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


def undetermined_of(found: ArmIdentification) -> list[dict[str, Any]]:
    """Return each number that the data leave open, the combinations, and an experiment."""
    return [
        {"name": name, "open": list(found.kept[name]), "experiment": experiment(name)} for name in found.kept
    ]


def frames_of(found: ArmIdentification) -> dict[str, Any]:
    """Return where trackers and the worlds of IMUs stand, and how bodies and cameras sit."""
    values = found.solution.values
    seen = {shape.name: shape for case in found.problem.cases for shape in case.shapes}
    frames = dict.fromkeys(s.frame for s in seen.values() if isinstance(s, Plate | Marker))
    return {
        "worlds": [
            *(_placed(frame, f"{frame}/offset", f"{frame}/turn", values) for frame in frames),
            *(_placed(n, "", f"{n}/world", values) for n, s in seen.items() if isinstance(s, Attitude)),
        ],
        "bodies": [
            _placed(name, f"{name}/offset", f"{name}/turn", values)
            for name, shape in seen.items()
            if isinstance(shape, Plate | Marker | Attitude)
        ],
        "cameras": [
            {
                "name": name,
                "turn_rad": values[f"frame/{name}/turn"],
                "curvature_per_m": [values[f"frame/{name}/offset_{axis}"] for axis in "xy"],
            }
            for name, shape in seen.items()
            if isinstance(shape, Curvature)
        ],
    }


def _placed(name: str, offset: str, turn: str, values: Mapping[str, float]) -> dict[str, Any]:
    return {"name": name, "offset_m": _three(values, offset), "rotation_vector_rad": _three(values, turn)}


def _three(frames: Mapping[str, float], name: str) -> list[float] | None:
    if f"frame/{name}_x" not in frames:
        return None
    return [frames[f"frame/{name}_{axis}"] for axis in "xyz"]
