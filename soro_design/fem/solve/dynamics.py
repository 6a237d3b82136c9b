"""Motion of a part in time by the generalised-alpha method, docs/design.md (14).

After Chung and Hulbert, Journal of Applied Mechanics 60 (1993) 371-375. In between two states it takes a
share of the forces of each: those of the places in between would squeeze a stiff part that turns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_design.fem.part import Balance, Part
from soro_design.fem.solve.equations import Equations
from soro_design.fem.solve.equilibrium import inversion, moved
from soro_design.fem.solve.linear import KeptFactors
from soro_design.fem.solve.mass import mass_entries


@dataclass(frozen=True)
class Alpha:
    """Numbers of the method.

    Attributes
    ----------
    rho_inf : float
        Factor by which a step shrinks what is much quicker than it, 0 to 1; 1 shrinks nothing.
    """

    rho_inf: float = 0.8

    def __post_init__(self) -> None:
        if not 0.0 <= self.rho_inf <= 1.0:
            raise ModelError(f"rho_inf {self.rho_inf}; allowed: 0 to 1", "rho_inf")

    @property
    def of_mass(self) -> float:
        """Share of the old accelerations."""
        return (2.0 * self.rho_inf - 1.0) / (self.rho_inf + 1.0)

    @property
    def of_force(self) -> float:
        """Share of the old displacements."""
        return self.rho_inf / (self.rho_inf + 1.0)

    @property
    def gamma(self) -> float:
        """Share of the new accelerations in the velocities."""
        return 0.5 - self.of_mass + self.of_force

    @property
    def beta(self) -> float:
        """Twice it is that share in the displacements."""
        return 0.25 * (1.0 - self.of_mass + self.of_force) ** 2


@dataclass(frozen=True, eq=False)
class Moving:
    """A state of motion.

    Attributes
    ----------
    time_s : float
        Since the start.
    u, v, a : ndarray, (n, d)
        Displacements [m], velocities [m/s] and accelerations [m/s2].
    force : ndarray, (n, d)
        Of stresses and springs minus those of the loads [N].
    strain_energy, kinetic_energy : float
        [J]
    """

    time_s: float
    u: Array
    v: Array
    a: Array
    force: Array
    strain_energy: float
    kinetic_energy: float


@dataclass(frozen=True, eq=False)
class DynamicsResult:
    """What became of a motion.

    Attributes
    ----------
    status : str
        solved, or stopped before the end.
    cause : str
        Why it stopped, else empty.
    states : tuple of Moving
        All of them, from the start; the last one is in balance, whatever the status.
    """

    status: str
    cause: str
    states: tuple[Moving, ...]


def march(
    part: Part,
    step_s: float,
    steps: int,
    load: Callable[[float], float] = lambda _: 1.0,
    u: Array | None = None,
    v: Array | None = None,
    rho_inf: float = 0.8,
    tolerance: float = 1e-9,
    iterations: int = 30,
) -> DynamicsResult:
    """Follow the motion of a part, in steps of one length.

    Parameters
    ----------
    part : Part
    step_s : float
        Length of a step.
    steps : int
        Number of steps.
    load : callable
        Load factor by time [s], of forces, pressures and prescribed displacements.
    u, v : ndarray, (n, d), optional
        Displacements [m] and velocities [m/s] at the start, by default 0; of held nodes as prescribed.
    rho_inf : float
        Factor by which a step shrinks what is much quicker than it, 0 to 1.
    tolerance, iterations : float and int
        Greatest unbalanced force over the forces of stresses or of inertia, and most iterations of a step.

    Raises
    ------
    ModelError
        If `step_s`, `steps` or `rho_inf` is not allowed, or a start has another shape.
    """
    if not 0.0 < step_s < np.inf or steps < 1:
        raise ModelError(f"step_s {step_s}, steps {steps}; allowed: above 0", "step_s")
    zero = np.zeros_like(part.mesh.points)
    u, v = (zero if one is None else np.asarray(one, dtype=float) for one in (u, v))
    for key, one in (("u", u), ("v", v)):
        if one.shape != zero.shape or not np.isfinite(one).all():
            raise ModelError(f"{key} of shape {one.shape}; allowed: finite, {zero.shape}", key)
    way = _March(part, Alpha(rho_inf), step_s, load, tolerance, iterations)
    states = [way.start(u, v)]
    for _ in range(steps):
        state, cause = way.step(states[-1])
        if state is None:
            return DynamicsResult("stopped", f"time {states[-1].time_s:.6g} s: {cause}", tuple(states))
        states.append(state)
    return DynamicsResult("solved", "", tuple(states))


class _March:
    """The equations of a step."""

    def __init__(
        self,
        part: Part,
        alpha: Alpha,
        step_s: float,
        load: Callable[[float], float],
        tolerance: float,
        iterations: int,
    ) -> None:
        self.part, self.alpha, self.h, self.load = part, alpha, step_s, load
        self.tolerance, self.iterations = tolerance, iterations
        self.equations = Equations(part)
        self.mass = mass_entries(part)
        self.matrix = part.pattern.matrix(self.mass)

    def inertia(self, a: Array) -> Array:
        """Forces (n, d) [N] that accelerations need."""
        return np.asarray((self.matrix @ a.ravel()).reshape(a.shape))

    def moving(self, time_s: float, u: Array, v: Array, a: Array) -> Moving:
        """Return a state with its forces and energies."""
        here = self.part.balance(u, self.load(time_s), with_stiffness=False)
        kinetic = 0.5 * float((v * self.inertia(v)).sum())
        return Moving(time_s, u, v, a, here.unbalanced, here.energy, kinetic)

    def start(self, u: Array, v: Array) -> Moving:
        """Return the state at the start: accelerations of free nodes balance the forces."""
        balance = self.part.balance(u, self.load(0.0))
        tangent = self.equations.tangent(replace(balance, data=self.mass, coupling=None), u)
        a = tangent.move(-balance.unbalanced, np.zeros_like(u)) if tangent else None
        if balance.inverted >= 0 or a is None:
            raise ModelError(f"u: {inversion(self.part, max(balance.inverted, 0))}", "u")
        return self.moving(0.0, u, v, a)

    def step(self, last: Moving) -> tuple[Moving | None, str]:
        """Return the state one step on, or the cause why there is none."""
        for is_searching in (False, True):
            state, cause = self.attempt(last, is_searching)
            if state is not None:
                break
        return state, cause

    def attempt(self, last: Moving, is_searching: bool) -> tuple[Moving | None, str]:
        """Try with full steps of Newton's method, or with a search along them."""
        h, beta, gamma = self.h, self.alpha.beta, self.alpha.gamma
        load = self.load(last.time_s + h)
        # Displacements with new accelerations of 0; what u is beyond them, these have made.
        coasted = last.u + h * last.v + h * h * (0.5 - beta) * last.a
        balance_at = partial(self.balance, last, coasted)
        u, balance, kept = last.u, balance_at(last.u, last.u), KeptFactors()
        for _ in range(self.iterations):
            if balance.inverted >= 0:
                return None, inversion(self.part, balance.inverted)
            if self.equations.is_met(balance, u, load, self.tolerance):
                a = (u - coasted) / (beta * h * h)
                v = last.v + h * ((1.0 - gamma) * last.a + gamma * a)
                return self.moving(last.time_s + h, u, v, a), ""
            change = self.equations.step(balance, u, load, kept)
            if change is None:
                return None, "the stiffness with the mass is singular; take shorter steps"
            is_there = self.equations.is_there(self.equations.gap(u, load))
            u, balance = moved(self.equations, balance_at, u, change, balance, is_there, is_searching)
        return None, f"no balance in {self.iterations} iterations; take shorter steps"

    def balance(self, last: Moving, coasted: Array, u: Array, before: Array) -> Balance:
        """Return forces with those of inertia, in between the last state and u, and their derivative by u.

        Displacements `before` are those of `Part.balance`.
        """
        of_mass, of_force, h = self.alpha.of_mass, self.alpha.of_force, self.h
        balance = self.part.balance(u, self.load(last.time_s + h), before=before)
        by_u = (1.0 - of_mass) / (self.alpha.beta * h * h)
        inertia = self.inertia(by_u * (u - coasted) + of_mass * last.a)
        return replace(
            balance,
            size=max(balance.size, float(np.linalg.norm(inertia))),
            unbalanced=(1.0 - of_force) * balance.unbalanced + of_force * last.force + inertia,
            data=(1.0 - of_force) * balance.data + by_u * self.mass,
            coupling=None if balance.coupling is None else (1.0 - of_force) * balance.coupling,
        )
