"""`soro design`: topology optimisation of soft parts under pressure, and what becomes of its result."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soro_core.config import name_argument
from soro_core.errors import ConfigError, ModelError
from soro_core.files.units import unit_option
from soro_design.commands.shape import shape as shape_command

if TYPE_CHECKING:
    from soro_core.arrays import Array
    from soro_design.topology import FinalPart, OptimiserState, Reanalysis
    from soro_design.topology.domain import Domain
    from soro_design.topology.section import LiddedMotion
    from soro_design.topology.widths import Widths

app = typer.Typer(no_args_is_help=True)
# A part on its own mesh keeps a limit of stretch within this share.
BEYOND = 1.05
TASK_FILE, FILM, PICTURE = "task.yaml", "film.gif", "design.png"
app.command("shape")(shape_command)
Folder = Annotated[Path, typer.Argument(help="Folder of a run.", exists=True, file_okay=False)]


@app.command()
def run(
    task: Annotated[str, name_argument("Task file, or the name of a shipped one (config/design).", "design")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the run; default TASK_design.", show_default=False)
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the run in that folder.")] = False,
) -> None:
    """Distribute material so that air moves an output as far as it can (docs/design.md).

    Prints each iteration, and keeps it: Ctrl-C loses the one under way alone, --resume goes on. The folder
    gets task.yaml, state.npz, iterations.csv, film.gif and design.png, also of a run that stops early, as far
    as it came. Exit status 1: no equilibrium, or the part does not hold air, with the reason; 130: Ctrl-C.
    """
    from soro_core.config import find_config
    from soro_design.topology import load_state, load_task, optimise, save
    from soro_design.topology.domain import make_domain
    from soro_design.topology.optimise import require_sealable
    from soro_design.topology.pictures import film
    from soro_design.topology.repeats import cells_of
    from soro_design.topology.state import STATE
    from soro_design.topology.task import resolved, write_task

    file = find_config(task, "design")
    # The folder of a run needs no other file.
    loaded = resolved(load_task(file), str(file))
    domain = make_domain(loaded, str(file))
    require_sealable(domain, str(file))
    cells_of(domain, str(file))
    folder = Path(f"{file.stem}_design") if out is None else out
    state = None
    if resume:
        state = load_state(folder, domain)
        if load_task(folder / TASK_FILE) != loaded:
            raise ConfigError(str(file), "", "another task than that of the run", f"{folder / TASK_FILE}")
    elif (folder / STATE).exists():
        raise ConfigError("soro design run", "--out", str(folder), "a folder without a run, or --resume")
    folder.mkdir(parents=True, exist_ok=True)
    write_task(loaded, folder / TASK_FILE)

    def keep(now: OptimiserState) -> None:
        nonlocal state
        state = now
        save(now, folder)
        _write_rows(now, folder / "iterations.csv")
        typer.echo(_line(now))

    typer.echo(_HEAD)
    try:
        done = optimise(loaded, state, keep, str(file))
    except KeyboardInterrupt:
        _draw_unfinished(domain, state, folder)
        typer.echo(f"stopped; go on with: soro design run {task} --out {folder} --resume")
        raise typer.Exit(130) from None
    except ModelError:
        _draw_unfinished(domain, state, folder)
        raise
    film(domain, done, folder / FILM)
    try:
        _report(domain, done, folder)
    except KeyboardInterrupt:
        typer.echo(f"stopped; look at the part with: soro design check {folder}")
        raise typer.Exit(130) from None


@app.command()
def check(folder: Folder) -> None:
    """Analyse the final part of a run on a mesh of its own shape: leak, least widths, motion.

    Exit status 1: the part does not hold air, or has no equilibrium under the last pressure.
    """
    domain, state = _loaded(folder)
    _tell_unfinished(domain, state)
    _report(domain, state, folder)


@app.command()
def export(
    source: Annotated[str, typer.Argument(help="Folder of a run, a part file, or a shipped part's name.")],
    stl: Annotated[
        Path | None, typer.Option(help="Surface to write, in millimetres.", show_default=False)
    ] = None,
    step: Annotated[
        Path | None,
        typer.Option(help="Solid of a part file to write, in millimetres.", show_default=False),
    ] = None,
    extrude: Annotated[
        float | None,
        unit_option("--extrude", "m", example="20mm", show_default=False, help="Height along z, of a run."),
    ] = None,
    revolve: Annotated[bool, typer.Option("--revolve", help="Revolve about x = 0, of a run.")] = False,
    pieces: Annotated[int, typer.Option(min=3, help="Flat pieces of a revolution.")] = 96,
) -> None:
    """Write a part as a solid: the final one of a run, with its mirror images, or that of a part file.

    A run becomes an STL file, of a section by --extrude or --revolve, or with the lids of its task; one of
    two materials a file of each, the stiffer one NAME_stiff.stl. A part file (config/parts) becomes a STEP
    file of its exact dimensions, or the STL file of its mesh.
    """
    from soro_design.commands.export_part import export_part, write_surfaces

    for option, path, ending in (("--stl", stl, ".stl"), ("--step", step, ".step")):
        if path is not None and path.suffix != ending:
            raise ConfigError("soro design export", option, str(path), f"a name that ends with {ending}")
    if not Path(source).is_dir():
        if extrude is not None or revolve:
            option = "--revolve" if revolve else "--extrude"
            raise ConfigError("soro design export", option, source, "a folder of a run; a part file is solid")
        export_part(source, stl, step, pieces)
        return
    if step is not None:
        raise ConfigError("soro design export", "--step", source, "a part file; --stl is for a run")
    if stl is None:
        raise ConfigError("soro design export", "--stl", None, "a file to write, of a run")
    if extrude is not None and revolve:
        raise ConfigError("soro design export", "--extrude", "--revolve too", "one of them")
    if extrude is not None and not 0.0 < extrude < float("inf"):
        raise ConfigError("soro design export", "--extrude", extrude, "a height above 0")
    from soro_design.topology import shape
    from soro_design.topology.section import final_surface, lidded_surface, piece

    domain, state = _loaded(Path(source))
    space, has_lids = domain.task.space, domain.task.lid_mm is not None
    option = "--revolve" if revolve else "--extrude" if extrude is not None else ""
    if has_lids and option:
        allowed = "neither --extrude nor --revolve: the task has lid_mm, and its own height"
        raise ConfigError("soro design export", option, source, allowed)
    if (
        not has_lids
        and option != {"axisymmetric": "--revolve", "plane_strain": "--extrude", "solid": ""}[space]
    ):
        allowed = "--extrude HEIGHT of one in plane strain, --revolve about an axis, neither of a solid"
        raise ConfigError("soro design export", option or "--extrude", f"a task in {space}", allowed)
    _tell_unfinished(domain, state)
    part = shape(domain, state)
    if part.leak:
        raise ModelError(f"no part to export: {part.leak}", "leak")
    if has_lids:
        write_surfaces({stl: lidded_surface(domain, part.cut)})
    else:
        meshes = {stl: part.mesh}
        if part.is_stiff is not None:
            second = stl.with_stem(f"{stl.stem}_stiff")
            kinds = {stl: ~part.is_stiff, second: part.is_stiff}
            meshes = {path: piece(part.mesh, kind) for path, kind in kinds.items() if kind.any()}
        write_surfaces(
            {path: final_surface(domain.task, mesh, extrude or 0.0, pieces) for path, mesh in meshes.items()}
        )


_HEAD = f"{'iteration':>9} {'goal':>12} {'motion mm':>9} {'volume':>7} {'grey':>6} {'residual':>8} {'kPa':>7}"


def _line(state: OptimiserState) -> str:
    row = state.rows[-1]
    back = "  pressure lowered: no equilibrium above" if row.eased < 1.0 else ""
    return (
        f"{row.iteration:9d} {row.objective:12.5g} {1e3 * row.motion_m:9.4f} {row.volume:7.4f} "
        f"{row.greyness:6.3f} {row.residual:8.1e} {1e-3 * row.pressure_pa:7.3g}{back}"
    )


def _write_rows(state: OptimiserState, path: Path) -> None:
    from dataclasses import asdict

    rows = [asdict(row) for row in state.rows]
    lines = [",".join(rows[0]), *(",".join(map(str, row.values())) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _loaded(folder: Path) -> tuple[Domain, OptimiserState]:
    from soro_design.topology import load_state, load_task
    from soro_design.topology.domain import make_domain

    domain = make_domain(load_task(folder / TASK_FILE), str(folder / TASK_FILE))
    state = load_state(folder, domain)
    if not state.rows:
        raise ConfigError(str(folder), "", "a run without an iteration", "`soro design run` first")
    return domain, state


def _tell_unfinished(domain: Domain, state: OptimiserState) -> None:
    row, count = state.rows[-1], domain.task.schedule.iterations
    if row.iteration < count:
        grey = f"greyness {row.greyness:.2f}: no final part"
        typer.echo(
            f"soro: {row.iteration} of {count} iterations, {grey} (soro design run --resume)", err=True
        )


def _draw_unfinished(domain: Domain, state: OptimiserState | None, folder: Path) -> None:
    """Draw a run that stops early, as far as it came."""
    from soro_design.topology import shape
    from soro_design.topology.pictures import film, picture

    if state is None or not state.rows:
        return
    try:
        found = shape(domain, state)
    except ModelError:  # no solid at the output yet
        found = None
    film(domain, state, folder / FILM)
    picture(domain, state, found, None, folder / PICTURE)
    typer.echo(f"written: {folder / FILM}, {folder / PICTURE}")


def _report(domain: Domain, state: OptimiserState, folder: Path) -> None:
    """Print what the final part is, draw it, and end with status 1 where it is of no use."""
    from rich.console import Console
    from rich.table import Table

    from soro_design.topology import reanalyse, shape
    from soro_design.topology.goals import Farthest
    from soro_design.topology.pictures import picture
    from soro_design.topology.section import reanalyse_with_lids
    from soro_design.topology.widths import PRINTABLE_M, least_widths

    try:
        found = shape(domain, state)
    except ModelError:
        picture(domain, state, None, None, folder / PICTURE)
        raise
    is_moved = isinstance(domain.task.goal, Farthest) and not found.leak
    if is_moved:
        typer.echo("analysing the part on a mesh of its own shape, up to a minute")
    moved = reanalyse(domain, found) if is_moved else None
    table = Table("", f"{folder}, {len(state.rows)} iterations")
    widths = least_widths(domain, found.mesh)
    for name, value in _numbers(domain, state, found, widths, moved):
        table.add_row(name, value)
    Console().print(table)
    picture(domain, state, found, moved, folder / PICTURE)
    typer.echo(f"written: {folder / 'design.png'}")
    if is_moved and widths.solid_m < PRINTABLE_M:
        thin = _width(widths.solid_m, widths.solid_at)
        least = f"at least {1e3 * PRINTABLE_M:g} mm"
        typer.echo(f"soro: a wall or hinge of {thin} tears or is not printed: {least}", err=True)
    limit = domain.stretch_limit
    if moved and limit is not None and moved.stretch > BEYOND * limit:
        told = f"{moved.stretch:.3f} on its own mesh, at most {limit:g}"
        typer.echo(f"soro: the part does not keep its limit of stretch: {told}", err=True)
    reasons = [reason for reason in (found.leak, moved.cause if moved else "") if reason]
    if moved and not reasons and domain.task.lid_mm is not None:
        typer.echo("analysing the part with lids as a solid, up to some minutes")
        lidded = reanalyse_with_lids(domain, state.filtered, moved.motion_m)
        for line in _of_lids(domain, lidded):
            typer.echo(line)
        reasons += [f"with lids: {lidded.moved.cause}"] if lidded.moved.cause else []
    for reason in reasons:
        typer.echo(f"soro: {reason}", err=True)
    if reasons:
        raise typer.Exit(1)


def _width(width_m: float, at: Array) -> str:
    from soro_design.topology.physics.grid import place_text

    return f"{1e3 * width_m:.3f} mm at {place_text(at)}" if width_m < float("inf") else "none"


def _numbers(
    domain: Domain, state: OptimiserState, found: FinalPart, widths: Widths, moved: Reanalysis | None
) -> list[tuple[str, str]]:
    import numpy as np

    row = state.rows[-1]
    share = found.volume_m3 / domain.grid.volumes.sum()
    rows = [
        ("goal, first and last", f"{state.rows[0].objective:.5g}, {row.objective:.5g}"),
        ("solid, of the grid and of the part", f"{row.volume:.4f}, {share:.4f}"),
        ("greyness", f"{row.greyness:.3f}"),
        ("leak", found.leak or "none"),
        ("closed void, nodes", f"{int(found.air.is_closed.sum())}"),
        ("thinnest wall", _width(found.wall_m, found.wall_at)),
        ("least wall or hinge", _width(widths.solid_m, widths.solid_at)),
        ("least gap", _width(widths.gap_m, widths.gap_at)),
    ]
    if found.is_stiff is not None:
        stiff = found.stiff_m3 / domain.grid.volumes.sum()
        rows.append(("stiffer material, of the grid and of the part", f"{row.stiff:.4f}, {stiff:.4f}"))
    if moved is None:
        return rows
    gap = moved.motion_m / row.motion_m - 1.0
    lowered = f", under {1e-3 * row.pressure_pa:.3g} kPa alone" if row.eased < 1.0 else ""
    side, degrees = "left" if moved.turn < 0.0 else "right", np.degrees(abs(moved.turn))
    turn = f", turned {side} by {degrees:.0f} degrees" if degrees >= 0.5 else ""
    return [
        *rows,
        ("motion with spring, grid", f"{1e3 * row.motion_m:.3f} mm{lowered}"),
        ("motion with spring, own mesh", f"{1e3 * moved.motion_m:.3f} mm ({gap:+.1%})"),
        ("motion without spring, own mesh", f"{1e3 * moved.free_m:.3f} mm{turn}"),
        ("greatest stretch, grid and own mesh", f"{row.stretch:.3f}, {moved.stretch:.3f}{_allowed(domain)}"),
    ]


def _allowed(domain: Domain) -> str:
    return "" if domain.stretch_limit is None else f", limit {domain.stretch_limit:g}"


def _of_lids(domain: Domain, found: LiddedMotion) -> list[str]:
    """Return lines on what lids take of the motion."""
    task, motion, section = domain.task, found.moved.motion_m, found.section_m
    return [
        f"lids of {1e3 * task.lid_m:g} mm, height {1e3 * task.height_m:g} mm; half of it as "
        f"{len(found.mesh.cells)} {found.mesh.kind}",
        f"motion with spring, with lids: {1e3 * motion:.3f} mm, in the middle of the height "
        f"{1e3 * found.middle_m:.3f} mm; greatest stretch {found.moved.stretch:.3f}",
        f"of the same section in plane strain, as coarse: {1e3 * section:.3f} mm, so that lids change it by "
        f"{motion / section - 1.0:+.0%}",
    ]
