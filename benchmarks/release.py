"""The bent release: a uniformly bent, hanging rod let go; error of a run, and the fastest good run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks import rod
from benchmarks.converged import Converged
from benchmarks.timing import CLOCK
from soro_core import SoftArm, simulate
from soro_core.arrays import Array
from soro_core.integrate import STEPPERS

# Largest tip RMSE, in % of the length.
LIMIT = 0.1
# Steps a second, coarse to fine, 12 % apart; searched in strides first.
LADDER = tuple(
    round(base * scale)
    for scale in (20, 200, 2000)
    for base in (1, 1.12, 1.25, 1.4, 1.6, 1.8, 2, 2.25, 2.5, 2.8, 3.2, 3.6, 4, 4.5, 5, 5.6, 6.4, 7.2, 8, 9)
)
STRIDE = 5
ROWS = 1000  # of a run, that its error is taken from


@dataclass(frozen=True)
class Candidate:
    """One way to compute the release."""

    method: str
    setting: str
    run: Callable[[], tuple[Array, Array] | None]
    """Gives times and coordinates (n_t,), (n_t, n_q), or nothing where it failed."""


@dataclass(frozen=True)
class Found:
    """A candidate that is accurate enough."""

    candidate: Candidate
    error: float
    seconds: float


class Reference:
    """Tip of the converged model over the time of the release."""

    def __init__(self, n_links: int, t_end: float) -> None:
        self.t_end = t_end
        arm = SoftArm(rod.robot(n_links))
        self._tip = Converged(arm, lambda steps: ours(arm, "rk4", steps, t_end).run())
        self.own_error = self._tip.own_error

    def enough(self, nodes: int) -> bool:
        """Tell whether quadrature alone leaves an error well below the limit.

        Without this, an error of quadrature that happens to cancel one of time would pass for accuracy.
        """
        arm = SoftArm(self._tip.arm.robot, nodes=nodes)
        return self.error(ours(arm, "rk4", self._tip.steps, self.t_end).run()) <= LIMIT / 3

    def error(self, run: tuple[Array, Array] | None) -> float:
        """Tip RMSE at the run's own times, in % of the length; infinite for a run that failed."""
        if run is None or not np.isfinite(run[1]).all() or np.abs(run[1]).max() > 1e3:
            return math.inf
        every = max(1, len(run[0]) // ROWS)
        return float(np.sqrt(np.mean(self._tip.distance((run[0][::every], run[1][::every])) ** 2)))


def ours(arm: SoftArm, integrator: str, steps: int, t_end: float) -> Candidate:
    """One of our steppers with `steps` steps a second."""
    q0 = rod.bent(len(arm.robot.links))

    def run() -> tuple[Array, Array] | None:
        result = simulate(arm, q0, t_end=t_end, dt=1.0 / steps, integrator=integrator)
        return (result.t, result.q) if result.status.ok else None

    return Candidate(f"{integrator}, {arm.nodes} nodes", f"{1e3 / steps:.3g} ms", run)


def best_of_ours(
    reference: Reference, n_links: int, nodes: Sequence[int], say: Callable[[str], None]
) -> list[Found]:
    """Fastest good setting of each stepper: number of nodes and step."""
    say(f"{n_links} links, numbers of nodes")
    nodes = [count for count in nodes if reference.enough(count)]
    found = []
    for integrator in STEPPERS:
        say(f"{n_links} links, {integrator}")
        per_nodes = []
        for count in nodes:
            arm = SoftArm(rod.robot(n_links), nodes=count)
            make = partial(ours, arm, integrator, t_end=reference.t_end)
            per_nodes.append(first_good(reference, make))
        found.append(fastest(per_nodes))
    return [one for one in found if one is not None]


def first_good(reference: Reference, make: Callable[[int], Candidate]) -> Found | None:
    """Largest step of the ladder that meets the limit."""
    for high in range(0, len(LADDER) + STRIDE - 1, STRIDE):
        high = min(high, len(LADDER) - 1)
        if reference.error(make(LADDER[high]).run()) <= LIMIT:
            tried = (judge(reference, make(steps)) for steps in LADDER[max(0, high - STRIDE + 1) : high + 1])
            return next((found for found in tried if found is not None), None)
    return None


def judge(reference: Reference, candidate: Candidate) -> Found | None:
    """Measure a candidate's time if it is accurate enough."""
    error = reference.error(candidate.run())
    if error > LIMIT:
        return None
    return Found(candidate, error, min(CLOCK.time(candidate.run) for _ in range(2)))


def fastest(found: Iterable[Found | None]) -> Found | None:
    """Best of those that were found."""
    return min((one for one in found if one is not None), key=lambda one: one.seconds, default=None)
