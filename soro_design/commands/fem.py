"""`soro fem run`: a part under pressures and forces, by finite elements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soro_core.config import name_argument
from soro_core.errors import ConfigError

if TYPE_CHECKING:
    from rich.console import Console

    from soro_design.fem import EquilibriumState
    from soro_design.parts.file import LoadSweep, PartFile
    from soro_design.parts.folder import SweepFolder
    from soro_design.parts.specimen import Specimen

app = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")


@app.callback()
def fem() -> None:
    """Compute parts by finite elements."""


@app.command()
def run(
    part: Annotated[str, name_argument("Part file, or the name of a shipped one (config/parts).", "parts")],
    out: Annotated[Path | None, typer.Option(help="Folder to write; default NAME_fem.")] = None,
    force: Annotated[bool, typer.Option(help="Replace the files of an existing folder.")] = False,
) -> None:
    """Follow a part through the sweeps of its file; write VTU files, a table and pictures.

    The folder gets SWEEP_NN.vtu for each state, table.csv, backbone.npz of a rod (for `soro identify-fem
    --run`), shapes.png and curves.png. Everything is written as it comes: Ctrl-C keeps what is done. Exit
    status: 0 all sweeps ended; 1 one stopped early, its last state is SWEEP_last.vtu; 2 wrong use; 130 after
    Ctrl-C. See docs/parts.md.
    """
    from rich.console import Console

    from soro_design.parts.file import load_part
    from soro_design.parts.folder import SweepFolder
    from soro_design.parts.picture import draw_curves, draw_shapes
    from soro_design.parts.specimen import make_specimen

    file = load_part(part)
    folder = Path(f"{file.name}_fem") if out is None else out
    specimen = make_specimen(file)
    prepare(folder, file, force, "soro fem run")
    kept = SweepFolder(folder, specimen)
    console = Console(stderr=True)
    stopped, interrupted = follow_all(file, specimen, kept, console)
    if kept.rows:
        draw_curves(folder / "curves.png", kept.rows)
        draw_shapes(folder / "shapes.png", specimen, kept.shapes)
    typer.echo(f"written: {folder}, {len(kept.rows)} states")
    if interrupted or stopped:
        raise typer.Exit(130 if interrupted else 1)


def prepare(folder: Path, file: PartFile, force: bool, command: str) -> None:
    """Make the folder of a run and write the part into it.

    Parameters
    ----------
    folder : Path
    file : PartFile
    force : bool
        Whether the folder of an earlier run is emptied.
    command : str
        Command that errors name.

    Raises
    ------
    ConfigError
        If there is such a folder, it is not that of a run, or it cannot be made.
    """
    from soro_design.parts.folder import BACKBONE, PART, TABLE

    if folder.exists():
        if not force:
            allowed = "a folder of states that does not exist, or --force"
            raise ConfigError(command, "--out", str(folder), allowed)
        if not (folder / PART).is_file():
            raise ConfigError(command, "--out", str(folder), "with --force, the folder of a run")
        for old in (*folder.glob("*.vtu"), folder / BACKBONE, folder / TABLE):
            old.unlink(missing_ok=True)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        allowed = f"a folder that can be made ({error.strerror})"
        raise ConfigError(command, "--out", str(folder), allowed) from None
    (folder / PART).write_text(file.model_dump_json(indent=1) + "\n", encoding="utf-8")


def follow_all(
    file: PartFile, specimen: Specimen, kept: SweepFolder, console: Console
) -> tuple[list[str], bool]:
    """Follow all sweeps; return the names of those that stopped early, and whether Ctrl-C ended it.

    Parameters
    ----------
    file : PartFile
    specimen : Specimen
        Made of it.
    kept : SweepFolder
        Takes each state.
    console : Console
        Shows the progress.
    """
    from soro_design.parts.sweeps import follow

    mesh = specimen.part.mesh
    console.print(
        f"{file.name}: {len(mesh.cells)} {mesh.kind}, {mesh.points.size} displacements", highlight=False
    )
    stopped: list[str] = []
    with console.status("") as shown:
        for sweep in file.sweeps:

            def reached(state: EquilibriumState, sweep: LoadSweep = sweep) -> None:
                kept.keep(sweep, state)
                shown.update(f"{sweep.name}: load factor {state.load:.3g} of 1")

            shown.update(sweep.name)
            try:
                found = follow(specimen, sweep, reached)
            except KeyboardInterrupt:
                kept.keep_last(sweep)
                console.print(f"{sweep.name}: interrupted; what is done is kept", highlight=False)
                return stopped, True
            text = f"{found.status}, {found.steps} load steps, {found.iterations} iterations"
            if found.cause:
                last = kept.keep_last(sweep)
                text = f"stopped: {found.cause}; last state: {last or 'the undeformed one'}"
                stopped.append(sweep.name)
            console.print(f"{sweep.name}: {text}", highlight=False, markup=False)
    return stopped, False
