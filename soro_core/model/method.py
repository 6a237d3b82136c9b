"""The two methods behind one set of names: which one is compiled follows from the type of the tables."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import overload
from soro_core.model import exact, mde
from soro_core.model.tables import MdeTables, Tables

Array: TypeAlias = NDArray[np.float64]

# Kernels see global functions, not attributes of modules that differ by method.
exact_inertia, mde_inertia = exact.inertia, mde.inertia
exact_inverse_dynamics, mde_inverse_dynamics = exact.inverse_dynamics, mde.inverse_dynamics
exact_kinematics, mde_kinematics = exact.kinematics, mde.kinematics
exact_potential, mde_potential = exact.potential, mde.potential


def inertia(t: Tables, mass: Array, tip_mass: float, q: Array, M: Array) -> None:
    """M <- inertia matrix (n_q, n_q) [C22, 3.16]."""
    (mde if isinstance(t, MdeTables) else exact).inertia(t, mass, tip_mass, q, M)


@overload(inertia)
def _inertia(t, mass, tip_mass, q, M):  # type: ignore[no-untyped-def]
    def by_mde(t, mass, tip_mass, q, M):  # type: ignore[no-untyped-def]
        mde_inertia(t, mass, tip_mass, q, M)

    def by_exact(t, mass, tip_mass, q, M):  # type: ignore[no-untyped-def]
        exact_inertia(t, mass, tip_mass, q, M)

    return by_mde if t.instance_class is MdeTables else by_exact


def inverse_dynamics(
    t: Tables,
    mass: Array,
    tip_mass: float,
    gravity: Array,
    wrench: Array,
    q: Array,
    qd: Array,
    v: Array,
    a: Array,
    tau: Array,
) -> None:
    """tau <- M(q) a + C(q, qd) v + G(q) - J_tip' wrench."""
    (mde if isinstance(t, MdeTables) else exact).inverse_dynamics(
        t, mass, tip_mass, gravity, wrench, q, qd, v, a, tau
    )


@overload(inverse_dynamics)
def _inverse_dynamics(t, mass, tip_mass, gravity, wrench, q, qd, v, a, tau):  # type: ignore[no-untyped-def]
    def by_mde(t, mass, tip_mass, gravity, wrench, q, qd, v, a, tau):  # type: ignore[no-untyped-def]
        mde_inverse_dynamics(t, mass, tip_mass, gravity, wrench, q, qd, v, a, tau)

    def by_exact(t, mass, tip_mass, gravity, wrench, q, qd, v, a, tau):  # type: ignore[no-untyped-def]
        exact_inverse_dynamics(t, mass, tip_mass, gravity, wrench, q, qd, v, a, tau)

    return by_mde if t.instance_class is MdeTables else by_exact


def kinematics(t: Tables, q: Array, place: float, R: Array, p: Array, J: Array) -> None:
    """Pose (R, p) in the world and body Jacobian, transposed (n_q, 6), at `place` metres."""
    (mde if isinstance(t, MdeTables) else exact).kinematics(t, q, place, R, p, J)


@overload(kinematics)
def _kinematics(t, q, place, R, p, J):  # type: ignore[no-untyped-def]
    def by_mde(t, q, place, R, p, J):  # type: ignore[no-untyped-def]
        mde_kinematics(t, q, place, R, p, J)

    def by_exact(t, q, place, R, p, J):  # type: ignore[no-untyped-def]
        exact_kinematics(t, q, place, R, p, J)

    return by_mde if t.instance_class is MdeTables else by_exact


def potential(t: Tables, q: Array) -> float:
    """Gravitational energy [J], zero at the world's origin."""
    return mde_potential(t, q) if isinstance(t, MdeTables) else exact_potential(t, q)


@overload(potential)
def _potential(t, q):  # type: ignore[no-untyped-def]
    def by_mde(t, q):  # type: ignore[no-untyped-def]
        return mde_potential(t, q)

    def by_exact(t, q):  # type: ignore[no-untyped-def]
        return exact_potential(t, q)

    return by_mde if t.instance_class is MdeTables else by_exact
