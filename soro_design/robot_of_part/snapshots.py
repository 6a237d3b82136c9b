"""States of a rod as a fit reads them: strains along it, and which sweep stands for what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_design.fem.backbone import section_strains
from soro_design.parts.file import LoadSweep
from soro_design.parts.sweeps import Backbone

# Order of the strains of a link: elongation, bending_x and bending_y, from a twist (angular part first).
_ROWS, _SIGNS, _STRAIGHT = [5, 1, 0], np.array([1.0, 1.0, -1.0]), np.array([1.0, 0.0, 0.0])
_NEEDED = {
    "axial": "force_n: [0, 0, F], which gives the axial stiffness",
    "lateral": "force_n: [F, 0, 0], which gives the bending stiffness",
    "even": "equal pressures in all chambers, which give their area",
    "uneven": "a pressure in one chamber, which gives its distance from the axis",
    "held_out": "other loads with held_out: true, which judge the result",
}


@dataclass(frozen=True, eq=False)
class Snapshots:
    """States of a rod under pressures alone and under forces alone.

    Attributes
    ----------
    z : ndarray, (s,)
        Undeformed places of the sections [m].
    axial, lateral, even, uneven, held_out : tuple of Backbone
        Under a force along the axis; under one across it; under equal pressures; under other pressures, of a
        single chamber the same; and under loads that judge the result.
    """

    z: Array
    axial: tuple[Backbone, ...]
    lateral: tuple[Backbone, ...]
    even: tuple[Backbone, ...]
    uneven: tuple[Backbone, ...]
    held_out: tuple[Backbone, ...]

    @property
    def length(self) -> float:
        """Of the rod [m]."""
        return float(self.z[-1] - self.z[0])

    @property
    def fitted(self) -> tuple[Backbone, ...]:
        """States whose tips a fit reads: under pressures, with a single chamber under a force across too."""
        is_single = len(self.even[0].pressures_pa) == 1
        return (*self.even, *self.lateral) if is_single else (*self.even, *self.uneven)

    def strains(self, state: Backbone) -> Array:
        """Return elongation and bending_x, bending_y [1/m] between the sections, (s - 1, 3)."""
        found = section_strains(state.poses, self.z)
        return np.asarray(_SIGNS * found[:, _ROWS] - _STRAIGHT)

    def motion(self, state: Backbone) -> float:
        """Return how far the tip is from where it is undeformed [m]."""
        return float(np.linalg.norm(state.poses[-1][:3, 3] - [0.0, 0.0, self.z[-1]]))

    def coordinates(self, state: Backbone, n: int) -> Array:
        """Return the means (n,) of the strains that a link of constant strain with so many has."""
        return self.mean(state)[[1]] if n == 1 else self.mean(state)[:n]

    def mean(self, state: Backbone) -> Array:
        """Return the means (3,) of these strains along the rod."""
        return np.asarray(np.diff(self.z) @ self.strains(state) / self.length)


def snapshots(z: Array, states: Sequence[Backbone], where: str) -> Snapshots:
    """Sort states by what loads them.

    Parameters
    ----------
    z : ndarray, (s,)
        Places of the sections [m].
    states : sequence of Backbone
        Of a rod.
    where : str
        Part file, for errors.

    Raises
    ------
    ConfigError
        If a sweep mixes pressures and forces, or a kind that is needed is missing.
    """
    kinds = [_kind(s.sweep, s.pressures_pa, s.force_n, s.held_out, where) for s in states]
    is_single = bool(states) and len(states[0].pressures_pa) == 1
    _require(kinds, [state.sweep for state in states], is_single, where)
    found = {name: tuple(s for s, k in zip(states, kinds, strict=True) if k == name) for name in _NEEDED}
    if is_single:
        found["uneven"] = found["even"]
    return Snapshots(z, **found)


def check_sweeps(sweeps: Sequence[LoadSweep], chambers: int, where: str) -> None:
    """Refuse sweeps that do not suffice for so many chambers before they are computed; errors as above."""
    for sweep in sweeps:
        if any(sweep.tensions_n):
            allowed = "none: `soro identify-fem` gives a robot chambers alone; leave sweeps of tendons out"
            raise ConfigError(where, f"sweeps.{sweep.name}.tensions_n", list(sweep.tensions_n), allowed)
    kinds = [
        _kind(s.name, np.resize(s.pressures_pa or 0.0, chambers), np.array(s.force_n), s.held_out, where)
        for s in sweeps
    ]
    _require(kinds, [sweep.name for sweep in sweeps], chambers == 1, where)


def _require(kinds: Sequence[str], names: Sequence[str], is_single: bool, where: str) -> None:
    for kind, allowed in _NEEDED.items():
        if kind not in kinds and not (is_single and kind == "uneven"):
            got = ", ".join(dict.fromkeys(names)) or "none"
            raise ConfigError(where, "sweeps", got, f"also a sweep with {allowed}")


def _kind(sweep: str, pressures: Array, force: Array, held_out: bool, where: str) -> str:
    if force[1] and pressures.size == 1:
        allowed = "0 along y: the link of a single chamber bends along x alone"
        raise ConfigError(where, f"sweeps.{sweep}.force_n", force.tolist(), allowed)
    if held_out:
        return "held_out"
    across = bool(np.hypot(force[0], force[1]) > 0.0)
    if (pressures.any() and force.any()) or (across and force[2]):
        allowed = "pressures alone, a force along z alone or a force across it; with held_out: true any"
        raise ConfigError(where, f"sweeps.{sweep}", "several at once", allowed)
    if force.any():
        return "lateral" if across else "axial"
    return "even" if np.ptp(pressures) == 0.0 else "uneven"
