"""The robot file of a part, and the lines that say how good it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from soro_core.files.rounded import rounded
from soro_design.robot_of_part.direct import Direct
from soro_design.robot_of_part.joint import TipError
from soro_design.robot_of_part.link import GIVEN, at_bound, parameters, robot_keys
from soro_design.robot_of_part.modes import Kept, mode_file, strain_keys
from soro_design.robot_of_part.stages import PartIdentification

# How many times less two modes shall miss than constant strain.
ASKED = 3.0
# Greatest error of a held-out tip over its motion: beyond it the link does not move like the part, however
# short its ways are.
OF_MOTION = 0.3
# Below this share, missed by constant strain, the strain of a part is uniform.
UNIFORM = 0.02


def kept_verdict(compared: Sequence[tuple[Kept, Kept]]) -> str:
    """Return the line on what two modes keep of the held-out strains, with a reason where that is too little.

    Parameters
    ----------
    compared : sequence of tuple of Kept
        Of constant strain, one mode, two modes and three: of the fitted and of the held-out states.
    """
    constant, two = compared[0][1], compared[2][1]
    gain = _gain(constant.strain, two.strain)
    line = (
        f"Two modes miss {100.0 * two.strain:.2g} % of the held-out strains, constant strain"
        f" {100.0 * constant.strain:.2g} %: {_times(gain)} ({ASKED:g} asked)"
    )
    return f"{line}." if gain >= ASKED else f"{line}, because {_reason(compared)}."


def link_verdict(constant: Sequence[TipError], modal: Sequence[TipError], n: int, two: Kept) -> str:
    """Return the line on the tip of the link with modes against that of constant strain.

    Parameters
    ----------
    constant, modal : sequence of TipError
        Of the held-out states: of the link of constant strain, of that with modes.
    n : int
    two : Kept
        What these modes keep of the same states by projection.
    """
    means = [float(np.mean([error.share for error in own])) for own in (constant, modal)]
    gain = _gain(*means)
    line = (
        f"Held-out tip of the link: mean {100.0 * means[1]:.2g} % with {n} {'mode' if n == 1 else 'modes'},"
        f" {100.0 * means[0]:.2g} % with constant strain: {_times(gain)} ({ASKED:g} asked)"
    )
    if gain >= ASKED:
        return f"{line}."
    if _gain(means[0], two.tip_mean) < ASKED:
        return f"{line}, because the tip of the strains that the modes keep is off by as much."
    return (
        f"{line}, because the link has one stiffness along its length: the strains that the modes keep have"
        f" their tip within {100.0 * two.tip_mean:.2g} %."
    )


def _reason(compared: Sequence[tuple[Kept, Kept]]) -> str:
    constant, fitted = compared[0][1], _gain(compared[0][0].strain, compared[2][0].strain)
    if constant.strain < UNIFORM:
        return f"the strain is uniform to {100.0 * UNIFORM:g} %"
    if fitted >= ASKED:
        return (
            f"held-out states have other shapes of strain than the fitted ones, where it is {_times(fitted)}"
        )
    three = _gain(constant.strain, compared[3][1].strain)
    return f"the shape of the strain changes with the load; with three modes it is {_times(three)}"


def _gain(constant: float, modal: float) -> float:
    return constant / max(modal, 1e-12)


def _times(gain: float) -> str:
    return f"{gain:.3g} times less" if gain >= 1.0 else f"{1.0 / gain:.3g} times more"


# Digits of numbers in the file.
_DIGITS = 7
LOADS = {
    "k_e_rest": "axial force",
    "k_b_rest": "force across the axis",
    "area_m2": "equal pressures",
    "area_slope": "equal pressures",
    "offset_m": "one chamber",
}


def write_robot(found: PartIdentification, source: str, out: Path) -> list[Path]:
    """Write the robot file, and the files of its modes beside it; return them.

    Parameters
    ----------
    found : PartIdentification
        What is written.
    source : str
        Name of the part file.
    out : Path
    """
    files = [out]
    for name, samples in (found.samples or {}).items():
        if name == "elongation" and name not in found.known.strains:
            continue
        files.append(mode_file(out, name))
        np.save(files[-1], samples)
    out.write_text(robot_text(found, source, out), encoding="utf-8")
    return files


def robot_text(found: PartIdentification, source: str, out: Path) -> str:
    """Return the robot file, parameters as in `write_robot`."""
    strains = None if found.samples is None else strain_keys(found.samples, out)
    keys = rounded(robot_keys(found.known, found.values, strains), _DIGITS)
    lines = [f"Identified by soro identify-fem from {source}; not measured.", *quality(found)]
    if found.known.viscosity_pa_s:
        lines.append(f"Damping: from viscosity_pa_s {found.known.viscosity_pa_s:g} of the part file.")
    else:
        lines.append("Damping: 0, to be measured (a release, soro identify).")
    lines += ["Creep: to be measured.", "", *number_table(found)]
    body = yaml.safe_dump(keys, sort_keys=False, default_flow_style=None, width=110)
    return "\n".join(f"# {line}".rstrip() for line in lines) + "\n" + body


def quality(found: PartIdentification) -> list[str]:
    """Return the lines on errors, mesh, stretch, modes, and on numbers that stop at a bound."""
    lines = [
        f"Tip against finite elements, in % of {of}: {_errors(found.fitted, key)} fitted,"
        f" {_errors(found.held_out, key)} held out."
        for of, key in (("the length", "share"), ("its motion", "of_motion"))
    ]
    mesh = found.mesh
    if mesh is not None:
        lines.append(
            f"Mesh: {mesh.elements} elements; with {mesh.coarse_elements} the tip of sweep {mesh.sweep} is"
            f" {100.0 * mesh.difference:.2g} % of the length off, which leaves an error of some"
            f" {100.0 * mesh.error:.2g} % of the length, {100.0 * mesh.of_motion:.2g} % of the motion."
        )
    lines += found.strength
    lines.append(kept_verdict(found.kept))
    if found.constant is not None and found.samples is not None:
        n = next(iter(found.samples.values())).shape[1]
        lines.append(link_verdict(found.constant, found.held_out, n, found.kept[n][1]))
    if found.is_interrupted:
        lines.append("Interrupted: the numbers are the best until then.")
    stuck = at_bound(found.known, found.start, found.values)
    if stuck:
        lines.append(f"At a bound, so that other loads would say more: {', '.join(stuck)}.")
    return lines


def refusal(found: PartIdentification, accept: float) -> str:
    """Return why a robot is not accepted, empty where it is.

    Parameters
    ----------
    found : PartIdentification
        With the robot.
    accept : float
        Greatest error of a held-out tip with that of the mesh, over the length.
    """
    by_mesh = found.mesh.error if found.mesh is not None else 0.0
    if mean_and_most(found.held_out)[1] + by_mesh > accept:
        return f"{greatest(found)}; allowed together: {100.0 * accept:g} % of the length"
    if mean_and_most(found.held_out, "of_motion")[1] > OF_MOTION:
        one_sided = "; a tendon with stiffness_n on one side bends it, for which a link has no law"
        why = one_sided if found.has_stiff_tendon else ""
        return f"{greatest(found)}; allowed: {100.0 * OF_MOTION:g} % of its motion{why}"
    given = GIVEN if found.known.chambers > 1 else ()
    stuck = [name for name in at_bound(found.known, found.start, found.values) if name not in given]
    if stuck:
        return (
            f"{', '.join(stuck)} at a bound: the link has no law for what the part does, or its sweeps are"
            " too few; chambers without hoops balloon"
        )
    return ""


def greatest(found: PartIdentification) -> str:
    """Return how far a held-out tip is off at most, and the mesh beside it, over length and motion."""
    shares, of_motion = (mean_and_most(found.held_out, key)[1] for key in ("share", "of_motion"))
    line = (
        f"a held-out tip is off by up to {100.0 * shares:.2g} % of the length, {100.0 * of_motion:.2g} % of"
        " its motion"
    )
    if found.mesh is None:
        return f"{line} (mesh not checked)"
    return (
        f"{line}; the mesh by some {100.0 * found.mesh.error:.2g} % of the length,"
        f" {100.0 * found.mesh.of_motion:.2g} % of the motion"
    )


def number_table(found: PartIdentification) -> list[str]:
    """Return one line a number that was fitted: by single loads, by all states, by which load."""
    start, is_single = single_loads(found.start), found.known.chambers == 1
    fitted = {number.name for number in parameters(found.known, found.start)}
    rows = [("number", "single load", "all states", "load")]
    for name in (one for one in found.values if one in fitted):
        first = f"{start[name]:.5g}" if name in start and not (is_single and name == "area_slope") else "-"
        rows.append((name, first, f"{found.values[name]:.5g}", LOADS.get(name, "all states")))
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    return ["  ".join([*(row[i].ljust(widths[i]) for i in range(3)), row[3]]) for row in rows]


def single_loads(start: Direct) -> dict[str, float]:
    """Return what single loads give by the names of the numbers of a fit."""
    return {
        "k_e_rest": start.k_e_n_per_m,
        "k_b_rest": start.k_b_nm,
        "area_m2": start.area_m2,
        "area_slope": start.area_slope,
        "offset_m": start.offset_m,
    }


def mean_and_most(errors: Sequence[TipError], key: str = "share") -> tuple[float, float]:
    """Return mean and greatest error of tips over the length; with `of_motion`, over their motion."""
    shares = [getattr(error, key) for error in errors]
    return float(np.mean(shares)), float(np.max(shares))


def _errors(errors: Sequence[TipError], key: str) -> str:
    mean, most = mean_and_most(errors, key)
    return f"mean {100.0 * mean:.2f}, greatest {100.0 * most:.2f}"
