"""Cells in processes of their own, one a core, each ended where a cell takes too long.

A run inside a kernel hears no signal, and the violent cells of many links would take hours.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from queue import SimpleQueue

from tests.apparatus.extremes.cell import Cell, Must, Outcome, Verdict

# Wall time [s] of a cell that may stop as well, and of one that must finish.
LIMIT_S, MUST_LIMIT_S = 15.0, 120.0


def verdicts(cells: Sequence[Cell]) -> Iterator[tuple[Cell, Verdict]]:
    """Run the cells; one that takes longer than its limit is left open. They come in their order."""
    cores = os.cpu_count() or 1
    runners: SimpleQueue[_Runner] = SimpleQueue()
    every = [_Runner(cells[0]) for _ in range(cores)]
    for runner in every:
        runners.put(runner)

    def run(cell: Cell) -> Verdict:
        runner = runners.get()
        try:
            return runner.run(cell)
        finally:
            runners.put(runner)

    pool = ThreadPoolExecutor(cores)
    try:
        yield from zip(cells, pool.map(run, cells), strict=True)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for runner in every:
            runner.end()


class _Runner:
    """A process that runs one cell after the other; replaced where it had to be ended."""

    def __init__(self, first: Cell) -> None:
        self._first = first
        self._process: SpawnProcess | None = None
        self._here: Connection | None = None

    def run(self, cell: Cell) -> Verdict:
        if self._process is None or self._here is None:
            context = multiprocessing.get_context("spawn")
            self._here, there = context.Pipe()
            self._process = context.Process(target=_serve, args=(there,), daemon=True)
            self._process.start()
            self._here.send(self._first)  # loads the kernels, which is not the cell's time
            self._here.recv()
        self._here.send(cell)
        limit_s = MUST_LIMIT_S if cell.must is Must.FINISH else LIMIT_S
        if self._here.poll(limit_s):
            return self._here.recv()
        self.end()
        return Verdict(Outcome.OPEN, f"not at its end after {limit_s:g} s")

    def end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.join()


def _serve(connection: Connection) -> None:
    while True:
        cell: Cell = connection.recv()
        connection.send(cell.run())
