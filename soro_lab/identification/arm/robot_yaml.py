"""The robot file of an identified arm: every number with its deviation and where it comes from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import yaml

from soro_core.files.rounded import rounded
from soro_core.robot.parts import fields
from soro_lab.identification.arm.cases.parameters import ArmParameter
from soro_lab.identification.arm.cases.physical import Unphysical, unphysical
from soro_lab.identification.arm.laws import is_of_law
from soro_lab.identification.arm.search.combinations import Combination, combinations
from soro_lab.identification.arm.stages import ArmIdentification

# What would determine a number that a recording leaves open, by the begin of its own name.
_WEIGHT = "a known weight at the tip in some of the runs (it makes forces absolute), or quick steps"
_SINGLE = "levels of single chambers, with a position sensor"
_EXPERIMENTS = {
    "k_": _WEIGHT,
    "rise_": "levels up to the largest pressure",
    "rate_": "levels up to the largest pressure",
    "damping_": "quick steps or a release, with poses at 100 Hz",
    "creep_": "steps that are held for ten seconds",
    "slow_": "steps that are held for a minute",
    "dahl_": "the same levels approached from below and from above",
    "gain": _WEIGHT,
    "arm": _WEIGHT,
    "area_saturation": "levels up to the largest pressure",
    "dead_band": "levels of a few kilopascals, one chamber at a time",
    "area_slope": "levels of all chambers together and of single ones",
}


def robot_text(found: ArmIdentification, sources: Sequence[str]) -> str:
    """Return the robot file, with the names of the recordings."""
    keys = rounded(fields(found.robot), 8)
    lines = [
        f"# Identified by soro identify from {', '.join(sources)}.",
        *(f"# {line}" for line in _quality(found)),
        "#",
        *(f"# {line}".rstrip() for line in number_table(found)),
    ]
    body = yaml.safe_dump(keys, sort_keys=False, default_flow_style=None, width=110)
    return "\n".join(lines) + "\n" + body


def number_table(found: ArmIdentification) -> list[str]:
    """Return one line a number: name, value, standard deviation, unit, origin."""
    rows = [("number", "value", "deviation", "unit", "origin"), *_rows(found)]
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    return ["  ".join([*(row[i].ljust(widths[i]) for i in range(4)), row[4]]) for row in rows]


def experiment(name: str) -> str:
    """Return what would determine a number."""
    own = name.split("/")[-1]
    if "/chamber" in name:  # against the other chambers of its link
        return _SINGLE
    return next(text for end, text in _EXPERIMENTS.items() if own.startswith(end))


def impossible(found: ArmIdentification) -> tuple[Unphysical, ...]:
    """Return what no arm has among the numbers that were found."""
    own = {name: value for name, value in found.solution.values.items() if name not in found.kept}
    return unphysical(found.robot, own)


def combined(found: ArmIdentification) -> tuple[Combination, ...]:
    """Return the ratios and products that the data determine better than the numbers themselves."""
    return combinations(found.problem.numbers, found.certainty, found.solution.values)


def marks(name: str, found: ArmIdentification, odd: Sequence[Unphysical]) -> Iterator[str]:
    """Return what is to be known of a number beside its deviation.

    Parameters
    ----------
    name : str
    found : ArmIdentification
    odd : sequence of Unphysical
    """
    if name in found.kept:
        yield "fixed"
    elif name in found.certainty.at_bound:
        yield "at its bound"
    if any(name in each.numbers for each in odd):
        yield "unphysical"


def origin(name: str, found: ArmIdentification) -> str:
    """Return where a number comes from."""
    if name.startswith("frame/"):
        return "identified, of the measurement"
    if name in found.kept:
        open_ = "; ".join(c for c in found.kept[name] if c != f"+{name}")
        only = f" (open: {open_})" if open_ else ""
        begin = "likely" if is_of_law(name) else "as described"
        return f"{begin}: not determined{only}; {experiment(name)}"
    return "identified"


def _rows(found: ArmIdentification) -> Iterator[tuple[str, str, str, str, str]]:
    odd = impossible(found)
    for each in combined(found):
        yield (
            each.name,
            f"{each.value:.5g}",
            f"{100 * each.deviation:.2g} %",
            "",
            "identified, surer than its parts",
        )
    for number in found.problem.numbers:
        name, value = number.name, found.solution.values[number.name]
        more = [mark for mark in marks(name, found, odd) if mark != "fixed"]
        where = "; ".join([origin(name, found), *more])
        yield name, f"{value:.5g}", _deviation(number, found), number.unit, where


def _deviation(number: ArmParameter, found: ArmIdentification) -> str:
    if number.name in found.certainty.at_bound and number.name not in found.kept:
        return "-"  # where a bound ends the search, the parabola of the covariance has no meaning
    size = found.certainty.deviations[number.name]
    return f"{100 * size:.2g} %" if number.kind == "factor" else f"{size:.2g}"


def _quality(found: ArmIdentification) -> Iterator[str]:
    why = "the search was interrupted" if found.interrupted else "nothing could be held out"
    yield f"Laws: {found.choice.chosen.name if found.choice else f'linear ({why})'}."
    what = "Held out" if found.held_out else "Fitted"
    yield from (f"{what}: {error}." for error in found.held_out or found.fitted)
    if found.held_out:
        yield f"RMS error on what was held out: {100 * found.held_out_share:.2g} % of the range moved."
    if std := found.robot.calibration.gain_std:
        yield f"Scale of gains and stiffness, and so of forces: within {100 * std:.2g} % (gain_std)."
    if found.interrupted:
        yield "INTERRUPTED: the search did not end; these are the best numbers until there."
    yield from (f"UNPHYSICAL: {each}." for each in impossible(found))
