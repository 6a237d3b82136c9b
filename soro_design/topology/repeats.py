"""Parts of cells that follow upon each other: one set of design variables for all cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from soro_core.arrays import Flags, Integers
from soro_core.errors import ConfigError
from soro_design.topology.domain import Domain

# How far a length may be from whole elements, in elements.
_WHOLE = 1e-3


def cell_mean(domain: Domain, where: str = "task", is_apart: Flags | None = None) -> Any:
    """Return the matrix (e, e) of the mean over elements that repeat each other; without any the identity.

    Behind it all of these have one variable: the filter times this matrix takes variables to densities, its
    transpose takes slopes back. Given elements keep a variable of their own.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    where : str
        File that errors name.
    is_apart : ndarray of bool, (e,), optional
        Elements that share no variable; default: those that are given.

    Raises
    ------
    ConfigError
        If a cell is not of whole elements, or the cells leave the grid.
    """
    group = cells_of(domain, where, is_apart)
    n = len(group)
    member = csr_matrix((np.ones(n), (group, np.arange(n))), shape=(n, n))
    size = np.maximum(np.bincount(group, minlength=n), 1)
    return member.T @ member.multiply(1.0 / size[:, None]).tocsr()


def cells_of(domain: Domain, where: str = "task", is_apart: Flags | None = None) -> Integers:
    """Return the number of an element with which each (e,) shares its variable; errors as of `cell_mean`.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    where : str
        File that errors name.
    is_apart : ndarray of bool, (e,), optional
        Elements that share no variable; default: those that are given.
    """
    is_apart = domain.is_given if is_apart is None else is_apart
    number = np.arange(len(is_apart))
    one = domain.task.repeat
    place = np.rint(domain.grid.centres / np.array(domain.grid.edge_m) - 0.5).astype(int)
    if domain.task.quarter_turns:
        return _turned(place, is_apart)
    if one is None:
        return number
    axis = "xyz".index(one.along)
    edge, length = domain.grid.edge_m[axis], domain.task.size_m[axis]
    first, pitch = round(one.from_m / edge), round(one.pitch_m / edge)
    for key, found, whole in (("from_m", one.from_m, first), ("pitch_m", one.pitch_m, max(pitch, 1))):
        if abs(whole - found / edge) > _WHOLE:
            allowed = f"a multiple of an element, {edge:.9g} m along {one.along}"
            raise ConfigError(where, f"repeat.{key}", found, allowed)
    if (end := first + pitch * one.number) > round(length / edge):
        raise ConfigError(where, "repeat", f"cells up to {end * edge:g} m", f"up to {length:g} m")
    along = place[:, axis]
    in_cell = (along - first) % pitch
    if one.mirrored:
        in_cell = np.minimum(in_cell, pitch - 1 - in_cell)
    is_repeated = (along >= first) & (along < end) & ~is_apart
    place[is_repeated, axis] = in_cell[is_repeated]
    # Beyond the grid, such that a cell shares no variable with what stands before the first one.
    place[~is_repeated, axis] += 2 * round(length / edge)
    _, index, same = np.unique(place, axis=0, return_index=True, return_inverse=True)
    return np.asarray(index[same.ravel()])


def _turned(place: Integers, is_apart: Flags) -> Integers:
    """The numbers of `cells_of` of a square whose elements (e, 2) come again with each quarter turn."""
    n = place[:, 0].max() + 1
    number = np.empty((n, n), dtype=int)
    number[tuple(place.T)] = np.arange(len(place))
    turned = np.array([np.rot90(number, k)[tuple(place.T)] for k in range(4)])
    least = np.where(is_apart[turned], len(place), turned).min(axis=0)
    return np.asarray(np.where(is_apart, np.arange(len(place)), least))
