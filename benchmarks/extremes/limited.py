"""Cells one after the other in a process of their own, which is ended where a cell takes too long.

A run inside a kernel hears no signal, and the violent cells of many links would take hours.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection

from benchmarks.extremes.cell import Cell, Outcome, Verdict

LIMIT_S = 15.0


def _serve(connection: Connection) -> None:
    while True:
        cell: Cell = connection.recv()
        connection.send(cell.run())


def verdicts(cells: Sequence[Cell], limit_s: float = LIMIT_S) -> Iterator[tuple[Cell, Verdict]]:
    """Run the cells in their order; one that takes longer than `limit_s` is left open."""
    context = multiprocessing.get_context("spawn")
    process, here = None, None
    try:
        for cell in cells:
            if process is None or here is None:
                here, there = context.Pipe()
                process = context.Process(target=_serve, args=(there,), daemon=True)
                process.start()
                here.send(cells[0])  # loads the kernels, which is not the cell's time
                here.recv()
            here.send(cell)
            if here.poll(limit_s):
                yield cell, here.recv()
                continue
            process.kill()
            process.join()
            process = None
            yield cell, Verdict(Outcome.OPEN, f"not at its end after {limit_s:g} s")
    finally:
        if process is not None:
            process.kill()
            process.join()
