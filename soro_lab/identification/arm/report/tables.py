"""Tables of the page, each cell with the place of its number in report.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from soro_lab.reporting.html import Cell, Table, number

Content = dict[str, Any]

# From SI to the unit that a reader uses.
SHOWN = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg"), "1/m": (1.0, "1/m")}

# Samples left out over those used above which a stream is marked.
_MANY = 0.05


def data_table(content: Content) -> Table:
    """Return the streams of each recording."""
    rows = []
    for i, run in enumerate(content["data"]):
        for k, stream in enumerate(run["streams"]):
            at = f"data.{i}.streams.{k}"
            begins = [run["run"], number(run["duration_s"], f"data.{i}.duration_s")]
            rows.append(
                [
                    *(begins if k == 0 else ["", ""]),
                    stream["stream"],
                    number(stream["rate_hz"], f"{at}.rate_hz", digits=4),
                    number(stream["samples"], f"{at}.samples", digits=9),
                    number(
                        stream["left_out"],
                        f"{at}.left_out",
                        digits=9,
                        is_bad=stream["left_out"] > _MANY * stream["samples"],
                    ),
                    stream["why"] if stream["left_out"] else "",
                ]
            )
    head = ("recording", "#s", "stream", "#Hz", "#samples used", "#left out", "why")
    return Table(head, rows)


def sections_table(content: Content) -> Table:
    """Return which sections were fitted and which held out."""

    def times(parts: list[list[float]]) -> str:
        return ", ".join(f"{a:.1f}–{b:.1f}" for a, b in parts) or "none"

    rows = [
        [
            run["run"],
            times(run["fitted_s"]),
            times(run["held_out_s"]),
            "; ".join(run["notes"]),
        ]
        for run in content["data"]
    ]
    return Table(("recording", "fitted, s", "held out, s", "assumed"), rows)


def runs_table(content: Content) -> Table:
    """Return the error of every run, with those that the soft loss has written off."""
    rows = []
    for i, run in enumerate(content["runs"]):
        factor, unit = SHOWN[run["unit"]]
        rows.append(
            [
                run["run"],
                run["shape"],
                number(run["rms"], f"runs.{i}.rms", factor, is_bad=run["written_off"]),
                number(run["worst"], f"runs.{i}.worst", factor),
                number(run["worst_at_s"], f"runs.{i}.worst_at_s"),
                unit,
                number(run["beyond_three"], f"runs.{i}.beyond_three", 100.0),
                number(run["weight"], f"runs.{i}.weight", 100.0),
                Cell(f"written off: {run['why']}" if run["written_off"] else "", is_bad=True),
            ]
        )
    head = ("run", "shape", "#RMS", "#worst", "#at, s", "unit", "#beyond three, %", "#weight, %", "")
    return Table(head, rows)


def errors_table(content: Content) -> Table:
    """Return the errors on fitted and on held-out sections."""
    rows = []
    for i, e in enumerate(content["errors"]):
        factor, unit = SHOWN[e["unit"]]
        rows.append(
            [
                e["run"],
                e["shape"],
                e["part"],
                number(e["rms"], f"errors.{i}.rms", factor),
                number(e["worst"], f"errors.{i}.worst", factor),
                unit,
                number(e["turn_rms"], f"errors.{i}.turn_rms", SHOWN["rad"][0]),
                number(e["samples"], f"errors.{i}.samples", digits=9),
                number(e["beyond_three"], f"errors.{i}.beyond_three", 100.0),
            ]
        )
    head = (
        "run",
        "shape",
        "part",
        "#RMS",
        "#worst",
        "unit",
        "#angle RMS, deg",
        "#samples",
        "#beyond three, %",
    )
    return Table(head, rows)


def numbers_table(content: Content) -> Table:
    """Return every number of the arm: value, deviation, prior, origin, marks."""
    rows = []
    for i, n in enumerate(content["numbers"]):
        if n["name"].startswith("frame/"):
            continue
        factor = 100.0 if n["kind"] == "factor" else 1.0
        unit = "%" if n["kind"] == "factor" else n["unit"]
        rows.append(
            [
                n["name"],
                number(n["value"], f"numbers.{i}.value", digits=5),
                n["unit"],
                number(n["deviation"], f"numbers.{i}.deviation", factor, 2),
                unit,
                number(n["prior"], f"numbers.{i}.prior", digits=4),
                number(n["prior_deviation"], f"numbers.{i}.prior_deviation", factor, 2),
                n["origin"],
                Cell(", ".join(n["marks"]), is_bad=n["marks"] not in ([], ["fixed"])),
            ]
        )
    head = ("number", "#value", "unit", "#deviation", "", "#prior", "#± ", "origin", "marks")
    return Table(head, rows)


def open_table(content: Content) -> Table:
    """Return what the data do not determine, and what would."""
    rows = [[each["name"], "; ".join(each["open"]), each["experiment"]] for each in content["undetermined"]]
    return Table(("number", "combination that stays open", "what would determine it"), rows)


def combinations_table(content: Content) -> Table:
    """Return the ratios and products that are surer than their numbers."""
    rows = [
        [
            each["name"],
            number(each["value"], f"combinations.{i}.value", digits=5),
            number(each["deviation"], f"combinations.{i}.deviation", 100.0, 2),
        ]
        for i, each in enumerate(content["combinations"])
    ]
    return Table(("combination", "#value", "#deviation, %"), rows)


def profiles_table(content: Content) -> Table:
    """Return what each profile says."""
    rows = [
        [each["name"], "simulated" if each["simulated"] else "linear", each["text"]]
        for each in content["profiles"]
    ]
    return Table(("number", "profile", "shape"), rows)


def repeats_table(content: Content) -> Table:
    """Return the spread between repeats beside the error of the model."""
    rows = []
    for i, each in enumerate(content["repeats"]):
        factor, unit = SHOWN[each["unit"]]
        rows.append(
            [
                each["shape"],
                number(each["spread"], f"repeats.{i}.spread", factor),
                number(each["error"], f"repeats.{i}.error", factor),
                unit,
                number(each["pairs"], f"repeats.{i}.pairs", digits=9),
                number(each["samples"], f"repeats.{i}.samples", digits=9),
            ]
        )
    return Table(
        ("shape", "#spread of repeats", "#error of the model there", "unit", "#with a repeat", "#of"), rows
    )


def frames_tables(content: Content) -> list[Table]:
    """Return where tracker, bodies and cameras are."""
    frames, rows, found = content["frames"], [], []

    def three(values: list[float] | None, path: str, factor: float) -> list[Cell | str]:
        if values is None:
            return ["–"] * 3
        return [number(v, f"{path}.{k}", factor, 4) for k, v in enumerate(values)]

    for kind, what in (("worlds", "world of the robot in the frame of"), ("bodies", "on its section:")):
        for k, each in enumerate(frames[kind]):
            at = f"frames.{kind}.{k}"
            place = three(each["offset_m"], f"{at}.offset_m", 1e3)
            turn = three(each["rotation_vector_rad"], f"{at}.rotation_vector_rad", SHOWN["rad"][0])
            rows.append([f"{what} {each['name']}", *place, *turn])
    if rows:
        head = ("frame", "#x, mm", "#y, mm", "#z, mm", "#rotation x, deg", "#y, deg", "#z, deg")
        found.append(Table(head, rows))
    if frames["cameras"]:
        own = [
            [
                each["name"],
                number(each["turn_rad"], f"frames.cameras.{k}.turn_rad", SHOWN["rad"][0], 4),
                *(
                    number(v, f"frames.cameras.{k}.curvature_per_m.{j}", digits=4)
                    for j, v in enumerate(each["curvature_per_m"])
                ),
            ]
            for k, each in enumerate(frames["cameras"])
        ]
        found.append(Table(("camera", "#turn, deg", "#straight arm: kx, 1/m", "#ky, 1/m"), own))
    return found
