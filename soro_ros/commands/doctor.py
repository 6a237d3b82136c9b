"""`soro doctor`: look at the hardware of a platform, and say what to do for every line that fails."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from soro_core.hardware.finding import Finding

_STYLES = {"ok": "green", "warn": "yellow", "fail": "bold red"}


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
    from soro_core.errors import ConfigError, SoroError
    from soro_core.hardware.doctor import examine
    from soro_core.hardware.platform import load_platform

    try:
        findings = list(examine(load_platform(platform), device, seconds))
    except SoroError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(2 if isinstance(error, ConfigError) else 1) from None
    if as_json:
        typer.echo(json.dumps([finding._asdict() for finding in findings], indent=2))
    else:
        _show(platform, findings)
    if any(finding.level == "fail" for finding in findings):
        raise typer.Exit(1)


def _show(platform: str, findings: list[Finding]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title=f"soro doctor {platform}", title_justify="left", show_lines=False)
    for heading in ("", "what", "found", "what to do"):
        table.add_column(heading, overflow="fold")
    for name, level, found, do in findings:
        table.add_row(Text(level, _STYLES[level]), Text(name), Text(found), Text(do))
    console = Console()
    console.print(table)
    counts = {level: sum(f.level == level for f in findings) for level in _STYLES}
    console.print(f"{counts['ok']} good, {counts['warn']} to read, {counts['fail']} failed")
