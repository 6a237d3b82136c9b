"""Run sections one after the other, show their progress, and write each into RESULTS.md."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import typer
from rich.console import Console
from rich.status import Status

from benchmarks import report
from benchmarks.options import Options
from benchmarks.timing import CLOCK

# Without a terminal progress is printed this often [s].
PROGRESS_S = 20.0


class Section(Protocol):
    """A module that writes one section."""

    TITLE: str

    def run(self, options: Options) -> str:
        """Return its text."""


def chosen(only: str, sections: Mapping[str, Section]) -> list[str]:
    """Return the names in a list separated by commas; all of them if it is empty.

    Raises
    ------
    typer.BadParameter
        If a name is unknown.
    """
    names = [name.strip() for name in only.split(",") if name.strip()] or list(sections)
    unknown = [name for name in names if name not in sections]
    if unknown:
        raise typer.BadParameter(
            f"{', '.join(unknown)}: allowed are {', '.join(sections)}", param_hint="--only"
        )
    return names


def write(sections: Mapping[str, Section], names: Sequence[str], options: Options, head: str) -> None:
    """Run the named sections and write RESULTS.md, which begins with `head`; `options.say` is not used."""
    console = Console()
    options.folder.mkdir(parents=True, exist_ok=True)
    path = options.folder / "RESULTS.md"
    for name in names:
        start = time.perf_counter()
        CLOCK.reset()
        with console.status(name) as status:
            module = sections[name]
            text = module.run(replace(options, say=_progress(console, status, name)))
        report.write(path, {module.TITLE: f"{text}\n\n{report.machine(CLOCK.share)}"}, head)
        console.print(f"{name}: {time.perf_counter() - start:.0f} s")
        console.print(text, markup=False, highlight=False, soft_wrap=True)
    console.print(f"written: {path}")


def _progress(console: Console, status: Status, name: str) -> Callable[[str], None]:
    """Show the progress of a section in a line that changes; without a terminal, print it now and then."""
    printed = time.monotonic()

    def say(text: str) -> None:
        nonlocal printed
        status.update(f"{name}: {text}")
        if not console.is_terminal and time.monotonic() - printed > PROGRESS_S:
            printed = time.monotonic()
            console.print(f"{name}: {text}", markup=False, highlight=False, soft_wrap=True)

    return say
