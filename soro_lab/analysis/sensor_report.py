"""Numbers of `soro place-sensors`: rows of its table, all of them for a JSON file, keys of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from soro_core.robot.coordinates import strain_fields
from soro_lab.analysis.problem import Placement
from soro_lab.analysis.sensors import SensorCandidate


@dataclass(frozen=True)
class PlacementStep:
    """What the sensors up to one of them give.

    Attributes
    ----------
    sensor : SensorCandidate or None
        The last of them; None without any.
    value : float
        Their information [nat].
    smallest : float
        Smallest eigenvalue of their scaled Gramian.
    tip_m : float
        Deviation of the tip [m].
    worst : str
        The coordinate that is known least, against what is known of it without sensors.
    worst_std : float
        Its deviation, in its unit.
    """

    sensor: SensorCandidate | None
    value: float
    smallest: float
    tip_m: float
    worst: str
    worst_std: float


def steps(placement: Placement) -> list[PlacementStep]:
    """Return what no sensor gives, the first one, the first two, and so on."""
    names, n = placement.arm.robot.coordinate_names, placement.arm.n_q
    information, found = placement.information, []
    _, alone = information.deviations(())
    for k in range(len(placement.chosen) + 1):
        chosen = placement.chosen[:k]
        tip_m, deviation = information.deviations(chosen)
        worst = int(np.argmax(deviation[:n] / alone[:n]))
        sensor = placement.candidates[chosen[-1]] if chosen else None
        value = information.value(chosen) if chosen else 0.0
        smallest = information.smallest(chosen) if chosen else 0.0
        found.append(PlacementStep(sensor, value, smallest, tip_m, names[worst], float(deviation[worst])))
    return found


def place_text(placement: Placement, s: float) -> tuple[str, str]:
    """Return the link of a place, and its distance from the base of the arm [mm]."""
    ends = np.cumsum([link.length for link in placement.arm.robot.links])
    return f"link{int(np.searchsorted(ends, s - 1e-9))}", f"{1e3 * s:.1f}"


def step_rows(placement: Placement) -> list[tuple[str, ...]]:
    """Return the rows of the table."""
    rows: list[tuple[str, ...]] = []
    before, fields = 0.0, strain_fields(placement.arm.robot)
    names = placement.arm.robot.coordinate_names
    for k, step in enumerate(steps(placement)):
        unit = "" if fields.stretch[names.index(step.worst)] else " 1/m"
        known = (f"{1e3 * step.tip_m:.3g}", f"{step.worst}: {step.worst_std:.2g}{unit}")
        if step.sensor is None:
            rows.append(("-", "none", "", "", "", "", *known))
        else:
            place = (step.sensor.kind.name, *place_text(placement, step.sensor.s))
            rows.append((str(k), *place, f"{step.value - before:.2f}", f"{step.smallest:.3g}", *known))
        before = step.value
    return rows


def best_line(placement: Placement) -> str:
    """Return how far the choice is from the best set; empty where there were too many sets to compare."""
    if placement.best is None:
        return ""
    ours, most = (placement.information.value(chosen) for chosen in (placement.chosen, placement.best))
    if set(ours_of := placement.chosen) == set(placement.best) or ours >= most * (1.0 - 1e-12):
        return f"the best of all sets of {len(ours_of)}"
    those = ", ".join(
        f"{placement.candidates[k].kind.name} at {1e3 * placement.candidates[k].s:.1f} mm"
        for k in placement.best
    )
    return f"{100 * ours / most:.2f} % of the best set: {those}"


def scene_block(placement: Placement) -> str:
    """Return the keys of a scene that put the chosen sensors on its arm, as YAML."""
    chosen = [placement.candidates[k] for k in placement.chosen]
    length = placement.arm.length
    twin: dict[str, Any] = {}
    for section, kinds in (("pose", ("pose", "marker")), ("imu", ("imu",))):
        places = sorted({round(one.s / length, 6) for one in chosen if one.kind.name in kinds})
        twin[section] = {"enabled": True, "locations": places} if places else {"enabled": False}
    text = yaml.safe_dump({"twin": twin}, sort_keys=False, default_flow_style=None)
    markers = [f"{one.s / length:.4g}" for one in chosen if one.kind.name == "marker"]
    bends = [f"{one.s / length:.4g}" for one in chosen if one.kind.name == "bend"]
    if markers:
        text += f"# Markers at {', '.join(markers)}: poses without orientation. Where none is a plate:\n"
        text += "# estimator: {pose: {orientation_std_rad: 3.0}}\n"
    if bends:
        text += f"# Bend sensors at {', '.join(bends)}: the estimator takes none.\n"
    return text


def as_dict(placement: Placement) -> dict[str, Any]:
    """Return all numbers, in SI units."""
    information = placement.information
    return {
        "robot": placement.arm.robot.name,
        "window_s": placement.window_s,
        "windows": len(information.scaled),
        "noise": placement.noise.model_dump(),
        "alone": [
            {"kind": one.kind.name, "place_m": one.s, "information_nat": information.value([k])}
            for k, one in enumerate(placement.candidates)
        ],
        "chosen": [
            {
                "kind": step.sensor.kind.name if step.sensor else None,
                "place_m": step.sensor.s if step.sensor else None,
                "information_nat": step.value,
                "smallest_eigenvalue": step.smallest,
                "tip_deviation_m": step.tip_m,
                "worst_coordinate": step.worst,
                "worst_deviation": step.worst_std,
            }
            for step in steps(placement)
        ],
        "best": None
        if placement.best is None
        else {
            "sensors": [
                {"kind": placement.candidates[k].kind.name, "place_m": placement.candidates[k].s}
                for k in placement.best
            ],
            "information_nat": information.value(placement.best),
        },
    }
