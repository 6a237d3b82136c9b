"""The robot file of an identified arm: every number with its deviation and where it comes from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import yaml

from soro_core.identification.arm.laws import is_of_law
from soro_core.identification.arm.numbers import Number
from soro_core.identification.arm.stages import Identified
from soro_core.robot.parts import fields

# What would determine a number that a recording leaves open, by the end of its name.
_EXPERIMENTS = {
    "k_": "a known weight at the tip in some of the runs (it makes forces absolute), or quick steps",
    "rise_": "levels up to the largest pressure",
    "rate_": "levels up to the largest pressure",
    "damping_": "quick steps or a release, with poses at 100 Hz",
    "creep_": "steps that are held for ten seconds",
    "slow_": "steps that are held for a minute",
    "dahl_": "the same levels approached from below and from above",
    "gain": "a known weight at the tip in some of the runs, or quick steps",
    "arm": "levels of single chambers, with a position sensor",
    "area_saturation": "levels up to the largest pressure",
    "dead_band": "levels of a few kilopascals, one chamber at a time",
    "area_slope": "levels of all chambers together and of single ones",
}


def robot_text(found: Identified, sources: Sequence[str]) -> str:
    """Return the robot file.

    Parameters
    ----------
    found : Identified
    sources : sequence of str
        Names of the recordings.
    """
    keys = fields(found.robot)
    keys["links"] = [_plain(link) for link in keys["links"]]
    lines = [
        f"# Identified by soro identify from {', '.join(sources)}.",
        *(f"# {line}" for line in _quality(found)),
        "#",
        *(f"# {line}".rstrip() for line in number_table(found)),
    ]
    body = yaml.safe_dump(_plain(keys), sort_keys=False, default_flow_style=None, width=110)
    return "\n".join(lines) + "\n" + body


def number_table(found: Identified) -> list[str]:
    """Return one line a number: name, value, standard deviation, unit, origin."""
    rows = [("number", "value", "deviation", "unit", "origin"), *_rows(found)]
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    return ["  ".join([*(row[i].ljust(widths[i]) for i in range(4)), row[4]]) for row in rows]


def experiment(name: str) -> str:
    """Return what would determine a number."""
    own = name.split("/")[-1]
    return next(text for end, text in _EXPERIMENTS.items() if own.startswith(end))


def _rows(found: Identified) -> Iterator[tuple[str, str, str, str, str]]:
    for number in found.problem.numbers:
        name, value = number.name, found.solution.values[number.name]
        yield name, f"{value:.5g}", _deviation(number, found), number.unit, _origin(name, found)


def _origin(name: str, found: Identified) -> str:
    if name.startswith("frame/"):
        return "identified, of the measurement"
    if name in found.kept:
        open_ = "; ".join(c for c in found.kept[name] if c != f"+{name}")
        only = f" (open: {open_})" if open_ else ""
        origin = "likely" if is_of_law(name) else "as described"
        return f"{origin}: not determined{only}; {experiment(name)}"
    return "identified; at its bound" if name in found.certainty.at_bound else "identified"


def _deviation(number: Number, found: Identified) -> str:
    size = found.certainty.deviations[number.name]
    return f"{100 * size:.2g} %" if number.kind == "factor" else f"{size:.2g}"


def _quality(found: Identified) -> Iterator[str]:
    laws = found.choice.chosen.name if found.choice else "linear (nothing could be held out)"
    yield f"Laws: {laws}."
    what = "Held out" if found.held_out else "Fitted"
    yield from (f"{what}: {error}." for error in found.held_out or found.fitted)
    if found.held_out:
        yield f"RMS error on what was held out: {100 * found.held_out_share:.2g} % of the range moved."


def _plain(value: object) -> object:
    """Lists and plain numbers, as YAML writes them."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return float(f"{value:.8g}") if isinstance(value, float) else value
