"""Entry of the benchmarks: ``python -m benchmarks [--only forward,realtime]``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from benchmarks import (
    air_fit,
    arms,
    around,
    bags,
    board,
    bodies,
    can_rates,
    composed,
    control,
    derivatives,
    design,
    discovery,
    estimation,
    exoskeleton,
    force,
    forward,
    grasp,
    identified_asu,
    identified_srl,
    identified_tue,
    kills,
    large_solid,
    mismatch,
    motions,
    orders,
    peer,
    realtime,
    recording,
    references,
    report,
    serial_rates,
    sixlink,
    solver,
    startup,
    stops,
    terms,
    trade,
    view,
    whole_way,
)
from benchmarks import sections as running
from benchmarks.options import Options
from benchmarks.timing import one_core

SECTIONS = {
    "startup": startup,
    "discovery": discovery,
    "forward": forward,
    "derivatives": derivatives,
    "terms": terms,
    "realtime": realtime,
    "sixlink": sixlink,
    "trade": trade,
    "orders": orders,
    "air_fit": air_fit,
    "identified_asu": identified_asu,
    "identified_tue": identified_tue,
    "identified_srl": identified_srl,
    "references": references,
    "control": control,
    "mismatch": mismatch,
    "estimation": estimation,
    "force": force,
    "arms": arms,
    "motions": motions,
    "around": around,
    "whole_way": whole_way,
    "design": design,
    "solver": solver,
    "large_solid": large_solid,
    "can_rates": can_rates,
    "serial_rates": serial_rates,
    "board": board,
    "kills": kills,
    "stops": stops,
    "recording": recording,
    "bags": bags,
    "composed": composed,
    "view": view,
    "bodies": bodies,
    "grasp": grasp,
    "exoskeleton": exoskeleton,
}
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def bench(
    only: Annotated[str, typer.Option(help=f"sections, of {','.join(SECTIONS)}; the others stay")] = "",
    out: Annotated[Path, typer.Option(help="folder of RESULTS.md and the pictures")] = Path(__file__).parent,
    with_peer: Annotated[bool, typer.Option("--peer/--no-peer", help="measure soromox too")] = True,
    quick: Annotated[bool, typer.Option(help="smallest settings: for tests, not for figures")] = False,
    minutes: Annotated[float, typer.Option(min=0, help="force: of each scene that nothing touches")] = 0.0,
    seeds: Annotated[int, typer.Option(min=1, help="control, mismatch: seeds of each case")] = 5,
    arms: Annotated[int, typer.Option(min=1, help="control, mismatch: random arms")] = 100,
    jobs: Annotated[int | None, typer.Option(min=1, help="random arms at a time; default one a core")] = None,
    dask: Annotated[str, typer.Option(metavar="ADDRESS", help="run random arms on this Dask cluster")] = "",
) -> None:
    """Measure, and write RESULTS.md."""
    names = running.chosen(only, SECTIONS)
    measured = with_peer and peer.available()
    if with_peer and not measured:
        Console().print(peer.MISSING)
    with one_core():
        options = Options(measured, quick, out, minutes=minutes, seeds=seeds, arms=arms, jobs=jobs, dask=dask)
        running.write(SECTIONS, names, options, report.HEAD)


if __name__ == "__main__":
    app()
