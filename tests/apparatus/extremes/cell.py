"""What a cell of the table of extremes is: what is run, what must happen, and what did."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from soro_core.errors import SoroError
from soro_core.integrate import Status


class Outcome(Enum):
    """What became of a run."""

    FINISHED = "finished"
    """To its end, finite and physical."""
    STOPPED = "stopped"
    """Early at a physical state, with a status that names cause and remedy."""
    REFUSED = "refused"
    """By one of our errors, before anything ran."""
    OPEN = "open"
    """Not at its end within the time that `limited` gives a cell."""
    NONSENSE = "NONSENSE"
    """Anything else: a number that is none, energy from nowhere, an error of Python's."""


class Must(Enum):
    """What has to happen, stated before the run."""

    FINISH = "finish"
    FINISH_OR_STOP = "finish or stop"
    FINISH_OR_REFUSE = "finish or refuse"
    STOP = "stop"
    REFUSE = "refuse"

    def allows(self, outcome: Outcome) -> bool:
        """Whether that outcome is as stated."""
        return outcome in _ALLOWED[self]


_ALLOWED = {
    Must.FINISH: {Outcome.FINISHED},
    Must.FINISH_OR_STOP: {Outcome.FINISHED, Outcome.STOPPED},
    Must.FINISH_OR_REFUSE: {Outcome.FINISHED, Outcome.REFUSED},
    Must.STOP: {Outcome.STOPPED},
    Must.REFUSE: {Outcome.REFUSED},
}


@dataclass(frozen=True)
class Verdict:
    """Outcome of one cell, with the reason or a figure."""

    outcome: Outcome
    note: str = ""


@dataclass(frozen=True)
class Cell:
    """One cell of the table.

    Attributes
    ----------
    group, row, column : str
        Where it stands: a table a group.
    must : Must
    task : callable
        Runs it; a frozen record, so that the cell is data.
    quick : bool
        Whether pytest runs it too; `python -m tests.apparatus` runs every cell.
    """

    group: str
    row: str
    column: str
    must: Must
    task: Callable[[], Verdict]
    quick: bool = True

    def __str__(self) -> str:
        return f"{self.group}: {self.row}, {self.column}"

    def run(self) -> Verdict:
        """Run it; one of our errors is a refusal, any other one is nonsense."""
        try:
            return self.task()
        except SoroError as error:
            return Verdict(Outcome.REFUSED, str(error))
        except (ArithmeticError, ValueError, TypeError, IndexError) as error:
            return Verdict(Outcome.NONSENSE, f"{type(error).__name__}: {error}")


def stopped(status: Status) -> Verdict:
    """Verdict on a run that ended early at a physical state: the status must say why and what to do."""
    what, _, remedy = status.message.partition("; ")
    good = what.startswith("failed") and ": " in what and remedy != ""
    return Verdict(Outcome.STOPPED if good else Outcome.NONSENSE, status.message)
