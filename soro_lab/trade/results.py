"""Results of a study: a row for each candidate, the front, and the choice for the requirement."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

from soro_lab.scene import Requirement
from soro_lab.trade.candidate import Candidate
from soro_lab.trade.case import TradeCase
from soro_lab.trade.cost import Cost
from soro_lab.trade.reference import ReferenceRun
from soro_lab.trade.slow_metrics import LoopError
from soro_lab.trade.trace import Errors

Item = TypeVar("Item")
Measure = Callable[[Item], float]


def pareto(items: Sequence[Item], cost: Measure[Item], error: Measure[Item]) -> list[Item]:
    """Return the items of the Pareto front, cheapest first.

    Parameters
    ----------
    items : sequence
    cost, error : callable
        Functions that return cost and error of an item.

    Returns
    -------
    list
        Items that no other equals or exceeds in both.
    """
    front: list[Item] = []
    least = float("inf")
    for item in sorted(items, key=lambda one: (cost(one), error(one))):
        if error(item) < least:
            front.append(item)
            least = error(item)
    return front


def near_front(items: Sequence[Item], cost: Measure[Item], error: Measure[Item], factor: float) -> list[Item]:
    """Return the Pareto front, then the items near it.

    Parameters
    ----------
    items : sequence
    cost, error : callable
        Functions that return cost and error of an item.
    factor : float
        An item is near if no item of the front is better by more than this factor in both.
    """
    front = pareto(items, cost, error)
    near = [
        item
        for item in items
        if item not in front
        and not any(factor * cost(f) < cost(item) and factor * error(f) < error(item) for f in front)
    ]
    return [*front, *near]


@dataclass(frozen=True)
class CandidateResult:
    """Results of one candidate."""

    candidate: Candidate
    """The discretisation."""
    errors: Errors | None
    """Against the reference run; None if it failed."""
    failure: str = ""
    """Why it failed; empty if it did not."""
    cost: Cost | None = None
    """Times of computation; None if not measured."""
    loop: LoopError | None = None
    """Error of the closed loop; None if not run."""
    measured_per_m: float | None = None
    """RMS error of the curvature against the measured run [1/m]."""

    @property
    def complete(self) -> bool:
        """Whether both error and cost are known."""
        return self.errors is not None and self.cost is not None

    @property
    def tip(self) -> float:
        """Error of the tip, % of the length; infinite if unknown."""
        return self.errors.tip if self.errors else math.inf

    @property
    def cpu(self) -> float:
        """CPU time of a simulated second [s]; infinite if not measured."""
        return self.cost.cpu_s_per_s if self.cost else math.inf

    @property
    def tick_us(self) -> float:
        """Longest tick [us]; infinite if not measured."""
        return self.cost.worst_tick_us if self.cost else math.inf

    def price(self, requirement: Requirement) -> float:
        """Return the cost: CPU time for a required error, the longest tick for a required time."""
        return self.cpu if requirement.error else self.tick_us


@dataclass(frozen=True)
class Study:
    """Results of a study."""

    case: TradeCase
    """What was computed."""
    requirement: Requirement
    """What the choice must meet."""
    reference: ReferenceRun
    """The finest run, which errors are taken from."""
    rows: tuple[CandidateResult, ...]
    """One a candidate."""
    combinations: int
    """All combinations of the grid."""
    refused: dict[str, str] = field(default_factory=dict)
    """Shape functions that the robot does not allow, with reasons."""
    stopped: bool = False
    """Whether the user stopped it before its end."""

    @property
    def front(self) -> list[CandidateResult]:
        """Pareto front of tip error and cost, cheapest first."""
        complete = [row for row in self.rows if row.complete]
        return pareto(complete, lambda r: r.price(self.requirement), lambda r: r.tip)

    def meets(self, row: CandidateResult) -> bool:
        """Whether a row meets the requirement, with the reference's own error added."""
        if self.requirement.error:
            return row.complete and row.tip + self.reference.own.tip <= self.requirement.error_percent
        return row.complete and row.tick_us <= self.requirement.tick_us

    @property
    def choice(self) -> CandidateResult | None:
        """Cheapest row within the required error, or the most accurate one within the required time."""
        good = [row for row in self.rows if self.meets(row)]
        by_cost = bool(self.requirement.error)
        return min(good, key=lambda r: (r.cpu, r.tip) if by_cost else (r.tip, r.cpu), default=None)

    @property
    def block(self) -> str:
        """The choice as YAML to paste into the scene, with a note on the twin; "" without a choice."""
        if self.choice is None:
            return ""
        twin = {} if self.case.scene is None else dict(self.case.scene.twin)
        kept = [f"twin.{name}" for name in ("refine", "integrator", "step_s") if twin.get(name) is not None]
        note = f"# The twin keeps what the scene states: {', '.join(kept)}.\n" if kept else ""
        return note + self.choice.candidate.block

    @property
    def nearest(self) -> CandidateResult | None:
        """Row that is nearest to the requirement."""
        done = [row for row in self.rows if row.complete]
        return min(done, key=lambda r: r.tip if self.requirement.error else r.tick_us, default=None)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        chosen, front, unknown = self.choice, self.front, self.reference.unknown
        return {
            "robot": self.case.robot.name,
            "excitation": self.case.text,
            "wish": str(self.requirement),  # the key of files that users read
            "stopped": self.stopped,
            "combinations": {"all": self.combinations, "run": len(self.rows)},
            "not_available": self.refused,
            "tick_s": self.case.tick_s,
            "reference": {
                "model": self.reference.candidate.section,
                "own_error_percent": asdict(self.reference.own),
                "own_error_of_space": f"unknown: {unknown}" if unknown else "part of own_error_percent",
                "converged": self.reference.converged,
                "first_frequency_hz": self.reference.trace.frequency_hz,
                "note": self.reference.note,
            },
            "rows": [
                {
                    "model": row.candidate.section,
                    "errors_percent": row.errors and asdict(row.errors),
                    "failure": row.failure,
                    "cost": row.cost and asdict(row.cost),
                    "closed_loop": row.loop and asdict(row.loop),
                    "measured_curvature_rms_per_m": row.measured_per_m,
                    "front": row in front,
                }
                for row in self.rows
            ],
            "choice": None if chosen is None else chosen.candidate.section,
        }
