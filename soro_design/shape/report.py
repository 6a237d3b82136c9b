"""What a search leaves: a line of progress, a table and a picture of before and after, the part file."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import yaml
from rich.table import Table

from soro_core.config import read_yaml
from soro_core.files.units import unit_of
from soro_design.parts.picture import draw_shapes
from soro_design.parts.specimen import make_specimen
from soro_design.shape.figures import DesignFigures
from soro_design.shape.optimise import ShapeSearch, in_unit
from soro_design.shape.task import wall_of


def line(state: ShapeSearch) -> str:
    """Return the best so far in one line."""
    if state.best is None:
        return "none keeps the limits yet"
    found = state.designs[state.best][1]
    return f"{state.task.goal} {in_unit(state.task.goal, found.goal)}, stretch {found.stretch:.3f}"


def write_designs(state: ShapeSearch, path: Path) -> None:
    """Write a row of each design, on the coarse mesh."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*(one.key for one in state.task.varied), state.task.goal, "stretch", "cause"])
        for point, found in state.designs:
            values = state.task.values(point).values()
            writer.writerow([*values, found.goal, found.stretch, found.cause])


def table(state: ShapeSearch) -> Table:
    """Return dimensions, goal, stretch and wall before and after; the figures on both meshes."""
    task, best = state.task, state.best
    assert best is not None
    after = task.design(state.designs[best][0]).geometry
    made = Table("", "before", "after", title=f"{task.file.name}, {len(state.designs)} designs")
    for one in task.varied:
        made.add_row(one.key, *(_value(one.key, getattr(of, one.key)) for of in (task.geometry, after)))
    for mesh, pair in (
        ("search mesh", (state.start, state.designs[best][1])),
        ("own mesh", (state.before, state.after)),
    ):
        made.add_row(f"{task.goal}, {mesh}", *(_text(found, task.goal) for found in pair))
        made.add_row(f"greatest stretch, {mesh}", *(_text(found) for found in pair))
    made.add_row("least wall", *(_value("wall_m", wall_of(of)) for of in (task.geometry, after)))
    return made


def _value(key: str, value: Any) -> str:
    return f"{1e3 * value:.4g} mm" if unit_of(key) == "m" else f"{value:.4g}"


def _text(found: DesignFigures | None, goal: str = "") -> str:
    if found is None:
        return "not computed"
    if found.cause:
        return "no equilibrium"
    return in_unit(goal, found.goal) if goal else f"{found.stretch:.3f}"


def write_best(state: ShapeSearch, source: Path, path: Path) -> None:
    """Write the part file of the best design: that of the part, with its dimensions."""
    task, best = state.task, state.best
    assert best is not None
    data = read_yaml(source)
    data["geometry"] = {**data["geometry"], **task.values(state.designs[best][0])}
    found = state.after or state.designs[best][1]
    on = "its mesh" if state.after else "a mesh half as fine"
    loads = ", ".join(f"{1e-3 * one:g}" for one in task.sweep.pressures_pa)
    head = (
        f"# {source.name}, optimised by soro design shape for {task.goal} at {loads} kPa:"
        f" {_text(found, task.goal)}, stretch {_text(found)} on {on}.\n"
    )
    body = yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110)
    path.write_text(head + body, encoding="utf-8")


def draw(state: ShapeSearch, path: Path) -> None:
    """Draw the part and the best design under the loads, on their own meshes."""
    task, best = state.task, state.best
    assert best is not None
    assert state.before is not None
    assert state.after is not None
    shapes = {}
    pairs = ((task.file, state.before), (task.design(state.designs[best][0]), state.after))
    for name, (file, found) in zip(("before", "after"), pairs, strict=True):
        title = f"{name}: {in_unit(task.goal, found.goal)}, stretch {found.stretch:.3g}"
        shapes[title] = (make_specimen(file), found.u)
    draw_shapes(path, shapes)
