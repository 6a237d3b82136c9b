"""`soro design shape`: stated dimensions of a part, optimised under the loads of one of its sweeps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soro_core.config import name_argument
from soro_core.errors import ConfigError, ModelError
from soro_core.files.units import unit_option

if TYPE_CHECKING:
    from soro_design.shape.optimise import ShapeSearch

DESIGNS, PICTURE = "designs.csv", "shape.png"


def shape(
    part: Annotated[str, name_argument("Part file, or the name of a shipped one (config/parts).", "parts")],
    goal: Annotated[str, typer.Option(help="What to make great: stroke, force, bend, stiffness.")],
    vary: Annotated[
        list[str], typer.Option(metavar="KEY=LOW:HIGH", help="Dimension that varies; again for more.")
    ],
    sweep: Annotated[
        str, typer.Option(help="Sweep of the file with the loads; default: the first with air.")
    ] = "",
    pressure: Annotated[
        float | None,
        unit_option(
            "--pressure", "Pa", example="30kPa", show_default=False, help="Greatest one, in place of it."
        ),
    ] = None,
    max_stretch: Annotated[
        float | None,
        typer.Option(help="Greatest stretch; default: where the material breaks.", show_default=False),
    ] = None,
    min_wall: Annotated[
        float, unit_option("--min-wall", "m", lowest=0.0, example="0", help="Least thickness of a wall.")
    ] = 0.0,
    designs: Annotated[
        int | None,
        typer.Option(min=1, help="Most designs; default 20 and 8 a dimension.", show_default=False),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Designs at a time, each in a process.")] = 1,
    dask: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Compute designs on this Dask cluster (extra: dask).")
    ] = "",
    out: Annotated[
        Path | None, typer.Option(help="Folder to write; default PART_shape.", show_default=False)
    ] = None,
) -> None:
    """Optimise dimensions of a rod, bellows, tube or PneuNet for a goal (docs/design.md).

    The search runs on a mesh half as fine as that of the file; the best design is computed on that of the
    file too, on which it keeps the limits. The folder gets the part file, designs.csv and shape.png; Ctrl-C
    keeps the best so far. Exit status 1: no design keeps the limits; 130: Ctrl-C.
    """
    from contextlib import AbstractContextManager, nullcontext

    from rich.console import Console

    from soro_core.config import find_config
    from soro_core.jobs import Here, executor_of
    from soro_design.parts.file import load_part
    from soro_design.shape.optimise import ShapeSearch, default_designs, optimise
    from soro_design.shape.report import line, write_designs
    from soro_design.shape.task import COMMAND, make_task
    from soro_hardware import signals

    path = find_config(part, "parts")
    task = make_task(load_part(path), goal, vary, sweep, pressure, (max_stretch, min_wall))
    folder = Path(f"{task.file.name}_shape") if out is None else out
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        allowed = f"a folder that does not exist and can be made ({error.strerror})"
        raise ConfigError(COMMAND, "--out", str(folder), allowed) from None
    state, console = ShapeSearch(task), Console(stderr=True)
    most = default_designs(task) if designs is None else designs

    def told(now: ShapeSearch) -> None:
        write_designs(now, folder / DESIGNS)
        of = f" of {most}" if len(now.designs) <= most else ""
        console.print(f"{len(now.designs)}{of} designs: {line(now)}", highlight=False)

    is_interrupted = False
    with executor_of(jobs, dask) as executor:
        noted: AbstractContextManager[list[int]] = (
            nullcontext([]) if isinstance(executor, Here) else signals.noted()
        )
        with noted as interrupts:
            try:
                optimise(state, executor, most, told, lambda: bool(interrupts))
            except KeyboardInterrupt:
                is_interrupted = True
            except ModelError:
                if not state.designs:  # nothing is lost, and the same command may be tried again
                    folder.rmdir()
                raise
            is_interrupted = is_interrupted or bool(interrupts)
    _finish(state, path, folder)
    if is_interrupted:
        raise typer.Exit(130)
    if state.is_beyond:
        typer.echo(f"on its own mesh the best design stretches beyond {task.max_stretch:g}", err=True)
        raise typer.Exit(1)


def _finish(state: ShapeSearch, path: Path, folder: Path) -> None:
    from rich.console import Console

    from soro_design.shape.report import draw, table, write_best

    if state.best is None:
        typer.echo("interrupted: no design is known that keeps the limits")
        return
    Console().print(table(state))
    write_best(state, path, folder / f"{state.task.file.name}_shaped.yaml")
    if state.before is not None and state.after is not None and not (state.before.cause or state.after.cause):
        draw(state, folder / PICTURE)
    typer.echo(f"written: {folder}")
