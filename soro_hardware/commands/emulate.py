"""`soro emulate`: the emulated devices of a platform as a process of their own, without ROS."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from soro_core.config import name_argument
from soro_core.files.units import unit_option


def emulate(
    platform: Annotated[str, name_argument("Platform file, or the name of a shipped one.", "platforms")],
    lockstep: Annotated[
        bool,
        typer.Option("--lockstep", help="Advance by one cycle period with each exchange, not by the clock."),
    ] = False,
    rate: Annotated[
        float | None,
        unit_option("--rate", "Hz", help="Of exchanges, as the regulator node's; default: the platform's."),
    ] = None,
    device_link: Annotated[
        Path | None,
        typer.Option(help="Name to make for what the host opens: a link, or a folder of them."),
    ] = None,
    plant_link: Annotated[
        Path | None,
        typer.Option(help="Unix socket to a twin: pressures and what the valves do, and pressures back."),
    ] = None,
    priority: Annotated[
        int,
        typer.Option(
            min=0,
            max=99,
            help="Real-time priority (SCHED_FIFO), above that of the driver as real devices have processors "
            "of their own; 0 for none. Without the right to it the command says so and runs on.",
        ),
    ] = 40,
    seed: Annotated[int, typer.Option(help="Seed of the sensor noise and of chance faults.")] = 0,
    control: Annotated[
        Path | None,
        typer.Option(help="Unix socket on which faults are taken, a line of YAML each; `list` asks."),
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(help="Fault as YAML, 'fault: stuck_open, chamber: link0/chamber1, at: 5'; repeatable."),
    ] = None,
) -> None:
    """Serve the emulated regulators of PLATFORM on pseudo-terminals or a TCP port, until Ctrl-C.

    Prints one line, `ready: <path or address>`, when the devices answer; several ports are
    separated by commas. Give that (or --device-link) to the regulator node as its parameter `device`, and
    --plant-link to the twin as its parameter `plant_link`, with `pressures:=valves`, and with `air:=states`
    if the twin computes the air. The devices behave as real ones do: they boot, check received messages,
    and vent when messages of the host stop, if they have a watchdog.

    Faults are words of one vocabulary, the same for every family (docs/safety.md); the error of a wrong
    word lists all of them.
    """
    # Imported here so that `soro --help` stays quick.
    from soro_hardware import timing
    from soro_hardware.emulation.faults.fault_types import read_injection
    from soro_hardware.emulation.process import serve
    from soro_hardware.families import load_platform

    described = load_platform(platform)
    faults = [read_injection(text, "--fault") for text in fault or ()]
    with timing.punctual(0 if lockstep else priority) as failure:
        if failure:
            typer.echo(f"soro emulate: no real-time priority ({failure}): see docs/real_time.md", err=True)
        serve(
            described if rate is None else described.at_rate(rate),
            clock=time.monotonic_ns,
            announce=lambda path: typer.echo(f"ready: {path}"),
            lockstep=lockstep,
            device_link=device_link,
            plant_link=plant_link,
            seed=seed,
            control=control,
            faults=faults,
        )
