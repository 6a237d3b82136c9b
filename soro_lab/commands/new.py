"""`soro new ARM`: robot, platform and scene file of your own arm, which run on the twin at once."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer

_LINK = "by link: 80mm,60mm"


def new(
    name: Annotated[
        str,
        typer.Argument(
            metavar="ARM", help="Name of the arm: small letters, digits and _; files begin with it."
        ),
    ],
    links: Annotated[
        int | None,
        typer.Option(help="Number of links; default: as many as the longest list by link has, or 1."),
    ] = None,
    length: Annotated[
        str, typer.Option(help=f"Length of each link, without pressure, like 80mm; {_LINK}. Default 0.1 m.")
    ] = "",
    radius: Annotated[
        str,
        typer.Option(help="Radius of each link, like 13mm, or by link. Default: from mass and length."),
    ] = "",
    mass: Annotated[
        str, typer.Option(help="Mass of each link, like 30g, or by link. Default: from the section.")
    ] = "",
    chambers: Annotated[
        str,
        typer.Option(help="Number of chambers of each link, or by link: 3,3. Default 3, with --planar 2."),
    ] = "",
    pressure_range: Annotated[
        str, typer.Option(help="Lowest and highest gauge pressure, like 0,90kPa; one value: from 0 to it.")
    ] = "",
    axial_stiffness: Annotated[
        str,
        typer.Option(help="Stiffness of each link against stretching, N/m, or by link. Default: E A / L."),
    ] = "",
    bending_stiffness: Annotated[
        str,
        typer.Option(help="Stiffness of each link against bending, Nm/rad, or by link. Default: E I / L."),
    ] = "",
    mounting: Annotated[
        str, typer.Option(help="standing (base below), hanging (base above) or lying (base horizontal).")
    ] = "standing",
    planar: Annotated[
        bool, typer.Option("--planar", help="The arm bends in one plane only, that of its local x axis.")
    ] = False,
    platform: Annotated[
        str,
        typer.Option(
            help="Regulators: emulated, a shipped platform (canopen_socketcan, itv_serial, alicat_serial, "
            "veab_tcp, soro_board, vtem_modbus, ...) or its family. All of them are emulated until the run "
            "says --valves real."
        ),
    ] = "emulated",
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder of the files; default ARM.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
) -> None:
    """Write ARM_robot.yaml, ARM_platform.yaml and ARM_scene.yaml for your own arm, from what you know of it.

    Numbers take a unit (80mm, 30g, 90kPa); alone they are in m, kg, Pa. What is not given is estimated, or
    guessed such that the arm runs on the twin: a comment at each key says what it is, so write your own
    numbers into the files (angles and areas of chambers, sensors, payload, ...). Stiffness is right within a
    factor of two or three at best, until it is identified.

    Exit status 0: written; 2: wrong use, or a file exists.
    """
    from rich.console import Console
    from rich.markup import escape

    from soro_core.errors import ModelError
    from soro_core.robot import load_robot
    from soro_hardware.signals import raised
    from soro_lab.scaffold import ScaffoldOptions, new_arm, write_arm
    from soro_lab.scaffold.reference import reached_tip

    options = ScaffoldOptions(
        name=name,
        links=links,
        length=length,
        radius=radius,
        mass=mass,
        chambers=chambers,
        pressure_range=pressure_range,
        axial_stiffness=axial_stiffness,
        bending_stiffness=bending_stiffness,
        mounting=mounting,
        planar=planar,
        platform=platform,
    )
    folder = Path(name) if out is None else out
    with raised([]):  # a signal leaves no half-made folder
        written = write_arm(new_arm(options), folder, force, typer.echo)
    console = Console(stderr=True)
    for line in written.warnings:
        console.print(f"[yellow]{escape(line)}[/yellow]", soft_wrap=True)
    for path in (written.robot, written.platform, written.scene):
        typer.echo(f"written: {path}")
    typer.echo(f"try it, as fast as possible:  soro run {written.scene} --set mode=lockstep")
    typer.echo(f"in real time, to lead it:     soro run {written.scene} --view")
    with contextlib.suppress(ModelError):  # of an arm without a rest, which the warnings name
        tip = reached_tip(load_robot(written.robot), written.reference)
        typer.echo(f"meanwhile, elsewhere:         soro move to {' '.join(f'{1e3 * x:.1f}' for x in tip)}")
    if platform != "emulated":
        typer.echo(f"valves, without pressure:     soro doctor {written.platform}")
