"""`soro doctor`: check the hardware of a platform, with advice for every check that fails."""

from __future__ import annotations

import contextlib
import json
from typing import TYPE_CHECKING, Annotated

import typer

from soro_core.config import completer_of, name_argument
from soro_core.files.units import unit_option

if TYPE_CHECKING:
    from soro_hardware.finding import Finding
    from soro_hardware.hil.dump import DumpConfig
    from soro_hardware.platform import PlatformBase


def doctor(
    platform: Annotated[str, name_argument("Platform file, or the name of a shipped one.", "platforms")],
    device: Annotated[
        str | None,
        typer.Option(help="Path or address in place of the platform's, as that of `soro emulate`."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON list instead of a table.")] = False,
    seconds: Annotated[
        float,
        unit_option(
            "--seconds", "s", 0.0, 60.0, "1s", help="Hold the devices at 0 Pa that long; 0: look only."
        ),
    ] = 1.0,
    scene: Annotated[
        str,
        typer.Option(
            help="Scene whose limits are examined too; default: those of a scene that states none.",
            autocompletion=completer_of("scenes"),
        ),
    ] = "",
    dump: Annotated[
        bool,
        typer.Option("--dump", help="Instead: prove WITH PRESSURE that the dump valve works."),
    ] = False,
    chamber: Annotated[str, typer.Option(help="Chamber for --dump; the platform's first.")] = "",
    pressure: Annotated[
        float, unit_option("--pressure", "Pa", 5e3, 20e3, "8kPa", help="Its gauge pressure for --dump.")
    ] = 8e3,
    within: Annotated[
        float, unit_option("--within", "s", 0.1, 5.0, "2s", help="Time in which --dump must see it empty.")
    ] = 2.0,
    wait: Annotated[
        float, unit_option("--wait", "s", 1.0, 600.0, "60s", help="Longest wait of --dump for the valve.")
    ] = 60.0,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask before --dump.")] = False,
    lockstep: Annotated[
        bool, typer.Option("--lockstep", help="For --dump, with `soro emulate --lockstep` only.")
    ] = False,
) -> None:
    """Examine the hardware of PLATFORM: permissions, adapter, devices, bus load, sensors at rest.

    No pressure is ever commanded, except with --dump, which asks first. Needs no ROS, except where the
    platform has its emergency stop as a topic. The exit status is 0 when nothing fails, else 1; 130 after
    Ctrl-C.
    """
    # Imported here so that `soro --help` stays quick.
    from soro_hardware.doctor import examine
    from soro_hardware.families import load_platform, require_driver

    loaded = load_platform(platform)
    require_driver(loaded)
    interrupted = False
    if dump:
        from soro_hardware.hil.dump import DumpConfig

        config = DumpConfig(pressure_pa=pressure, limit_s=within, wait_s=wait)
        findings, interrupted = _dump(config, loaded, platform, device, chamber, yes, lockstep)
    else:
        limits = None
        if scene:
            from soro_lab.scene import load_scene

            limits = load_scene(scene).limits
        findings = list(examine(loaded, device, seconds, limits=limits))
    if as_json:
        typer.echo(json.dumps([finding._asdict() for finding in findings], indent=2))
    else:
        from soro_ros.host.findings_table import show

        show(f"soro doctor {platform}", findings)
    if interrupted:
        raise typer.Exit(130)
    if any(finding.level == "fail" for finding in findings):
        raise typer.Exit(1)


def _dump(
    config: DumpConfig,
    platform: PlatformBase,
    name: str,
    device: str | None,
    chamber: str,
    yes: bool,
    lockstep: bool,
) -> tuple[list[Finding], bool]:
    """Prove the dump valve; return the findings, and whether Ctrl-C has ended it."""
    from soro_core.errors import ConfigError
    from soro_hardware import signals
    from soro_hardware.hil.dump import dump_limits, prove
    from soro_hardware.hil.paced import PacedRegulator
    from soro_hardware.timing import punctual
    from soro_ros.commands.hil import regulator_of, stop_of

    names = platform.chamber_names
    chamber = chamber or names[0]
    if chamber not in names:
        raise ConfigError("soro doctor", "--chamber", chamber, f"one of {', '.join(names)}")
    limits = dump_limits(platform, config)
    regulator = regulator_of(platform, name, device, lockstep, "soro doctor")
    how = "pull its plug, the emergency stop released" if platform.reads_stop else "press the emergency stop"
    question = f"{config.pressure_pa / 1e3:g} kPa in {chamber}, then you open the dump valve ({how}): go on?"
    if not yes and not typer.confirm(question, err=True):
        raise typer.Exit(1)
    with stop_of(platform) as why_stopped, signals.noted() as stopped, contextlib.closing(regulator):
        regulator.configure()
        guarded = PacedRegulator(platform, regulator, limits, lockstep, why_stopped=why_stopped)
        with punctual():
            found = prove(
                config,
                chamber,
                names.index(chamber),
                guarded,
                lambda text: typer.echo(f"{text} ({how})", err=True),
                lambda: bool(stopped),
            )
    return [found], bool(stopped)
