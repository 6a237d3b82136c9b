"""The report of a part: a page that needs no network, and its numbers as report.json."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from soro_design.robot_of_part.joint import TipError
from soro_design.robot_of_part.link import at_bound
from soro_design.robot_of_part.stages import PartIdentification
from soro_design.robot_of_part.written import LOADS, greatest, mean_and_most, quality, refusal, single_loads
from soro_lab.reporting.drawing import COLOURS, MEASURED, PREDICTED, WIDTH, Image, style, svg
from soro_lab.reporting.html import Block, Bullets, Chapter, Page, Picture, Table, Words, number, write


def content_of(found: PartIdentification, source: str, file: str, accept: float) -> dict[str, Any]:
    """Return the numbers of a report.

    Parameters
    ----------
    found : PartIdentification
    source, file : str
        Names of the part file and of the robot file.
    accept : float
        Greatest error of a held-out tip over the length.
    """
    errors = {}
    for kind, own in (("fitted", found.fitted), ("held_out", found.held_out)):
        mean, most = mean_and_most(own)
        moved = mean_and_most(own, "of_motion")
        errors[kind] = {"mean": mean, "most": most, "mean_of_motion": moved[0], "most_of_motion": moved[1]}
    sweeps: list[dict[str, Any]] = []
    for error in (*found.fitted, *found.held_out):
        if not sweeps or sweeps[-1]["sweep"] != error.state.sweep:
            sweeps.append(
                {"sweep": error.state.sweep, "held_out": error.state.held_out, "shares": [], "of_motion": []}
            )
        sweeps[-1]["shares"].append(error.share)
        sweeps[-1]["of_motion"].append(error.of_motion)
    mesh = found.mesh
    return {
        "part": source,
        "file": file,
        "accept": accept,
        "refusal": refusal(found, accept),
        "quality": quality(found),
        "errors": errors,
        "sweeps": sweeps,
        "numbers": dict(found.values),
        "single_loads": {
            **single_loads(found.start),
            "k_b_rest_whole_deflection": found.start.k_b_whole_nm,
        },
        "at_bound": at_bound(found.known, found.start, found.values),
        "modes": [[vars(one) for one in pair] for pair in found.kept],
        "strength": list(found.strength),
        "mesh": None if mesh is None else {**vars(mesh), "error": mesh.error, "of_motion": mesh.of_motion},
    }


def write_report(content: dict[str, Any], found: PartIdentification, folder: Path) -> Path:
    """Write index.html, report.json and the folder pictures; return the page.

    Parameters
    ----------
    content : dict
        Of `content_of`.
    found : PartIdentification
    folder : Path
        Made where it does not exist.
    """
    refused = content["refusal"]
    limit = f"{greatest(found)}; allowed together: {100.0 * content['accept']:g} % of the length"
    page = Page(
        f"Identification of {content['part']}",
        f"Robot file: {content['file']}. All numbers of this page: report.json.",
        f"Not accepted: {refused}." if refused else f"Accepted: {limit}.",
        not refused,
        [Bullets(content["quality"])],
        [
            Chapter("tips", "Tip against finite elements", [*_tips(content, found)]),
            Chapter("backbones", "Backbones at the end of each sweep", [*_backbones(found)]),
            Chapter("numbers", "Numbers", [*_numbers(content)]),
            Chapter("strains", "Strains along the part", [*_strains(content, found)]),
        ],
    )
    return write(page, content, folder)


def _tips(content: dict[str, Any], found: PartIdentification) -> Iterator[Block]:
    yield Words(
        "Distance of the tips, in % of the length and of how far the tip has moved. Points: finite elements;"
        " lines: the link."
    )
    yield _sweeps(content)
    yield Picture(tips_picture(found), "tips of the link and of the part over the load of each sweep")


def _backbones(found: PartIdentification) -> Iterator[Block]:
    yield Picture(backbones_picture(found), "backbones of the link and of the part")


def _numbers(content: dict[str, Any]) -> Iterator[Block]:
    yield Words(
        "Single loads come first: pressures alone give only the ratio of stiffness to area. Then all states"
        " are fitted, with the stiffness at rest within 10 % of what forces give, of a single chamber 40 %."
    )
    yield _number_table(content)


def _strains(content: dict[str, Any], found: PartIdentification) -> Iterator[Block]:
    yield Words(
        "What shape functions keep of the states by projection, the best that a link with them can do."
        " Missing: of the strains, root mean square."
    )
    yield _modes(content)
    yield Picture(strains_picture(found), "elongation and curvature along the part")


def _sweeps(content: dict[str, Any]) -> Table:
    rows = []
    for k, sweep in enumerate(content["sweeps"]):
        last = len(sweep["shares"]) - 1
        shown = [number(sweep["shares"][i], f"sweeps.{k}.shares.{i}", 100.0) for i in (last // 2, last)]
        shown.append(number(sweep["of_motion"][last], f"sweeps.{k}.of_motion.{last}", 100.0))
        rows.append([sweep["sweep"], "yes" if sweep["held_out"] else "", *shown])
    for kind, title in (("fitted", "mean and greatest, fitted"), ("held_out", "mean and greatest, held out")):
        own = content["errors"][kind]
        shown = [
            number(own[key], f"errors.{kind}.{key}", 100.0) for key in ("mean", "most", "most_of_motion")
        ]
        rows.append([title, "yes" if kind == "held_out" else "", *shown])
    head = ["#at half load, %", "#at full load, %", "#of the motion at full load, %"]
    return Table(["sweep", "held out", *head], rows)


def _number_table(content: dict[str, Any]) -> Table:
    rows = []
    for name, value in content["numbers"].items():
        first = content["single_loads"].get(name)
        own = [number(first, f"single_loads.{name}", digits=5), number(value, f"numbers.{name}", digits=5)]
        rows.append([name, *own, LOADS.get(name, "all states")])
    whole = content["single_loads"]["k_b_rest_whole_deflection"]
    rows.append(
        [
            "k_b_rest, shear in it",
            number(whole, "single_loads.k_b_rest_whole_deflection", digits=5),
            "–",
            "whole deflection under the force across the axis",
        ]
    )
    return Table(["number", "#single load", "#all states", "load"], rows)


def _modes(content: dict[str, Any]) -> Table:
    rows = []
    for n, pair in enumerate(content["modes"]):
        cells = [
            number(one[key], f"modes.{n}.{i}.{key}", 100.0)
            for i, one in enumerate(pair)
            for key in ("strain", "tip_mean", "tip_most")
        ]
        rows.append([f"{n} modes" if n else "constant strain", *cells])
    columns = ("missing", "tip, mean", "tip, most")
    head = [f"#{what}, {kind}, %" for kind in ("fitted", "held out") for what in columns]
    return Table(["shape functions", *head], rows)


def tips_picture(found: PartIdentification) -> Image:
    """Return the places of both tips over the load of each sweep."""
    with mpl.rc_context(style()):
        figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
        for axes, k in zip(figure.subplots(1, 3), range(3), strict=True):
            for c, own in enumerate(_by_sweep(found)):
                load = [error.state.load for error in own]
                colour = COLOURS[c % len(COLOURS)]
                axes.plot(load, [1e3 * e.state.poses[-1][k, 3] for e in own], "o", ms=2.5, color=colour)
                label = own[0].state.sweep + (" (held out)" if own[0].state.held_out else "")
                axes.plot(load, [1e3 * e.places[-1][k] for e in own], color=colour, label=label)
            axes.set_xlabel("load factor")
            axes.set_title(f"tip, {'xyz'[k]} [mm]")
        axes.legend(fontsize=6)
        return svg(figure)


def backbones_picture(found: PartIdentification) -> Image:
    """Return both backbones at the end of each sweep, across and along the axis."""
    with mpl.rc_context(style()):
        sweeps = _by_sweep(found)
        columns = min(4, len(sweeps))
        rows = -(-len(sweeps) // columns)
        figure = Figure(figsize=(WIDTH, 2.6 * rows), layout="constrained")
        for c, own in enumerate(sweeps):
            axes = figure.add_subplot(rows, columns, c + 1, aspect="equal")
            last = own[-1]
            part = last.state.poses[:, :3, 3]
            side = part[-1, :2] / max(float(np.linalg.norm(part[-1, :2])), 1e-9)
            axes.plot(1e3 * part[:, :2] @ side, 1e3 * part[:, 2], "o", ms=2, color=MEASURED)
            axes.plot(1e3 * last.places[:, :2] @ side, 1e3 * last.places[:, 2], color=PREDICTED)
            axes.set_title(f"{last.state.sweep}: {100.0 * last.share:.2g} %")
            axes.set_xlim(-5, 1e3 * found.data.length / 2)
        return svg(figure)


def strains_picture(found: PartIdentification) -> Image:
    """Return elongation and curvature along the part at the end of each sweep."""
    data = found.data
    middle = 0.5e3 * (data.z[1:] + data.z[:-1])
    with mpl.rc_context(style()):
        figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        for c, own in enumerate(_by_sweep(found)):
            strains = data.strains(own[-1].state)
            colour = COLOURS[c % len(COLOURS)]
            left.plot(middle, strains[:, 0], color=colour, label=own[0].state.sweep)
            right.plot(middle, np.hypot(strains[:, 1], strains[:, 2]), color=colour)
        left.set_title("elongation over place [mm]")
        right.set_title("curvature [1/m] over place [mm]")
        left.legend(fontsize=6)
        return svg(figure)


def _by_sweep(found: PartIdentification) -> list[list[TipError]]:
    groups: dict[str, list[TipError]] = {}
    every: Sequence[TipError] = (*found.fitted, *found.held_out)
    for error in every:
        groups.setdefault(error.state.sweep, []).append(error)
    return list(groups.values())
