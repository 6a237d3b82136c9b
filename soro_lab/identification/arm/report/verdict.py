"""The first lines of a report: accepted or not, by how much, and what to do next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from soro_lab.identification.arm.cases.physical import Unphysical
from soro_lab.identification.arm.judge import Error
from soro_lab.identification.arm.robot_yaml import experiment
from soro_lab.identification.arm.stages import ArmIdentification


def is_accepted(found: ArmIdentification, accept: float, unphysical: Sequence[Unphysical]) -> bool:
    """Whether the search ended, the error on what was held out is small enough, and every number physical.

    Parameters
    ----------
    found : ArmIdentification
    accept : float
        Largest RMS error, in ranges moved.
    unphysical : sequence of Unphysical
    """
    judged = bool(found.held_out) and not found.interrupted
    return judged and found.held_out_share <= accept and not unphysical


def verdict_of(
    found: ArmIdentification,
    accept: float,
    out: str,
    unphysical: Sequence[Unphysical],
    written_off: Sequence[str],
) -> dict[str, Any]:
    """Return verdict, its sentence, and what to do next.

    Parameters
    ----------
    found : ArmIdentification
    accept : float
        Largest RMS error, in ranges moved.
    out : str
        The robot file.
    unphysical : sequence of Unphysical
    written_off : sequence of str
        Runs that the soft loss has written off.
    """
    accepted = is_accepted(found, accept, unphysical)
    share = found.held_out_share if found.held_out else None
    judged = found.held_out or found.fitted
    return {
        "accepted": accepted,
        "interrupted": found.interrupted,
        "held_out_share": share,
        "accept_share": accept,
        "errors": _by_unit(judged),
        "text": sentence(found, accept, unphysical),
        "next": list(_next(found, accept, accepted, out, unphysical, written_off)),
    }


def _by_unit(errors: Sequence[Error]) -> list[dict[str, Any]]:
    """RMS error over all runs and shapes of one unit; angles of plates beside their positions."""
    groups: dict[str, list[tuple[int, float]]] = {}
    for e in errors:
        groups.setdefault(e.unit, []).append((e.samples, e.rms))
        if not np.isnan(e.turn_rms):
            groups.setdefault("rad", []).append((e.samples, e.turn_rms))
    return [
        {"unit": unit, "rms": float(np.sqrt(sum(n * v**2 for n, v in own) / sum(n for n, _ in own)))}
        for unit, own in groups.items()
    ]


def in_words(size: float, unit: str) -> str:
    """Return an error in the unit of a reader: mm, deg or 1/m."""
    factor, shown = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg")}.get(unit, (1.0, unit))
    return f"{factor * size:.3g} {shown}"


def sentence(found: ArmIdentification, accept: float, unphysical: Sequence[Unphysical]) -> str:
    """Return the verdict: accepted or not, and the error that counts; parameters as in `is_accepted`."""
    begin = "accepted" if is_accepted(found, accept, unphysical) else "not accepted"
    if found.interrupted:
        begin = "interrupted: these are the best numbers so far, and their own error is not known"
    sizes = _by_unit(found.held_out or found.fitted)
    error = ", ".join(in_words(each["rms"], each["unit"]) for each in sizes)
    if found.held_out:
        share = f"{100 * found.held_out_share:.3g} % of the range moved ({error})"
        which = "; that of the last fit that was judged is an" if found.interrupted else ":"
        text = f"{begin}{which} RMS error {share} on what was held out; allowed is {100 * accept:.3g} %"
    else:
        text = f"{begin}: nothing could be held out, so the error on other data is not known; "
        text += f"RMS error {error} on the data of the fit"
    return "; ".join([text, *(f"unphysical: {each}" for each in unphysical)])


def _next(
    found: ArmIdentification,
    accept: float,
    accepted: bool,
    out: str,
    unphysical: Sequence[Unphysical],
    written_off: Sequence[str],
) -> Iterator[str]:
    if accepted:
        yield f"Make a scene with the line robot: {out}"
        yield "soro gains SCENE.yaml shows the gains that follow from it."
        yield "soro run SCENE.yaml runs the simulated arm, then --valves real --arm real your own."
    if found.interrupted:
        yield "Run the command again without Ctrl-C: the search did not end."
    if unphysical:
        yield "Check units, masses and geometry of the described robot: some found numbers no arm has."
    if not found.held_out:
        yield "Record more: two sections of one kind (rest, step, sweep, release) or more in a recording."
    elif found.held_out_share > accept:
        yield "See which run and which direction is off below; then add a law, or record what shows it."
    if written_off:
        yield f"Look at {', '.join(written_off)}: the fit hardly follows it. Leave it out if it is damaged."
    open_ = {experiment(name) for name in found.kept}
    yield from (f"Record {each}: it determines numbers that are open." for each in sorted(open_))
