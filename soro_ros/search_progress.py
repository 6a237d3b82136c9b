"""The progress of `soro identify`: a bar of its searches."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn


class SearchProgress:
    """A bar that counts searches; without a terminal, a line for each.

    How many there will be shows only at the end: laws are added as long as they help. The bar expects that
    one law helps and a second one does not; it grows where more help.

    Parameters
    ----------
    console : Console
    laws : int
        Laws that may be added.
    """

    def __init__(self, console: Console, laws: int) -> None:
        # At rest, linear, all data; with laws, each alone, the two best again, and as much beside the best.
        expected = 3 + (2 * laws + 3 if laws else 0)
        text = "{task.completed} of about {task.total}"
        columns = TextColumn("{task.description}"), BarColumn(), TextColumn(text), TimeElapsedColumn()
        self._console, self._stage = console, ""
        self._bar = Progress(*columns, console=console, disable=not console.is_terminal)
        self._task = self._bar.add_task("states at rest", total=expected)

    def __enter__(self) -> SearchProgress:
        self._bar.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._bar.stop()

    def show(self, stage: str, cost: float) -> None:
        """Show the cost of the search that runs.

        Parameters
        ----------
        stage : str
            What is searched.
        cost : float
        """
        if stage != self._stage:
            self._next(stage)
        self._bar.update(self._task, description=f"{stage}: {cost:.4g}")

    def _next(self, stage: str) -> None:
        task = self._bar.tasks[0]
        done = task.completed + bool(self._stage)
        total = max(float(task.total or 0.0), done + 1.0)
        self._bar.update(self._task, completed=int(done), total=int(total))
        self._stage = stage
        if not self._console.is_terminal:
            self._console.print(stage, highlight=False, markup=False)
