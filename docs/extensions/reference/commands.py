"""The command `soro` and all its commands, as their ``--help`` has them."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any

import typer

from reference.tables import code, plain, table
from soro_ros.cli import application


def pages() -> dict[str, tuple[str, str, str]]:
    """Return the page of the commands."""
    soro = typer.main.get_command(application())
    context = typer.Context(soro, info_name="soro")
    body = "\n".join(
        line for name, command in _leaves(soro, "soro") for line in _section(command, name, context)
    )
    return {"commands": ("Commands", "Arguments and options of each command; `--help` shows the same.", body)}


def _leaves(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the commands that do something, with their full names."""
    inner = getattr(command, "commands", {})
    for key, one in inner.items():
        if not one.hidden:
            yield from _leaves(one, f"{name} {key}")
    if not inner:
        yield name, command


def _section(command: Any, name: str, context: Any) -> Iterator[str]:
    yield f"## {name}\n"
    yield f"    {name} {' '.join(command.collect_usage_pieces(context))}\n"
    yield inspect.cleandoc(command.help or "").replace("<", "&lt;") + "\n"
    records = [parameter.get_help_record(context) for parameter in command.get_params(context)]
    rows = [(code(names), plain(text)) for names, text in filter(None, records) if names != "--help"]
    yield table(("argument or option", "meaning"), rows)
