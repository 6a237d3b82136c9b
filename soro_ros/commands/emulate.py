"""`soro emulate`: the emulated devices of a platform as a process of their own, without ROS."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer


def emulate(
    platform: Annotated[str, typer.Argument(help="Name of a shipped platform, or path of a platform file.")],
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="Advance by one cycle period with each SYNC, not by the clock.")
    ] = False,
    device_link: Annotated[
        Path | None,
        typer.Option(help="Symbolic link to make to the pseudo-terminal, as a stable name for it."),
    ] = None,
    plant_link: Annotated[
        Path | None, typer.Option(help="Unix socket on which the true chamber pressures are published.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the sensor noise.")] = 0,
) -> None:
    """Serve the emulated regulators of PLATFORM on a pseudo-terminal, until Ctrl-C.

    Prints one line, `ready: <path>`, when the devices answer. Give that path (or --device-link) to the
    regulator node as its parameter `device`, and --plant-link to the twin as its parameter `plant_link`, with
    `pressures:=valves`. The devices behave as real ones do: they boot, check what they are sent, and vent
    when their host falls silent.
    """
    # Imported here so that `soro --help` stays quick.
    from soro_core.errors import ConfigError, SoroError
    from soro_core.hardware.emulation.process import serve
    from soro_core.hardware.platform import load_platform

    try:
        serve(
            load_platform(platform),
            clock=time.monotonic_ns,
            announce=lambda path: typer.echo(f"ready: {path}"),
            lockstep=lockstep,
            device_link=device_link,
            plant_link=plant_link,
            seed=seed,
        )
    except SoroError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(2 if isinstance(error, ConfigError) else 1) from None
