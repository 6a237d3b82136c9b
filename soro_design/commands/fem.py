"""`soro fem run`: a part under pressures and forces, by finite elements."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soro_core.config import name_argument
from soro_core.errors import ConfigError

if TYPE_CHECKING:
    from rich.console import Console

    from soro_core.jobs import Executor
    from soro_design.fem import EquilibriumState
    from soro_design.parts.file import LoadSweep, PartFile
    from soro_design.parts.folder import SweepFolder
    from soro_design.parts.specimen import Specimen

app = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown")
Jobs = Annotated[int, typer.Option(min=1, help="Sweeps at a time, each in a process.")]
Cluster = Annotated[
    str,
    typer.Option("--dask", metavar="ADDRESS", help="Compute the sweeps on this Dask cluster (extra: dask)."),
]


@app.callback()
def fem() -> None:
    """Compute parts by finite elements."""


@app.command()
def run(
    part: Annotated[str, name_argument("Part file, or the name of a shipped one (config/parts).", "parts")],
    out: Annotated[Path | None, typer.Option(help="Folder to write; default NAME_fem.")] = None,
    force: Annotated[bool, typer.Option(help="Replace the files of an existing folder.")] = False,
    jobs: Jobs = 1,
    dask: Cluster = "",
) -> None:
    """Follow a part through the sweeps of its file; write VTU files, a table and pictures.

    The folder gets SWEEP_NN.vtu for each state, table.csv, backbone.npz of a rod or PneuNet (for `soro
    identify-fem --run`), shapes.png and curves.png. Everything is written as it comes: Ctrl-C keeps what is
    done; with several jobs the sweeps under way end first. Exit status: 0 all sweeps ended; 1 one stopped
    early, its last state is SWEEP_last.vtu; 2 wrong use; 130 after Ctrl-C. See docs/parts.md.
    """
    from rich.console import Console

    from soro_core.jobs import executor_of
    from soro_design.parts.file import load_part
    from soro_design.parts.folder import SweepFolder, greatest_stretch
    from soro_design.parts.picture import draw_curves, draw_shapes
    from soro_design.parts.specimen import make_specimen
    from soro_design.parts.strength import strength_lines

    file = load_part(part)
    folder = Path(f"{file.name}_fem") if out is None else out
    specimen = make_specimen(file)
    with executor_of(jobs, dask) as executor:
        prepare(folder, file, force, "soro fem run")
        kept = SweepFolder(folder, specimen)
        stopped, interrupted = follow_all(file, specimen, kept, Console(stderr=True), executor)
    if kept.rows:
        draw_curves(folder / "curves.png", kept.rows)
        draw_shapes(folder / "shapes.png", {name: (specimen, u) for name, u in kept.shapes.items()})
        typer.echo("\n".join(strength_lines(specimen.part.material, *greatest_stretch(folder))))
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
    file: PartFile, specimen: Specimen, kept: SweepFolder, console: Console, executor: Executor
) -> tuple[list[str], bool]:
    """Follow all sweeps; return the names of those that stopped early, and whether Ctrl-C ended it.

    Parameters
    ----------
    file : PartFile
    specimen : Specimen
        Made of it.
    kept : SweepFolder
        Takes each state: as it is reached, or, from another process, with those of its sweep.
    console : Console
        Shows the progress.
    executor : Executor
        Follows the sweeps; what is kept does not depend on it.
    """
    from contextlib import AbstractContextManager, closing, nullcontext, suppress

    from soro_core.jobs import Here, map_jobs
    from soro_design.parts import sweeps
    from soro_hardware import signals

    mesh, total = specimen.part.mesh, len(file.sweeps)
    console.print(
        f"{file.name}: {len(mesh.cells)} {mesh.kind}, {mesh.points.size} displacements", highlight=False
    )
    is_here, stopped, ended = isinstance(executor, Here), list[str](), list[str]()
    # A sweep in this process is interrupted at once; others come to their end.
    noted: AbstractContextManager[list[int]] = nullcontext([]) if is_here else signals.noted()
    with console.status("") as shown, noted as interrupts:

        def reached(sweep: LoadSweep, state: EquilibriumState) -> None:
            kept.keep(sweep, state)
            shown.update(f"{sweep.name}: load factor {state.load:.3g} of 1")

        job = partial(sweeps.followed, specimen, reached if is_here else sweeps.nothing)
        waiting = map_jobs(job, file.sweeps, executor, stop=lambda: bool(interrupts))
        shown.update(file.sweeps[0].name if is_here else f"0 of {total} sweeps are done")
        with suppress(KeyboardInterrupt), closing(waiting) as solutions:
            for sweep, found in zip(file.sweeps, solutions, strict=False):
                if not is_here:
                    kept.keep_all(sweep, found)
                ended.append(sweep.name)
                text = f"{found.status}, {found.steps} load steps, {found.iterations} iterations"
                if found.cause:
                    last = kept.keep_last(sweep)
                    text = f"stopped: {found.cause}; last state: {last or 'the undeformed one'}"
                    stopped.append(sweep.name)
                console.print(f"{sweep.name}: {text}", highlight=False, markup=False)
                shown.update(f"{len(ended)} of {total} sweeps are done")
    if is_interrupted := len(ended) < total:
        kept.keep_last(file.sweeps[len(ended)])
        text = f"interrupted: {len(ended)} of {total} sweeps are done; what is done is kept"
        console.print(text, highlight=False)
    return stopped, is_interrupted
