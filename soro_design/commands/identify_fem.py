"""`soro identify-fem`: the robot file of a part, by finite elements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from soro_core.config import name_argument
from soro_core.errors import ConfigError, SoroError
from soro_design.commands.fem import Cluster, Jobs


def identify_fem(
    part: Annotated[
        str, name_argument("Part file of a rod or PneuNet, or the name of a shipped one.", "parts")
    ],
    out: Annotated[Path, typer.Option(help="Robot file to write (YAML).", show_default=False)],
    run: Annotated[
        Path | None,
        typer.Option(
            help="Folder of `soro fem run` of the same part; default: its sweeps are computed, into NAME_fem "
            "beside --out.",
            show_default=False,
        ),
    ] = None,
    modes: Annotated[
        int,
        typer.Option(min=0, max=3, help="Modes of each strain in the robot file; 0: constant strains."),
    ] = 0,
    accept: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="Greatest error of a held-out tip and of the mesh, in % of the length; above, exit 1.",
        ),
    ] = 4.0,
    report: Annotated[
        Path | None, typer.Option(help="Folder for a page with pictures and numbers.", show_default=False)
    ] = None,
    mesh_check: Annotated[
        bool, typer.Option(help="Compute one sweep on a coarser mesh too, for the line on the mesh.")
    ] = True,
    force: Annotated[bool, typer.Option(help="Replace what exists.")] = False,
    jobs: Jobs = 1,
    dask: Cluster = "",
) -> None:
    """Find the numbers of a link that moves like a part; write its robot file, and a scene in which it moves.

    Forces come first, because pressures alone give only the ratio of stiffness to area; then all states are
    fitted together. Held-out sweeps judge the result. Creep stays to be measured, and damping where the part
    file has no viscosity. A robot that is accepted gets NAME_platform.yaml and NAME_scene.yaml beside it:
    `soro run NAME_scene.yaml`. Exit status: 0 found and accepted; 1 not accepted, the file is written; 2
    wrong use, nothing is written; 130 after Ctrl-C, the states that are done are kept. See docs/parts.md.
    """
    from dataclasses import replace

    from rich.console import Console

    from soro_core.jobs import executor_of
    from soro_design.commands.fem import follow_all, prepare
    from soro_design.parts.file import load_part
    from soro_design.parts.folder import SweepFolder, greatest_stretch, load_backbones
    from soro_design.parts.specimen import RodSpecimen, make_specimen
    from soro_design.parts.strength import strength_lines
    from soro_design.robot_of_part import stages
    from soro_design.robot_of_part.report import content_of, write_report
    from soro_design.robot_of_part.scene import beside, write_scene
    from soro_design.robot_of_part.snapshots import check_sweeps, snapshots
    from soro_design.robot_of_part.written import number_table, quality, write_robot

    name = "soro identify-fem"
    if out.suffix not in (".yaml", ".yml"):
        raise ConfigError(name, "--out", str(out), "a name that ends with .yaml")
    if not out.parent.is_dir():
        raise ConfigError(name, "--out", str(out), "a file in a folder that exists")
    for option, path in (*(("--out", one) for one in (out, *beside(out))), ("--report", report)):
        if path is not None and path.exists() and not force:
            raise ConfigError(name, option, str(path), "what does not exist, or --force")
    file = load_part(part)
    specimen = make_specimen(file)
    if not isinstance(specimen, RodSpecimen):
        raise ConfigError(
            part, "geometry.kind", file.geometry.kind, "rod_with_chambers or pneunet: a robot bends"
        )
    if file.contact is not None:
        raise ConfigError(part, "contact", "surfaces that touch", "none: a link touches nothing")
    check_sweeps(file.sweeps, specimen.chambers, part)
    console = Console(stderr=True)
    folder = out.with_name(f"{out.stem}_fem") if run is None else run
    if run is None:
        with executor_of(jobs, dask) as executor:
            prepare(folder, file, force, name)
            kept = SweepFolder(folder, specimen)
            stopped, interrupted = follow_all(file, specimen, kept, console, executor)
        if interrupted:
            raise typer.Exit(130)
        if stopped:
            console.print(f"fitted up to where {', '.join(stopped)} stopped", highlight=False, markup=False)
        z, states = specimen.z, kept.backbones
    else:
        z, states = load_backbones(folder, file)
    data = snapshots(z, states, part)
    with console.status("") as shown:
        try:
            found = stages.identify(file, specimen, data, out.stem, modes, shown.update)
            if mesh_check:
                shown.update("a coarser mesh")
                found = replace(found, mesh=stages.mesh_check(file, specimen, data))
        except KeyboardInterrupt:
            console.print("interrupted; the states are kept", highlight=False)
            raise typer.Exit(130) from None
    strength = strength_lines(specimen.part.material, *greatest_stretch(folder))
    is_held = any(tendon.stiffness_n for tendon in file.tendons)
    found = replace(found, strength=tuple(strength), has_stiff_tendon=is_held)
    written = write_robot(found, file.name, out)
    content = content_of(found, file.name, out.name, 0.01 * accept)
    if report is not None:
        written.append(write_report(content, found, report))
    typer.echo("\n".join([*quality(found), "", *number_table(found)]))
    refused, (_, scene) = content["refusal"], beside(out)
    if not refused:
        try:
            files, warnings = write_scene(found, out)
        except SoroError as error:
            console.print(f"no scene: {error}", highlight=False, markup=False, soft_wrap=True)
        else:
            written += files
            for line in warnings:
                console.print(line, highlight=False, markup=False, soft_wrap=True)
    typer.echo(f"written: {', '.join(map(str, written))}")
    if scene in written:
        typer.echo(f"run it on the twin: soro run {scene}")
    if found.is_interrupted:
        raise typer.Exit(130)
    if refused:
        typer.echo(f"not accepted: {refused}", err=True)
        raise typer.Exit(1)
