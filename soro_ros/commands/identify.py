"""`soro identify`: the numbers of an arm from recordings of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soro_core.errors import ConfigError

if TYPE_CHECKING:
    from soro_core.identification.recording import Recording
    from soro_core.robot import Robot


def identify(
    robot: Annotated[
        str,
        typer.Argument(
            help="Robot file whose geometry and masses hold; its other numbers are first guesses."
        ),
    ],
    recordings: Annotated[
        list[Path],
        typer.Argument(
            help="Bags (folders of runs or of bags, MCAP files) and CSV files.", show_default=False
        ),
    ],
    out: Annotated[Path, typer.Option(help="Robot file to write (YAML).", show_default=False)],
    columns: Annotated[
        list[str] | None,
        typer.Option(
            help="Column map of the CSV files: a YAML file, or the name of a shipped one. One for all, or "
            "one for each CSV file in their order.",
            show_default=False,
        ),
    ] = None,
    accept: Annotated[
        float,
        typer.Option(
            min=0.0, help="Largest RMS error on held-out sections, in % of the range moved; above it, exit 1."
        ),
    ] = 10.0,
    laws: Annotated[
        str | None,
        typer.Option(
            help="Laws that may be added, with commas: " + "hyper-elastic, area slope, saturating area, "
            "dead band, creep, slow creep, Dahl hysteresis; none for the linear law. Default: all."
        ),
    ] = None,
    step_ms: Annotated[
        float,
        typer.Option(min=0.1, max=50.0, help="Step of simulations of the last fit; others take twice that."),
    ] = 2.5,
    rate_hz: Annotated[float, typer.Option(min=1.0, help="Samples a second that are compared.")] = 25.0,
    starts: Annotated[int, typer.Option(min=1, help="Starts of the search at states at rest.")] = 3,
    seed: Annotated[int, typer.Option(help="Seed of these starts.")] = 1,
    force: Annotated[bool, typer.Option(help="Replace --out if it exists.")] = False,
) -> None:
    """Find stiffness, damping, gains and laws of an arm from recordings; write its robot file.

    The file has the deviation and the origin of each number. Some sections of every recording are held out:
    they choose the laws, and their error is the one that counts. Ctrl-C keeps the best so far. Exit status:
    0 found, 1 not accepted, 2 wrong use. See docs/identification.md.
    """
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from soro_core.identification.arm.laws import LAWS
    from soro_core.identification.arm.stages import Options
    from soro_core.identification.arm.stages import identify as search
    from soro_core.identification.arm.written import number_table, robot_text
    from soro_core.identification.recording import summary
    from soro_core.robot import load_robot

    if out.exists() and not force:
        raise ConfigError("soro identify", "--out", str(out), "a file that does not exist, or --force")
    if out.suffix not in (".yaml", ".yml"):
        raise ConfigError("soro identify", "--out", str(out), "a name that ends with .yaml")
    names = [law.name for law in LAWS] if laws is None else [name.strip() for name in laws.split(",")]
    if names == ["none"]:
        names = []
    odd = [name for name in names if name not in {law.name for law in LAWS}]
    if odd:
        raise ConfigError("soro identify", "--laws", odd[0], ", ".join(law.name for law in LAWS))
    described = load_robot(robot)
    console = Console(stderr=True)
    read = _read(recordings, columns or [], described)
    for recording in read:
        console.print(summary(recording), highlight=False, markup=False)
    options = Options(
        dt_s=1e-3 * step_ms,
        rate_hz=rate_hz,
        laws=tuple(law for law in LAWS if law.name in names),
        starts=starts,
        seed=seed,
    )
    bar = Progress(SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=console)
    with bar:
        task = bar.add_task("states at rest", total=None)
        found = search(
            described,
            read,
            options,
            lambda stage, cost: bar.update(task, description=f"{stage}: {cost:.4g}"),
        )
    if found.choice is not None:
        for trial in found.choice.tried:
            mark = "*" if trial is found.choice.chosen else " "
            typer.echo(f"{mark} {100 * trial.error:6.2f} % of the range, held out: {trial.name}")
    for what, those in (("fitted", found.fitted), ("held out", found.held_out)):
        for error in those:
            typer.echo(f"  {what}: {error}")
    typer.echo("\n".join(number_table(found)))
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(robot_text(found, [path.name for path in recordings]), encoding="utf-8")
    typer.echo(f"written: {out}")
    if not found.held_out:
        typer.echo("nothing could be held out: the error on other data is not known", err=True)
    elif 100 * found.held_out_share > accept:
        size = f"{100 * found.held_out_share:.3g} % of the range"
        typer.echo(f"not accepted: RMS error {size}; allowed is {accept:g} %", err=True)
        raise typer.Exit(1)


def _read(paths: list[Path], columns: list[str], robot: Robot) -> list[Recording]:
    from soro_core.identification.recording import read_bag, read_csv

    tables = [path for path in paths if path.suffix == ".csv"]
    if tables and len(columns) not in (1, len(tables)):
        allowed = "one column map, or one for each CSV file"
        raise ConfigError("soro identify", "--columns", f"{len(columns)} for {len(tables)} files", allowed)
    maps = dict(zip(tables, columns * len(tables) if len(columns) == 1 else columns, strict=False))
    return [read_csv(p, maps[p], robot) if p in maps else read_bag(p, robot) for p in paths]
