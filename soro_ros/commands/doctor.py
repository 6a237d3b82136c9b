"""`soro doctor`: check the hardware of a platform, with advice for every check that fails."""

from __future__ import annotations

import json
from typing import Annotated

import typer


def doctor(
    platform: Annotated[str, typer.Argument(help="Name of a shipped platform, or path of a platform file.")],
    device: Annotated[
        str | None,
        typer.Option(help="Path or address in place of the platform's, as that of `soro emulate`."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON list instead of a table.")] = False,
    seconds: Annotated[
        float, typer.Option(min=0.0, max=60.0, help="Hold the devices at 0 Pa that long; 0: look only.")
    ] = 1.0,
) -> None:
    """Examine the hardware of PLATFORM: permissions, adapter, devices, bus load, sensors at rest.

    No pressure is ever commanded. Needs no ROS. The exit status is 0 when nothing fails, else 1.
    """
    # Imported here so that `soro --help` stays quick.
    from soro_core.hardware.doctor import examine
    from soro_core.hardware.families import load_platform, require_driver

    loaded = load_platform(platform)
    require_driver(loaded)
    findings = list(examine(loaded, device, seconds))
    if as_json:
        typer.echo(json.dumps([finding._asdict() for finding in findings], indent=2))
    else:
        from soro_ros.findings import show

        show(f"soro doctor {platform}", findings)
    if any(finding.level == "fail" for finding in findings):
        raise typer.Exit(1)
