"""The progress of `soro identify`: a bar of its searches, and how far each of them is."""

from __future__ import annotations

import time
from collections.abc import Callable

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

# Time between two lines of one search, without a terminal [s].
_LINE_S = 10.0


class SearchProgress:
    """A bar that counts searches; without a terminal, a line for each, and one in each 10 s of it.

    How many there will be shows only at the end: laws are added as long as they help. The bar expects that
    one law helps and a second one does not; it grows where more help.

    Parameters
    ----------
    console : Console
    laws : int
        Laws that may be added.
    clock : callable
        Gives the time [s].
    """

    def __init__(self, console: Console, laws: int, clock: Callable[[], float] = time.monotonic) -> None:
        # At rest, linear, all data; with laws, each alone, the two best again, and as much beside the best.
        expected = 3 + (2 * laws + 3 if laws else 0)
        text = "{task.completed} of about {task.total}"
        columns = TextColumn("{task.description}"), BarColumn(), TextColumn(text), TimeElapsedColumn()
        self._console, self._stage, self._clock = console, "", clock
        self._simulations, self._start_s, self._line_s = 0, 0.0, 0.0
        self._bar = Progress(*columns, console=console, disable=not console.is_terminal)
        self._task = self._bar.add_task("states at rest", total=expected)

    def __enter__(self) -> SearchProgress:
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.stop()

    def show(self, stage: str, cost: float) -> None:
        """Show the least cost of the search that runs, and count its simulations."""
        now_s = self._clock()
        if stage != self._stage:
            self._next(stage, now_s)
        self._simulations += 1
        text = f"{stage}: {cost:.4g}"
        if self._simulations > 1:  # a search beside others tells its end alone
            text += f" after {self._simulations} simulations"
        self._bar.update(self._task, description=text)
        if not self._console.is_terminal and now_s - self._line_s >= _LINE_S:
            self._line_s = now_s
            self._print(f"{text}, {now_s - self._start_s:.0f} s")

    def _next(self, stage: str, now_s: float) -> None:
        task = self._bar.tasks[0]
        done = task.completed + bool(self._stage)
        total = max(float(task.total or 0.0), done + 1.0)
        self._bar.update(self._task, completed=int(done), total=int(total))
        self._stage, self._simulations, self._start_s, self._line_s = stage, 0, now_s, now_s
        if not self._console.is_terminal:
            self._print(stage)

    def _print(self, line: str) -> None:
        self._console.print(line, highlight=False, markup=False)
