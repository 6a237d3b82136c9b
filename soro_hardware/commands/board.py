"""`soro board`: the ports of a board, served to a driver over TCP, without ROS."""

from __future__ import annotations

from typing import Annotated

import typer

from soro_core.config import name_argument


def board(
    config: Annotated[
        str, name_argument("Platform of family soro_board: a shipped name, or a path.", "platforms")
    ],
    listen: Annotated[
        str, typer.Option(help="HOST or HOST:PORT to listen on; every interface and the platform's port.")
    ] = "",
    check: Annotated[bool, typer.Option("--check", help="Test every DAC and ADC, report, and end.")] = False,
    store_safe: Annotated[
        bool,
        typer.Option("--store-safe", help="Make 0 Pa the power-up value of every DAC, test, and end."),
    ] = False,
) -> None:
    """Serve the DACs and ADCs of CONFIG on a Raspberry Pi, until Ctrl-C.

    Brings every port to 0 Pa, tests every chip, and prints one line, `ready: HOST:PORT`, when a driver may
    connect. Every port goes to 0 Pa when the driver falls silent (`watchdog_s`), when a chip fails, and when
    this server ends, is killed or hangs. I2C needs the extra `board`; on a Raspberry Pi without the model the
    same server is the command `soro_board` (docs/board.md).
    """
    # Imported here so that `soro --help` stays quick.
    from soro_hardware.board.pi.server import run_board

    raise typer.Exit(run_board(config, listen, typer.echo, check, store_safe))
