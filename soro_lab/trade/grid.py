"""Grid of combinations: a coarse pass first, then the neighbourhood of its front."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product, zip_longest

from soro_core.config import with_changes
from soro_core.errors import ConfigError
from soro_core.robot import Discretisation, Robot
from soro_lab.trade.candidate import Candidate, describe
from soro_lab.trade.case import SAMPLE_S


@dataclass(frozen=True)
class CandidateGrid:
    """Values to combine.

    Attributes
    ----------
    pieces : tuple of int
        Numbers of pieces of constant strain for each link.
    polynomials : tuple of (str, int, int)
        Basis, order and number of pieces of each link.
    nodes, steps : tuple of int
        Nodes of `exact` (0: chosen for the robot), and steps of `mde`, of each link.
    dt_s : tuple of float
        Time steps [s], whole fractions of 20 ms.
    coarse_dt_s : tuple of float
        Time steps of the first pass [s].
    most : int
        Largest number of combinations in the second pass.
    loops : int
        Largest number of models in closed loop.
    """

    pieces: tuple[int, ...]
    polynomials: tuple[tuple[str, int, int], ...]
    nodes: tuple[int, ...]
    steps: tuple[int, ...]
    dt_s: tuple[float, ...]
    coarse_dt_s: tuple[float, ...]
    most: int
    loops: int


PRESETS = {
    "quick": CandidateGrid((1, 2), (("legendre", 1, 1),), (0, 4), (10,), (0.01, 0.002), (0.01, 0.002), 12, 2),
    "standard": CandidateGrid(
        (1, 2, 4, 8),
        (
            ("legendre", 1, 1),
            ("legendre", 2, 1),
            ("legendre", 3, 1),
            ("chebyshev", 2, 1),
            ("legendre", 1, 2),
        ),
        (0, 2, 3, 4, 5, 8),
        (5, 10, 20, 40),
        (0.02, 0.01, 0.005, 0.002, 0.001),
        (0.01, 0.002),
        60,
        4,
    ),
    "full": CandidateGrid(
        (1, 2, 4, 8, 16),
        tuple(
            (basis, order, links)
            for basis in ("legendre", "chebyshev")
            for order in (1, 2, 3, 4, 6)
            for links in (1, 2, 4)
        ),
        (0, 2, 3, 4, 5, 6, 8, 10, 12),
        (2, 5, 10, 20, 40, 80),
        (0.02, 0.01, 0.005, 0.004, 0.002, 0.001, 0.0005),
        (0.01, 0.002),
        400,
        8,
    ),
}


def within(grid: CandidateGrid, longest_s: float) -> CandidateGrid:
    """Return the grid with `longest_s` [s], the tick of a twin, in place of longer steps."""
    dt_s = [dt for dt in grid.dt_s if dt <= longest_s * (1.0 + 1e-9)]
    if len(dt_s) == len(grid.dt_s):
        return grid
    parts = SAMPLE_S / longest_s
    if abs(parts - round(parts)) < 1e-9 and not (dt_s and math.isclose(dt_s[0], longest_s)):
        dt_s.insert(0, longest_s)
    dt_s = dt_s or [grid.dt_s[-1]]
    coarse_dt_s = [dt for dt in grid.coarse_dt_s if dt in dt_s]
    if len(coarse_dt_s) < len(grid.coarse_dt_s):
        coarse_dt_s = list(dict.fromkeys((dt_s[0], *coarse_dt_s)))
    return replace(grid, dt_s=tuple(dt_s), coarse_dt_s=tuple(coarse_dt_s))


def spaces(grid: CandidateGrid, robot: Robot) -> tuple[list[Discretisation], dict[str, str]]:
    """Return the discretisations that the robot allows, and why it does not allow the others.

    The first one is that of the robot file, if its strains vary along a link.
    """
    wanted = [
        *([Discretisation()] if robot.varies else []),
        *(Discretisation(basis="constant", links=k) for k in grid.pieces),
        *(
            Discretisation.model_validate({"basis": basis, "order": order, "links": links})
            for basis, order, links in grid.polynomials
        ),
    ]
    found: list[Discretisation] = []
    refused: dict[str, str] = {}
    for model in wanted:
        try:
            model.discretise(robot)
        except ConfigError as error:
            refused[describe(model)] = str(error)
        else:
            found.append(model)
    return found, refused


def quadratures(grid: CandidateGrid, space: Discretisation) -> Iterator[Discretisation]:
    """Yield all methods with their numbers of nodes or steps for the shape functions of `space`."""
    for nodes in grid.nodes:
        yield with_changes(space, method="exact", nodes=nodes, steps=0)
    for steps in grid.steps:
        yield with_changes(space, method="mde", nodes=0, steps=steps)


def size(grid: CandidateGrid, n_spaces: int, n_steppers: int) -> int:
    """Return the number of all combinations.

    Parameters
    ----------
    grid : CandidateGrid
        Values to combine.
    n_spaces, n_steppers : int
        Numbers of discretisations in space, and of time steppers.
    """
    return n_spaces * (len(grid.nodes) + len(grid.steps)) * n_steppers * len(grid.dt_s)


def coarse(grid: CandidateGrid, found: Sequence[Discretisation], steppers: Sequence[str]) -> list[Candidate]:
    """Return the candidates of the first pass: default quadrature at a few time steps, and `mde` once.

    Parameters
    ----------
    grid : CandidateGrid
        Values to combine.
    found : sequence of Discretisation
        Discretisations that the robot allows.
    steppers : sequence of str
        Names of the time steppers.
    """
    middle = grid.steps[len(grid.steps) // 2]
    mde = [with_changes(space, method="mde", steps=middle) for space in found]
    return [
        *(Candidate(*one) for one in product(found, steppers, grid.coarse_dt_s)),
        *(Candidate(*one) for one in product(mde, steppers, grid.coarse_dt_s[:1])),
    ]


def around(grid: CandidateGrid, good: Iterable[Candidate], done: Iterable[Candidate]) -> list[Candidate]:
    """Return the candidates of the second pass: other steps and quadratures near the front, in turns.

    Parameters
    ----------
    grid : CandidateGrid
        Values to combine.
    good : iterable of Candidate
    done : iterable of Candidate
        Candidates that are already computed.

    Returns
    -------
    list of Candidate
        At most `grid.most`.
    """
    lists = []
    for candidate in good:
        space = Discretisation(
            links=candidate.model.links, basis=candidate.model.basis, order=candidate.model.order
        )
        steps = (Candidate(space, candidate.integrator, dt) for dt in grid.dt_s)
        rules = (Candidate(q, candidate.integrator, candidate.dt_s) for q in quadratures(grid, space))
        lists.append([one for pair in zip_longest(rules, steps) for one in pair if one is not None])
    turns = (one for turn in zip_longest(*lists) for one in turn if one is not None)
    known = set(done)
    return [one for one in dict.fromkeys(turns) if one not in known][: grid.most]
