"""Entry of the benchmarks: ``python -m benchmarks [--only forward,realtime]``."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.status import Status

from benchmarks import (
    air_fit,
    board,
    can_rates,
    discovery,
    extremes,
    faults,
    faults_on_flow,
    forward,
    fuzz,
    kills,
    peer,
    realtime,
    report,
    serial_rates,
    sixlink,
    startup,
    terms,
    trade,
)
from benchmarks.options import Options
from benchmarks.timing import CLOCK, one_core

# Without a terminal progress is told this often [s].
TELL_S = 20.0

SECTIONS = {
    "startup": startup,
    "discovery": discovery,
    "forward": forward,
    "terms": terms,
    "realtime": realtime,
    "sixlink": sixlink,
    "trade": trade,
    "extremes": extremes,
    "air_fit": air_fit,
    "can_rates": can_rates,
    "serial_rates": serial_rates,
    "board": board,
    "kills": kills,
    "faults": faults,
    "faults_on_flow": faults_on_flow,
    "fuzz": fuzz,
}
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def bench(
    only: Annotated[str, typer.Option(help=f"sections, of {','.join(SECTIONS)}; the others stay")] = "",
    out: Annotated[Path, typer.Option(help="folder of RESULTS.md and the pictures")] = Path(__file__).parent,
    with_peer: Annotated[bool, typer.Option("--peer/--no-peer", help="measure soromox too")] = True,
    quick: Annotated[bool, typer.Option(help="smallest settings: for tests, not for figures")] = False,
) -> None:
    """Measure, and write RESULTS.md."""
    names = [name.strip() for name in only.split(",") if name.strip()] or list(SECTIONS)
    unknown = [name for name in names if name not in SECTIONS]
    if unknown:
        raise typer.BadParameter(
            f"{', '.join(unknown)}: allowed are {', '.join(SECTIONS)}", param_hint="--only"
        )
    console = Console()
    measured = with_peer and peer.available()
    if with_peer and not measured:
        console.print(peer.MISSING)
    out.mkdir(parents=True, exist_ok=True)
    for name in names:
        start = time.perf_counter()
        CLOCK.reset()
        with one_core(), console.status(name) as status:
            module = SECTIONS[name]
            text = module.run(Options(measured, quick, out, _teller(console, status, name)))
        report.write(out / "RESULTS.md", {module.TITLE: f"{text}\n\n{report.machine(CLOCK.share)}"})
        console.print(f"{name}: {time.perf_counter() - start:.0f} s")
        console.print(text, markup=False, highlight=False, soft_wrap=True)
    console.print(f"written: {out / 'RESULTS.md'}")


def _teller(console: Console, status: Status, name: str) -> Callable[[str], None]:
    """What shows the progress of a section: a line that changes, or without a terminal one now and then."""
    told = time.monotonic()

    def say(text: str) -> None:
        nonlocal told
        status.update(f"{name}: {text}")
        if not console.is_terminal and time.monotonic() - told > TELL_S:
            told = time.monotonic()
            console.print(f"{name}: {text}", markup=False, highlight=False, soft_wrap=True)

    return say


if __name__ == "__main__":
    app()
