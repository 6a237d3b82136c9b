"""Run the whole tables: ``python -m tests.apparatus [--only faults,fuzz]``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmarks import sections as running
from benchmarks.options import Options
from tests.apparatus import extremes, faults, faults_on_flow, fuzz
from tests.apparatus.fuzz import bags

SECTIONS = {
    "extremes": extremes,
    "faults": faults,
    "faults_on_flow": faults_on_flow,
    "fuzz": fuzz,
    "bags": bags,
}
HEAD = """# Results of the apparatus

Written by `python -m tests.apparatus`; what each section runs is in README.md.
"""
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def apparatus(
    only: Annotated[str, typer.Option(help=f"sections, of {','.join(SECTIONS)}; the others stay")] = "",
    out: Annotated[Path, typer.Option(help="folder of RESULTS.md")] = Path(__file__).parent,
    quick: Annotated[bool, typer.Option(help="a few cells of each, to try the command")] = False,
) -> None:
    """Run every cell, and write RESULTS.md."""
    running.write(SECTIONS, running.chosen(only, SECTIONS), Options(False, quick, out), HEAD)


if __name__ == "__main__":
    app()
