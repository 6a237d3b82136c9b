"""Numbers of `soro reach`: rows of its tables, and all of them for a JSON file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from soro_core.control.motion_config import SOFTEST, STIFFEST
from soro_core.control.reachable_workspace import Reachable
from soro_core.model import SoftArm
from soro_core.robot.coordinates import strain_fields
from soro_lab.analysis.equilibrium_paths import EQUAL, EquilibriumPath, RestingPlace
from soro_lab.analysis.reach_picture import frequency, strain_shares


def place_rows(ways: Sequence[EquilibriumPath], count: int) -> list[tuple[str, ...]]:
    """Return the rows: place, tip, principal stiffnesses, frequencies and damping of the slowest modes."""
    rows = [_row("rest", ways[0].places[0], count)]
    for way in ways:
        note = "" if way.reached else ", the last with a rest"
        rows.append(_row(f"{way.name}, {1e-3 * way.pressure_pa[-1]:g} kPa{note}", way.places[-1], count))
    return rows


def stiffness_range(ways: Sequence[EquilibriumPath]) -> dict[str, tuple[float, float]]:
    """Return the least and the greatest stiffness [N/m] that a sideways force at the tip may be made to meet.

    Parameters
    ----------
    ways : sequence of EquilibriumPath

    Returns
    -------
    dict
        `pressures`: of the softest direction, as all chambers get the same pressure, which bends nothing
        (antagonists). `force.stiffness_factor`: of the same places, with the keys of the controller.
    """
    antagonists = [way for way in ways if way.name == EQUAL] or ways[:1]
    found = [float(place.tip.stiffness[0]) for way in antagonists for place in way.places]
    low, high = min(found), max(found)
    return {"pressures": (low, high), "force.stiffness_factor": (SOFTEST * low, STIFFEST * high)}


def stiffness_rows(ways: Sequence[EquilibriumPath]) -> list[tuple[str, str]]:
    """Return the rows: what commands the stiffness of the tip, and its range.

    Parameters
    ----------
    ways : sequence of EquilibriumPath
    """
    names = {"pressures": "equal pressures make", "force.stiffness_factor": "force.stiffness_factor makes"}
    return [
        (f"softest direction of the tip, {names[by]}, N/m", f"{_newton(low)} to {_newton(high)}")
        for by, (low, high) in stiffness_range(ways).items()
    ]


def _row(name: str, place: RestingPlace, count: int) -> tuple[str, ...]:
    tip = ", ".join(f"{1e3 * x + 0.0:.1f}" for x in np.round(place.tip_m, 4))
    stiffness = ", ".join(_newton(x) for x in place.tip.stiffness)
    free = ", ".join(frequency(place.modes, k) for k in range(min(count, len(place.q))))
    swing = [
        f"{hz:.3g} ({ratio:.2f})" if hz else "-"
        for hz, ratio in zip(place.modes.damped_hz[:count], place.modes.damping_ratio, strict=False)
    ]
    return name, tip, stiffness, free, ", ".join(swing)


def _newton(stiffness: float) -> str:
    """Return a stiffness [N/m] in three digits; rigid where the model cannot move, free without stiffness."""
    if math.isinf(stiffness):
        return "rigid"
    return f"{stiffness:.3g}" if stiffness > 1e-3 else "free"


def mode_rows(arm: SoftArm, ways: Sequence[EquilibriumPath], count: int) -> list[tuple[str, ...]]:
    """Return the rows of the dominant modes at rest: number, frequency, share of the tip, shares of strains.

    Parameters
    ----------
    arm : SoftArm
    ways : sequence of EquilibriumPath
    count : int
    """
    modes = ways[0].places[0].modes
    rows: list[tuple[str, ...]] = []
    for k in modes.dominant(count):
        shares = strain_shares(arm, modes.strain_share[k])
        parts = ", ".join(f"{name} {100 * part:.1f} %" for name, part in shares.items() if part >= 5e-4)
        rows.append((str(k + 1), frequency(modes, k), f"{100 * modes.tip_share[k]:.1f} %", parts))
    return rows


def as_dict(arm: SoftArm, found: Reachable, ways: Sequence[EquilibriumPath]) -> dict[str, Any]:
    """Return all numbers, in SI units, as a JSON file takes them; null where the model cannot move.

    Parameters
    ----------
    arm : SoftArm
    found : Reachable
    ways : sequence of EquilibriumPath
    """
    fields = strain_fields(arm.robot)
    names = [f"link{link}/{strain}" for link, strain in zip(fields.links, fields.strains, strict=True)]
    return {
        "robot": arm.robot.name,
        "coordinates": list(arm.robot.coordinate_names),
        "tips": [
            {"pressure_pa": p.tolist(), "tip_m": x.tolist()}
            for p, x in zip(found.pressure_pa, found.tip_m, strict=True)
        ],
        "combinations_without_rest": found.failed,
        "stiffness_range_n_m": {
            by: [None if math.isinf(x) else x for x in ends] for by, ends in stiffness_range(ways).items()
        },
        "ways": [
            {
                "chambers": way.name,
                "reached": way.reached,
                "places": [_place(arm, place, names) for place in way.places],
            }
            for way in ways
        ],
    }


def _place(arm: SoftArm, place: RestingPlace, names: list[str]) -> dict[str, Any]:
    modes = place.modes
    return {
        "pressure_pa": place.pressure_pa.tolist(),
        "q": place.q.tolist(),
        "tip_m": place.tip_m.tolist(),
        "compliance_m_n": place.tip.compliance.tolist(),
        "stiffness_n_m": [None if math.isinf(x) else float(x) for x in place.tip.stiffness],
        "directions": place.tip.directions.tolist(),
        "modes": [
            {
                "frequency_hz": float(modes.frequency_hz[k]),
                "damped_hz": float(modes.damped_hz[k]),
                "damping_ratio": float(modes.damping_ratio[k]),
                "tip_share": float(modes.tip_share[k]),
                "strain_share": dict(zip(names, modes.strain_share[k].tolist(), strict=True)),
                "shape": modes.shapes[:, k].tolist(),
            }
            for k in range(arm.n_q)
        ],
    }
