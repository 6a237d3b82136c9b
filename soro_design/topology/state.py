"""The state of a run of topology optimisation: what an iteration needs of those before it, kept in a file."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_design.topology.domain import Domain
from soro_design.topology.mma import Moves

STATE = "state.npz"
# Densities of the film are kept as whole numbers up to this.
TONES = 255


@dataclass(frozen=True)
class IterationRow:
    """One iteration in numbers.

    Attributes
    ----------
    iteration : int
        From 1.
    objective : float
        The goal: u . K u, or -u_out / SE^m, in SI units; with a margin the mean of both parts.
    motion_m : float
        Of the output [m], NaN without one.
    volume : float
        Share of the grid that is solid.
    greyness : float
        Mean of 4 rho (1 - rho).
    residual : float
        Unbalanced force over the force of the air.
    pressure_pa : float
        At the inlet, below that of the schedule where a design has no equilibrium there.
    penalty, sharpness : float
        Of the schedule.
    eased : float
        Pressure over that of the schedule.
    stretch : float
        Greatest principal stretch of the part, NaN where the task has no limit of it.
    thinner_pa : float
        Pressure of the thinner part, NaN where the part alone counts.
    stiff : float
        Share of the grid that is of the second material, NaN without one.
    """

    iteration: int
    objective: float
    motion_m: float
    volume: float
    greyness: float
    residual: float
    pressure_pa: float
    penalty: float
    sharpness: float
    eased: float
    stretch: float = np.nan
    thinner_pa: float = np.nan
    stiff: float = np.nan


@dataclass(frozen=True, eq=False)
class OptimiserState:
    """All that an iteration needs from those before it.

    Attributes
    ----------
    x : ndarray, (e,) or (2 e,)
        Design variables of the next iteration: densities, and shares of a second material.
    moves : Moves
        Memory of the moving asymptotes.
    u : ndarray, (n, d)
        Displacements of the last iteration [m].
    density, filtered : ndarray, (e,)
        Densities of the last iteration, and before their projection.
    pressure : ndarray, (n,)
        Of the last iteration [Pa].
    frames : ndarray of uint8, (iterations, e)
        Densities of all iterations, for a film.
    rows : tuple of Row
        Of all iterations.
    stiff : ndarray, (e,) or (0,)
        Shares of the second material in the last iteration.
    """

    x: Array
    moves: Moves
    u: Array
    density: Array
    filtered: Array
    pressure: Array
    frames: Any
    rows: tuple[IterationRow, ...]
    stiff: Array = field(default_factory=lambda: np.empty(0))


def save(state: OptimiserState, folder: Path) -> None:
    """Write a state into a folder; a run that is interrupted meanwhile leaves the one before."""
    arrays = {f"moves_{one.name}": getattr(state.moves, one.name) for one in fields(Moves)}
    for name in ("x", "u", "density", "filtered", "pressure", "frames", "stiff"):
        arrays[name] = getattr(state, name)
    rows = json.dumps([asdict(row) for row in state.rows])
    beside = folder / f"new_{STATE}"
    np.savez(beside, rows=np.array(rows), **arrays)
    beside.replace(folder / STATE)


def load_state(folder: Path, domain: Domain) -> OptimiserState:
    """Return the state that a folder holds.

    Raises
    ------
    ConfigError
        If it holds none, or one of another grid.
    """
    path = folder / STATE
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as kept:
            arrays = {name: kept[name] for name in kept.files}
        rows = tuple(IterationRow(**row) for row in json.loads(str(arrays.pop("rows"))))
        moves = Moves(**{one.name: arrays.pop(f"moves_{one.name}") for one in fields(Moves)})
        state = OptimiserState(moves=moves, rows=rows, **arrays)
    except FileNotFoundError:
        raise ConfigError(str(path), "", "no such file", "the folder of a run of `soro design`") from None
    except (OSError, ValueError, KeyError, TypeError, BadZipFile) as error:
        raise ConfigError(str(path), "", str(error), "a state that `soro design run` has written") from None
    number = domain.fields * len(domain.is_solid)
    if len(state.x) != number:
        allowed = f"a run of this grid, {number} variables"
        raise ConfigError(str(path), "x", f"{len(state.x)} variables", allowed)
    return state
