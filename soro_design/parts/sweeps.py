"""Sweeps of a part: its states under loads that rise, and the backbone of a rod in each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from soro_core.arrays import Array
from soro_design.fem import EquilibriumState, LoadSolution, SolverSettings, solve
from soro_design.parts.file import LoadSweep
from soro_design.parts.specimen import RodSpecimen, Specimen


@dataclass(frozen=True, eq=False)
class Backbone:
    """A rod in one state.

    Attributes
    ----------
    sweep : str
        Its name.
    load : float
        Load factor.
    pressures_pa : ndarray, (n_u,)
        Of the chambers [Pa].
    force_n : ndarray, (3,)
        At the end face [N].
    held_out : bool
        Whether it is for judging a model alone.
    poses : ndarray, (s, 4, 4)
        Of the sections.
    """

    sweep: str
    load: float
    pressures_pa: Array
    force_n: Array
    held_out: bool
    poses: Array


def follow(specimen: Specimen, sweep: LoadSweep, reached: Callable[[EquilibriumState], None]) -> LoadSolution:
    """Follow a part through a sweep.

    Parameters
    ----------
    specimen : Specimen
    sweep : LoadSweep
        Loads that rise from nothing.
    reached : callable
        Called with every state in equilibrium; those at the loads of the sweep are among them.
    """
    return solve(specimen.under(sweep), sweep.loads, SolverSettings(first_step=1.0 / sweep.states), reached)


def followed(
    specimen: Specimen, reached: Callable[[LoadSweep, EquilibriumState], None], sweep: LoadSweep
) -> LoadSolution:
    """Follow a part through a sweep, as a job; arguments of `follow`, with the sweep of each state."""
    return follow(specimen, sweep, partial(reached, sweep))


def nothing(sweep: LoadSweep, state: EquilibriumState) -> None:
    """Do nothing with a state: a job returns those at the loads of its sweep."""


def backbone(specimen: RodSpecimen, sweep: LoadSweep, state: EquilibriumState) -> Backbone:
    """Return the backbone of a rod in a state.

    Parameters
    ----------
    specimen : RodSpecimen
    sweep : LoadSweep
        Its pressures and force at load factor 1.
    state : EquilibriumState
        Of this sweep.
    """
    pressures = np.zeros(len(specimen.rod.chambers))
    pressures[: len(sweep.pressures_pa)] = sweep.pressures_pa
    force = state.load * np.array(sweep.force_n)
    poses = specimen.poses(state.u)
    return Backbone(sweep.name, state.load, state.load * pressures, force, sweep.held_out, poses)
