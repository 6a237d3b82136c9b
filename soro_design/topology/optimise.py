"""The iterations of topology optimisation: densities, analysis, moving asymptotes; and going on with them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from soro_core.arrays import Array
from soro_core.errors import ConfigError, ModelError
from soro_design.topology.domain import Domain, analysis, make_domain
from soro_design.topology.flood import flood
from soro_design.topology.mma import mma_step, no_moves
from soro_design.topology.physics.compliance import Compliance
from soro_design.topology.physics.filter import density_filter, greyness, of_each, projection
from soro_design.topology.physics.grid import Evaluation, place_text
from soro_design.topology.physics.stroke import Stroke
from soro_design.topology.repeats import cell_mean
from soro_design.topology.shape import mean_level, snapped
from soro_design.topology.state import TONES, IterationRow, OptimiserState
from soro_design.topology.stretch import WATCHED, limit_of, slope_of_mean, stretched
from soro_design.topology.task import Task

# A pressure that was lowered, where a design had no equilibrium, rises again by this factor. A run in which
# it is low for so many iterations, and falls so often, is heading for a part that the air carries away.
RISING, MOST_LOWERED, MOST_FALLS = 1.2, 20, 5
# A thinner part that bears less than this share of the pressure is torn.
TORN = 0.25


def first_state(domain: Domain) -> OptimiserState:
    """Return the state before the first iteration."""
    x, n = domain.start(), len(domain.is_solid)
    if domain.task.shares_variables:
        x[:n] = cell_mean(domain) @ x[:n]
    none = np.empty(0)
    frames = np.empty((0, n), dtype=np.uint8)
    return OptimiserState(x, no_moves(), np.zeros_like(domain.output), none, none, none, frames, ())


def optimise(
    task: Task,
    state: OptimiserState | None = None,
    progress: Callable[[OptimiserState], None] | None = None,
    where: str = "task",
    until: int | None = None,
) -> OptimiserState:
    """Return the state after the last iteration.

    Parameters
    ----------
    task : Task
        The task.
    state : OptimiserState, optional
        Where to go on; default: from the start.
    progress : callable, optional
        Called after each iteration.
    where : str
        File that errors name.
    until : int, optional
        Iteration to stop at; default: all of them.

    Raises
    ------
    ModelError
        Where a design has no equilibrium, the pressure stays low for long, or the output does not move; one
        line with the reason.
    """
    domain = make_domain(task, where)
    require_sealable(domain, where)
    found = analysis(domain, where)
    weights = filters(domain, where)
    state = state or first_state(domain)
    last = task.schedule.iterations if until is None else until
    for k in range(len(state.rows), last):
        state = _iterate(domain, found, weights, state, k)
        if progress is not None:
            progress(state)
        if k + 1 < last:
            _require_pressure(state.rows)
    return state


def filters(domain: Domain, where: str = "task") -> LinearOperator:
    """Return the linear operator from variables to densities before their projection, (fields e, fields e).

    Parameters and errors as of `cell_mean`.
    """
    task = domain.task
    filtered = density_filter(domain.grid, task.filter_radius_m)
    # Given elements have a density of their own, but may be of either material.
    apart = (domain.is_given, np.zeros_like(domain.is_given))[: domain.fields]
    if not task.shares_variables:
        return of_each([filtered for _ in apart])
    return of_each([filtered @ aslinearoperator(cell_mean(domain, where, one)) for one in apart])


def require_sealable(domain: Domain, where: str) -> None:
    """Refuse a task whose given void alone joins the inlet with the open.

    Raises
    ------
    ConfigError
        With the place of the leak; `where` is the file that it names.
    """
    found = flood(domain, snapped(domain.grid, mean_level(domain, np.ones(len(domain.is_solid)))))
    if found.is_leak.any():
        at = place_text(domain.grid.mesh.points[np.flatnonzero(found.is_leak)[0]])
        place = f"a way of void from the inlet to the open at {at}"
        raise ConfigError(where, "void", place, "room for a wall between them, else no part is sealed")


def densities(
    domain: Domain, weights: Any, x: Array, sharpness: float, margin: float = 0.0
) -> tuple[Array, Array, Array]:
    """Return filtered and final densities (fields e,), and the derivative of the latter by the former.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    weights : linear operator, (fields e, fields e)
        The density filter.
    x : ndarray, (fields e,)
        Design variables.
    sharpness : float
        Of the projection, 0 without.
    margin : float
        How far above the threshold of the schedule densities step: of a thinner part.
    """
    filtered = np.clip(weights @ x, 0.0, 1.0)
    n = len(domain.is_solid)
    density, slope = projection(filtered[:n], sharpness, domain.task.schedule.threshold + margin)
    density = np.where(domain.is_solid, 1.0, np.where(domain.is_void, 0.0, density))
    slope = np.where(domain.is_given, 0.0, slope)
    stiff, stiff_slope = projection(filtered[n:], sharpness, domain.task.schedule.threshold)
    return filtered, np.concatenate([density, stiff]), np.concatenate([slope, stiff_slope])


def designs_at(domain: Domain, weights: Any, x: Array, k: int) -> list[tuple[Array, Array, Array]]:
    """Return `densities` of the parts whose mean goal counts in an iteration: the part, and a thinner one.

    A wall or hinge that is thin in the part is torn in the thinner one, which then has another goal or none.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    weights : linear operator, (fields e, fields e)
        The density filter.
    x : ndarray, (fields e,)
        Design variables.
    k : int
        The iteration, from 0.
    """
    schedule = domain.task.schedule
    _, _, sharpness = schedule.at(k)
    margin = schedule.margin_at(k)
    return [densities(domain, weights, x, sharpness, by) for by in ((0.0, margin) if margin else (0.0,))]


def _evaluated(
    found: Stroke | Compliance, density: Array, penalty: float, pressure_pa: float, guess: Array
) -> Evaluation:
    """The part under a pressure, or under what share of it has an equilibrium."""
    if isinstance(found, Compliance):
        return found.evaluate(density, penalty, pressure_pa)
    try:
        return found.evaluate(density, penalty, pressure_pa, guess, may_lower=True)
    except ModelError as error:
        raise ModelError(f"{pressure_pa:.4g} Pa: {error}", error.key) from None


def goal_of(
    weights: Any, every: list[Evaluation], designs: list[tuple[Array, Array, Array]]
) -> tuple[float, Array]:
    """Return the mean goal of all parts, and its slope by the variables (fields e,).

    Parameters
    ----------
    weights : linear operator, (fields e, fields e)
        From variables to densities before their projection.
    every : list of Evaluation
        Of these parts.
    designs : list of tuple
        Of `designs_at`.
    """
    slopes = [one.gradient * slope for one, (*_, slope) in zip(every, designs, strict=True)]
    return float(np.mean([one.objective for one in every])), weights.T @ np.mean(slopes, axis=0)


def _require_pressure(rows: tuple[IterationRow, ...]) -> None:
    """Refuse, once, to go on where the pressure has been low for too long; other goals would help."""
    recent = rows[-MOST_LOWERED - 1 :]
    falls = sum(now.eased < min(1.0, RISING * before.eased) for before, now in pairwise(recent))
    is_low = [row.eased < 1.0 for row in recent]
    if all(is_low[-MOST_LOWERED:]) and is_low.count(True) == MOST_LOWERED and falls >= MOST_FALLS:
        row = rows[-1]
        raise ModelError(
            f"iteration {row.iteration}: the pressure has been below that of the schedule for {MOST_LOWERED} "
            f"iterations, the last design rests under {row.pressure_pa:.4g} of "
            f"{row.pressure_pa / row.eased:.4g} Pa: the goal asks for a part so soft that its air carries it "
            "away; allowed: a greater goal.spring_pa and goal.energy_exponent, more of it held, a lower "
            "schedule.pressure_pa; or go on as it is with --resume",
            "schedule.pressure_pa",
        )


def volume_limits(
    domain: Domain, weights: Any, density: Array, slope: Array
) -> tuple[list[float], list[float], list[Array]]:
    """Return the shares of the grid that are solid and of a second material, with their limits.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    weights : linear operator, (fields e, fields e)
        From variables to densities before their projection.
    density, slope : ndarray, (fields e,)
        Of `densities`.

    Returns
    -------
    volumes : list of float
        The shares.
    limits : list of float
        How far each is above its limit, as a share of that.
    slopes : list of ndarray, (fields e,)
        Their derivatives by the variables.
    """
    share = domain.grid.volumes / domain.grid.volumes.sum()
    most = [domain.task.volume_fraction]
    if domain.stiffening is not None:
        most.append(domain.stiffening.volume_fraction)
    found = [float(share @ one) for one in density.reshape(domain.fields, -1)]
    limits = [one / limit - 1.0 for one, limit in zip(found, most, strict=True)]
    by_field = np.kron(np.eye(domain.fields), share)
    slopes = [weights.T @ (one * slope) / limit for one, limit in zip(by_field, most, strict=True)]
    return found, limits, slopes


def _iterate(
    domain: Domain, found: Stroke | Compliance, weights: Any, state: OptimiserState, k: int
) -> OptimiserState:
    task = domain.task
    x = state.x
    scheduled, penalty, sharpness = task.schedule.at(k)
    designs = designs_at(domain, weights, x, k)
    filtered, density, slope = designs[0]
    eased = min(1.0, RISING * state.rows[-1].eased) if state.rows else 1.0
    try:
        at = _evaluated(found, density, penalty, eased * scheduled, state.u)
    except ModelError as error:
        raise ModelError(f"iteration {k + 1}, {error}", error.key) from None
    eased *= at.share
    pressure, every, thinner_pa = eased * scheduled, [at], np.nan
    try:
        for _, one, _ in designs[1:]:
            thinner = _evaluated(found, one, penalty, pressure, at.u)
            if thinner.share < TORN:
                raise ModelError("the thinner part bears hardly any pressure", "schedule.margin")
            every, thinner_pa = [at, thinner], thinner.share * pressure
    except ModelError:
        # Torn altogether: the part alone counts.
        designs = designs[:1]
    objective, by_x = goal_of(weights, every, designs)
    if not np.isfinite(by_x).all() or not at.gradient.any():
        raise ModelError(
            f"iteration {k + 1}: nothing moves the output; allowed: an inlet whose air meets material",
            "inlet",
        )
    n = len(domain.is_solid)
    move = task.schedule.move
    least, most = np.maximum(x - move, 0.0), np.minimum(x + move, 1.0)
    given = np.flatnonzero(domain.is_given)
    least[given] = most[given] = x[given]
    volumes, limits, slopes = volume_limits(domain, weights, density, slope)
    stretch = np.nan
    if domain.stretch_limit is not None and isinstance(found, Stroke):
        here = stretched(domain.grid, density[:n], at.u)
        stretch, beyond = here.greatest, limit_of(here.greatest, domain.stretch_limit)
        if beyond > WATCHED - 1.0 and here.mean > 0.0:
            by_density = slope_of_mean(found, penalty, pressure, density, at)
            limits.append(beyond)
            slopes.append(weights.T @ (by_density * slope) * (1.0 + beyond) / here.mean)
    following, moves = mma_step(x, by_x, np.array(limits), np.array(slopes), (least, most), state.moves)
    row = IterationRow(
        k + 1,
        objective,
        at.motion_m,
        volumes[0],
        greyness(density[:n]),
        at.residual,
        pressure,
        penalty,
        sharpness,
        eased,
        stretch,
        thinner_pa,
        volumes[1] if domain.fields > 1 else np.nan,
    )
    frame = np.round(TONES * density[:n]).astype(np.uint8)
    return OptimiserState(
        following,
        moves,
        at.u,
        density[:n],
        filtered[:n],
        at.pressure,
        np.vstack([state.frames, frame]),
        (*state.rows, row),
        density[n:],
    )
