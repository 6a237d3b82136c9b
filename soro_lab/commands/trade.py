"""`soro trade SCENE`: cost and error of each way to compute the arm, and the best for a requirement."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from soro_core.config import name_argument
from soro_core.files.units import unit_option
from soro_hardware import signals

if TYPE_CHECKING:
    from soro_lab.scene import Requirement, Scene
    from soro_lab.trade.case import TradeCase

WIDTH = 160


def trade(
    scene: Annotated[str, name_argument("Scene or robot: a file or a shipped name.", "scenes", "robots")],
    error: Annotated[
        str,
        typer.Option(
            help="Requirement: cheapest model within this RMS error of the tip, % of the length, like 1%. "
            "The tip alone: errors of shape, energy and frequency stand in the table."
        ),
    ] = "",
    budget: Annotated[
        float | None,
        unit_option("--budget", "s", help="Requirement: longest tick of the most accurate model."),
    ] = None,
    rate: Annotated[
        float | None,
        unit_option("--rate", "Hz", help="Requirement: the same, by the rate that ticks must fit into."),
    ] = None,
    preset: Annotated[str, typer.Option(help="How many combinations: quick, standard or full.")] = "standard",
    seconds: Annotated[
        float | None,
        unit_option("--seconds", "s", 0.1, 600.0, help="Simulated; default: 4 s of a scene, 1 s of a robot."),
    ] = None,
    jobs: Annotated[
        int, typer.Option(min=1, help="Processes that compute errors; times are taken alone.")
    ] = 1,
    dask: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Compute errors on this Dask cluster (extra: dask).")
    ] = "",
    repeats: Annotated[int, typer.Option(min=1, help="Of each time; the median counts.")] = 3,
    out: Annotated[
        Path | None, typer.Option(help="Folder of picture, JSON and block; default trade/NAME.")
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Measure again what is known already, and keep it.")
    ] = False,
) -> None:
    """Measure speed against accuracy for SCENE, and name the model that meets the requirement.

    Without a requirement: that of the scene's `model: auto`, else 1 %. Ctrl-C writes what is done.
    Ends with 0 if a model meets the requirement, with 1 if none does.
    """
    from soro_core.jobs import executor_of
    from soro_lab.commands.trade_report import notes, table, verdict
    from soro_lab.trade.cache import Cache
    from soro_lab.trade.choice import keep_choice
    from soro_lab.trade.grid import PRESETS
    from soro_lab.trade.picture import draw
    from soro_lab.trade.study import Stopped, run_study

    if preset not in PRESETS:
        raise typer.BadParameter(f"{preset}: allowed are {', '.join(PRESETS)}", param_hint="--preset")
    console = Console(stderr=True)
    with signals.noted() as interrupted, executor_of(jobs, dask) as executor:
        loaded, requirement = _requirement(scene, error, budget or 0.0, rate or 0.0)
        folder = _folder(out if out is not None else Path("trade") / Path(scene).stem)
        console.print(f"[dim]requirement: {requirement}[/dim]")
        case = _case(scene, loaded, requirement, seconds or 0.0)
        console.print(f"[dim]excitation: {case.text}[/dim]", soft_wrap=True)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        cache = Cache(fresh=fresh)
        with Progress(*columns, console=console) as bar:
            task = bar.add_task("reference", total=None)

            def show(text: str, done: int, total: int) -> None:
                bar.update(task, description=text, completed=done, total=total or None)

            try:
                study = run_study(
                    case,
                    PRESETS[preset],
                    requirement,
                    executor,
                    cache,
                    repeats,
                    show,
                    lambda: bool(interrupted),
                )
            except Stopped:
                console.print("interrupted: nothing was done yet")
                raise typer.Exit(130) from None
    written = [folder / "trade.png"] if draw(study, folder / "trade.png") else []
    (folder / "trade.json").write_text(json.dumps(study.as_dict(), indent=1) + "\n")
    screen = Console()
    # Wrapped by a narrow terminal, if at all: a cut figure would be worse.
    Console(width=max(WIDTH, screen.width)).print(table(study))
    for line in notes(study):
        screen.print(line, soft_wrap=True, markup=False, highlight=False)
    chosen, block = study.choice, folder / "model.yaml"
    block.unlink(missing_ok=True)  # never that of another requirement
    if chosen is not None and not study.stopped:
        if loaded is not None:
            keep_choice(loaded, requirement, chosen.candidate, cache)
        block.write_text(study.block)
        written.append(block)
    screen.print(f"written: {', '.join(map(str, [*written, folder / 'trade.json']))}", soft_wrap=True)
    screen.print(verdict(study), soft_wrap=True, markup=False, highlight=False)
    if study.stopped:
        raise typer.Exit(130)
    raise typer.Exit(0 if chosen is not None else 1)


def _requirement(name: str, error: str, budget_s: float, rate_hz: float) -> tuple[Scene | None, Requirement]:
    """Return the scene, if there is one, and the requirement; raises ConfigError."""
    from soro_core.config import parse
    from soro_lab.scene import Requirement, load_scene, require_one_arm

    options: dict[str, Any] = {"error": error, "budget_us": 1e6 * budget_s, "rate_hz": rate_hz}
    requirement = parse(options, Requirement, where="soro trade")
    loaded = require_one_arm(load_scene(name), name) if _is_scene(name) else None
    if not requirement.given:
        section = None if loaded is None else loaded.model
        requirement = section.requirement if section is not None and section.auto else Requirement(error="1%")
    return loaded, requirement


def _is_scene(name: str) -> bool:
    """Whether it is a scene, not a robot: robots have links, or those of another one."""
    from soro_core.config import config_folder, read_yaml
    from soro_core.errors import ConfigError, nearest
    from soro_core.robot.load import BASED_ON

    path = Path(name)
    if path.suffix:
        return not {"links", BASED_ON} & read_yaml(path).keys()
    scenes, robots = (
        sorted(file.stem for file in (config_folder() / kind).glob("*.yaml")) for kind in ("scenes", "robots")
    )
    if name not in (*scenes, *robots):
        allowed = f"a path ending in .yaml, a scene ({', '.join(scenes)}) or a robot ({', '.join(robots)})"
        raise ConfigError("soro trade", "SCENE", name, allowed + nearest(name, scenes + robots))
    return name in scenes


def _case(name: str, scene: Scene | None, requirement: Requirement, seconds: float) -> TradeCase:
    from dataclasses import replace

    from soro_core.robot import load_robot
    from soro_lab.trade.case import bare_case, scene_case

    case = bare_case(load_robot(name), seconds or 1.0) if scene is None else scene_case(scene, seconds or 4.0)
    if not requirement.error:  # a requirement of time is about ticks, so that no step may be longer than one
        case = replace(case, paced=True)
    return replace(case, tick_s=1.0 / requirement.rate_hz) if requirement.rate_hz else case


def _folder(path: Path) -> Path:
    from soro_core.errors import ConfigError

    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        allowed = f"a folder that can be written to ({error.strerror})"
        raise ConfigError("--out", "", str(path), allowed) from None
    return path
