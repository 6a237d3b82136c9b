"""Records that kernels pass to each other whole.

Feeds kernels: the cache of soro_core._jit depends on this file too. Numba passes a named tuple of a few
arrays from kernel to kernel as it would pass these one by one.
"""

from __future__ import annotations

from typing import NamedTuple

from soro_core.arrays import Array


class ArmState(NamedTuple):
    """State of an arm: coordinates, velocities (n_q,) and internal states (n_z,)."""

    q: Array
    v: Array
    z: Array


class Motion(NamedTuple):
    """Motion of an arm, (n_q,) each."""

    q: Array
    qd: Array
    v: Array
    """Velocity in C(q, qd) v: qd itself but for a reference velocity."""
    a: Array
    """Acceleration."""


class Masses(NamedTuple):
    """What has weight: masses of the links (n,) and at the tip [kg], and gravity (3,)."""

    link: Array
    tip: float
    gravity: Array


class CrossSection(NamedTuple):
    """A section: its pose (R, p), and the columns of coordinates there, one a row, (n, 6)."""

    R: Array
    p: Array
    columns: Array


class SubInterval(NamedTuple):
    """Part of a link of length h; shape functions (n_q, 2) and xi_0 (2, 6) at its two points."""

    h: float
    shape: Array
    rest: Array


class Asked(NamedTuple):
    """What a pass along the links shall find, see `sweep`."""

    bodies: float
    forces: float


class TangentFactors(NamedTuple):
    """Factors of the derivatives of a force by q and by the velocity, and the `secant` of `contact`."""

    by_q: float
    by_v: float
    secant: float
