"""`soro scenes`: the shipped scenes and those of a folder, or the file of one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from soro_core.config import find_config
from soro_lab.scene import Scene
from soro_lab.scene.load import scenes_in, shipped_folder

# Width of the tables, at least.
_WIDTH = 130


def scenes(
    name: Annotated[
        str | None, typer.Argument(help="Scene whose file is printed.", show_default=False)
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(exists=True, file_okay=False, help="Folder of your own scenes.", show_default=False),
    ] = None,
) -> None:
    """List the scenes that `soro run` finds by name, and those of a folder of your own.

    With NAME the file of that scene is printed. `soro scenes NAME > my_scene.yaml` makes a copy to change.
    """
    if name is not None:
        own = folder / f"{name}.yaml" if folder is not None else None
        file = own if own is not None and own.is_file() else find_config(name, "scenes")
        typer.echo(file.read_text(encoding="utf-8"), nl=False)
        return
    console = Console()
    console = Console(width=max(console.width, _WIDTH))
    for place, title in ((shipped_folder(), "soro run NAME"), (folder, f"soro run {folder}/NAME.yaml")):
        if place is None:
            continue
        found = scenes_in(place)
        console.print(_table(title, found.scenes))
        for line in found.wrong:
            console.print(f"[red]{escape(line)}[/red]", soft_wrap=True)
        if found.others:
            console.print(f"no scenes: {', '.join(found.others)}", soft_wrap=True, style="dim")


def _table(title: str, rows: tuple[Scene, ...]) -> Table:
    table = Table(title=title, title_justify="left")
    for column in ("scene", "shows", "arm", "platform"):
        table.add_column(column)
    table.add_column("lasts", justify="right")
    table.add_column("ends")
    for scene in rows:
        platform = Path(scene.platform).stem or "none: the twin"
        words = (scene.name, scene.description or "-", Path(scene.robot).stem, platform)
        table.add_row(*map(escape, words), f"{scene.duration_s:g} s", scene.verdict.expected)
    return table
