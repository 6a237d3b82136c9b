"""Motion of an output of a soft part under the pressure of the air: equilibrium and its derivatives."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from soro_core.arrays import Array, Flags, Integers
from soro_core.errors import ModelError
from soro_design.fem import Hyperelastic
from soro_design.fem.elements.material import Material
from soro_design.fem.solve.dissection import order_among
from soro_design.fem.solve.linear import Factors, KeptFactors, factorised
from soro_design.fem.solve.steps import LoadSteps, shortened
from soro_design.topology.physics.darcy import Flow, pressures
from soro_design.topology.physics.energy import Elements, ElementScales, assemble, sensitivities
from soro_design.topology.physics.filter import interpolation, stiffening
from soro_design.topology.physics.grid import Evaluation, Grid, between_free, place_text

_NONE = np.empty(0)
# Unbalanced force over that of the air; most iterations; the first and the least step of the pressure.
TOLERANCE = 1e-7
ROUNDS = 15
FIRST_STEP, LEAST_STEP = 0.25, 0.05
# Where there is no equilibrium, each try takes this share of the pressure before; beside a limit point the
# part rests at most at this share of the pressure there.
LOWERED = 0.8
# Greatest residual of linear equations over their right hand side: of a step, and of the derivatives.
STEP_RESIDUAL, ADJOINT_RESIDUAL = 1e-3, 1e-11


class AirBalance(NamedTuple):
    """Forces of a part with air in it.

    Attributes
    ----------
    stored, potential : float
        Energy of the material, and with that of the air and the springs [J].
    inverted : int
        First element with J <= 0 in its solid, or -1; if there is one, nothing else here has a meaning.
    unbalanced : ndarray, (n, d)
        [N], 0 where nodes are held.
    data : ndarray
        Entries of the stiffness between free displacements, or none.
    """

    stored: float
    potential: float
    inverted: int
    unbalanced: Array
    data: Array


@dataclass(frozen=True, eq=False)
class PartAtRest:
    """A part at rest.

    Attributes
    ----------
    u : ndarray, (n, d)
        Displacements [m].
    stored : float
        Energy of the material [J].
    residual : float
        Unbalanced force over the force of the air, as norms.
    stiffness : sparse array
        Between free displacements [N/m]; its numbers are those of this part until the next attempt.
    factors : KeptFactors
        Of a stiffness near by.
    share : float
        Of the pressures under which it rests.
    """

    u: Array
    stored: float
    residual: float
    stiffness: Any = field(repr=False)
    factors: KeptFactors = field(repr=False)
    share: float = 1.0


@dataclass(frozen=True, eq=False)
class Stroke:
    """A soft part whose output moves, docs/design.md (T6) to (T9).

    Attributes
    ----------
    grid : Grid
        The grid.
    flow : Flow
        How densities let air through.
    held : ndarray, (n,)
        Given pressures as a share of that of the inlet, else NaN.
    is_held : ndarray of bool, (n, d)
        Directions in which nodes do not move.
    material : Hyperelastic or SaintVenant
        Of solid.
    void_stiffness : float
        Stiffness of void over that of solid.
    output : ndarray, (n, d)
        Weights of the displacements whose sum is that of the output; of a patch, never of a node.
    spring : ndarray, (n, d)
        Springs to the ground [N/m].
    exponent : float
        m in -u_out / SE^m.
    stiffer : float
        How many times as stiff as the material a second one is; 1 without.
    """

    grid: Grid
    flow: Flow
    held: Array
    is_held: Flags
    material: Material
    void_stiffness: float
    output: Array
    spring: Array
    exponent: float
    stiffer: float = 1.0
    _elements: Elements = field(init=False, repr=False)
    _free: Integers = field(init=False, repr=False)
    _order: Integers = field(init=False, repr=False)
    _entries: Integers = field(init=False, repr=False)
    _matrix: Any = field(init=False, repr=False)

    def __post_init__(self) -> None:
        free, entries, matrix = between_free(self.grid.vectors, self.is_held)
        values = {"_elements": self._read(), "_free": free, "_entries": entries, "_matrix": matrix}
        for name, value in (values | {"_order": order_among(self.grid.order, free)}).items():
            object.__setattr__(self, name, value)

    def _read(self) -> Elements:
        """What the kernels read; small strains have the stiffness of the undeformed solid."""
        grid, n = self.grid, len(self.grid.volume)
        # An element of each kind, without a neighbour.
        nodes, d = grid.slope.shape[2:]
        size = nodes * d
        cells = np.arange(nodes * n, dtype=np.int64).reshape(n, nodes)
        position = np.arange(size * size * n, dtype=np.int64).reshape(n, size, size)
        shared = float(isinstance(self.material, Hyperelastic))
        tables = (grid.slope, grid.hoop, grid.volume, grid.shape)
        alone = Elements(
            self.material.law, shared, cells, np.arange(n), *tables, np.zeros_like(position, float)
        )
        data, zero, one = np.zeros(position.size), np.zeros((nodes * n, d)), np.ones(n)
        assemble(
            alone,
            ElementScales(one, one, one),
            zero[:, 0].copy(),
            (zero, zero),
            zero.copy(),
            (position, data),
        )
        small = data.reshape(position.shape)
        return alone._replace(cells=grid.mesh.cells, kind=grid.kind, small=small)

    def balance(
        self,
        scales: ElementScales,
        pressure: Array,
        u: Array,
        before: Array | None = None,
        with_stiffness: bool = True,
    ) -> AirBalance:
        """Return the forces of the part.

        Parameters
        ----------
        scales : ElementScales
            Of the elements.
        pressure : ndarray, (n,)
            Of the nodes [Pa].
        u : ndarray, (n, d)
            Displacements [m].
        before : ndarray, (n, d), optional
            Those of `soro_design.fem.Part.balance`.
        with_stiffness : bool
            Whether to compute entries of the stiffness between free displacements.
        """
        grid = self.grid
        data = np.zeros(len(grid.vectors.keys)) if with_stiffness else _NONE
        force = np.zeros_like(u)
        stored, by_air, bad = assemble(
            self._elements,
            scales,
            pressure,
            (u, u if before is None else before),
            force,
            (grid.vectors.cells, data),
        )
        force += self.spring * u
        potential = stored + by_air + 0.5 * float((self.spring * u * u).sum())
        if with_stiffness:
            diagonal = grid.vectors.diagonal()
            data[diagonal] += self.spring.ravel()
            data = data[self._entries]
        force[self.is_held] = 0.0
        return AirBalance(stored, potential, bad, force, data)

    def rest(
        self, density: Array, penalty: float, pressure: Array, guess: Array, may_lower: bool = False
    ) -> PartAtRest:
        """Return where the part rests under the pressures of its nodes, or under a share of them.

        Parameters
        ----------
        density : ndarray, (e,) or (2 e,)
            Densities of the elements, and their shares of a second material.
        penalty : float
            Exponent of the stiffness.
        pressure : ndarray, (n,)
            Of the nodes [Pa].
        guess : ndarray, (n, d)
            Displacements to begin with [m].
        may_lower : bool
            Whether to rest under a share of the pressures where all of them have no equilibrium.

        Raises
        ------
        ModelError
            Where no equilibrium is found, whether from the guess or by steps from the undeformed part.
        """
        scales, _, _, _ = self._scales(density, penalty)
        found, cause = self._newton(scales, pressure, guess)
        if found is not None:
            return found
        # From the undeformed part, in steps that adapt.
        u, load, size = np.zeros_like(guess), 0.0, LoadSteps(FIRST_STEP, LEAST_STEP)
        way = []
        while load < 1.0:
            trial = size.next(load, 1.0)
            found, cause = self._newton(scales, trial * pressure, u)
            if found is not None:
                size.has_succeeded(trial - load)
                u, load = found.u, trial
                way.append((load, u))
            elif size.has_failed(trial - load):
                break
        share = 1.0
        while found is None and LOWERED * share > max(load, LEAST_STEP) and may_lower:
            share *= LOWERED
            found, _ = self._newton(scales, share * pressure, guess)
        if found is None and may_lower and way:
            before = [one for one in way if one[0] <= LOWERED * load]
            share, u = before[-1] if before else way[0]
            found, _ = self._newton(scales, share * pressure, u)
        if found is None:
            raise ModelError(f"no equilibrium beyond {load:.0%} of the pressure: {cause}", "pressure")
        return replace(found, share=share)

    def _scales(self, density: Array, penalty: float) -> tuple[ElementScales, Array, Array, Array]:
        """Return the scales of the elements, and the derivatives (e,) of each by the field it depends on."""
        n = len(self.grid.kind)
        kappa, gamma, kappa_by, gamma_by = interpolation(density[:n], penalty, self.void_stiffness)
        if self.stiffer == 1.0:
            return ElementScales(kappa, gamma, np.ones(n)), kappa_by, gamma_by, _NONE
        stiffer, stiffer_by = stiffening(density[n:], penalty, self.stiffer)
        return ElementScales(kappa, gamma, stiffer), kappa_by, gamma_by, stiffer_by

    def _newton(self, scales: ElementScales, pressure: Array, u: Array) -> tuple[PartAtRest | None, str]:
        zero = np.zeros_like(u)
        balance_at = partial(self.balance, scales, pressure)
        scale = float(np.linalg.norm(balance_at(zero, with_stiffness=False).unbalanced)) or 1.0
        now = balance_at(u)
        factors = KeptFactors()
        for _ in range(ROUNDS):
            if now.inverted >= 0:
                return None, self._inversion(now.inverted)
            size = float(np.linalg.norm(now.unbalanced))
            is_met = size <= TOLERANCE * scale
            # That of the state itself, for the derivatives.
            self._matrix.data = balance_at(u).data if is_met else now.data
            if is_met:
                return PartAtRest(u, now.stored, size / scale, self._matrix, factors), ""
            # The nearer to rest, the more exact: so that steps near it square the residual.
            share = min(STEP_RESIDUAL, size / scale)
            off = now.unbalanced.ravel()[self._free]
            found = factors.solve(self._matrix, off, share, self._factorised)
            if found is None:
                return None, "the stiffness is singular"
            step = zero.copy()
            step.ravel()[self._free] = -found
            u, now = shortened(balance_at, u, step)
        return None, f"the residual is {size / scale:.1e} after {ROUNDS} iterations"

    def _factorised(self, matrix: Any) -> Factors | None:
        return factorised(matrix, is_solid=self.grid.mesh.space == "solid", order=self._order)

    def _inversion(self, e: int) -> str:
        return f"the solid at {place_text(self.grid.centres[e])} turns inside out"

    def evaluate(
        self,
        density: Array,
        penalty: float,
        pressure_pa: float,
        guess: Array,
        may_lower: bool = False,
    ) -> Evaluation:
        """Return -u_out / SE^m with its gradient, (T9).

        Parameters
        ----------
        density : ndarray, (e,) or (2 e,)
            Densities of the elements, and their shares of a second material.
        penalty : float
            Exponent of the stiffness.
        pressure_pa : float
            Of the inlet.
        guess : ndarray, (n, d)
            Displacements to begin with [m].
        may_lower : bool
            That of `rest`.

        Raises
        ------
        ModelError
            Where there is no equilibrium, or the air strains nothing.
        """
        solid = density[: len(self.grid.kind)]
        air = pressures(self.grid, self.flow, solid, pressure_pa * self.held)
        at = self.rest(density, penalty, air.at_nodes, guess, may_lower)
        if at.share < 1.0:
            air = pressures(self.grid, self.flow, solid, at.share * pressure_pa * self.held)
        scales, kappa_by, gamma_by, stiffer_by = self._scales(density, penalty)
        out, m = float((self.output * at.u).sum()), self.exponent
        if at.stored <= 0.0:
            raise ModelError("the air of the inlet strains nothing: it meets no solid that is held", "inlet")
        objective = -out / at.stored**m
        # d(objective) = by_out d(out) + by_energy d(stored)
        by_out, by_energy = -(at.stored**-m), m * out * at.stored ** (-m - 1.0)
        # The force of the material alone is the slope of its energy.
        no_air = np.zeros_like(air.at_nodes)
        alone = self.balance(scales, no_air, at.u, with_stiffness=False)
        inner = alone.unbalanced - np.where(self.is_held, 0.0, self.spring * at.u)
        adjoint = np.zeros(at.u.size)
        right = (by_out * self.output + by_energy * inner).ravel()[self._free]
        moved = at.factors.solve(at.stiffness, right, ADJOINT_RESIDUAL, self._factorised)
        if moved is None and may_lower:
            lower = self.evaluate(density, penalty, at.share * LOWERED * pressure_pa, guess)
            return replace(lower, share=at.share * LOWERED)
        if moved is None:
            raise ModelError("the stiffness of the part at rest is singular: it may snap there", "pressure")
        adjoint[self._free] = -moved
        by_element, by_pressure = np.empty((len(scales.kappa), 5)), np.empty(len(no_air))
        state = at.u, adjoint.reshape(at.u.shape)
        sensitivities(self._elements, scales, air.at_nodes, state, (by_element, by_pressure))
        by_kappa = by_energy * by_element[:, 0] + by_element[:, 2]
        by_gamma = by_energy * by_element[:, 1] + by_element[:, 3]
        by_solid = by_energy * by_element[:, 0] + by_element[:, 4]
        by_kappa += (scales.stiffer - 1.0) * by_solid
        gradient = by_kappa * kappa_by + by_gamma * gamma_by + air.back(by_pressure)
        if self.stiffer != 1.0:
            gradient = np.concatenate([gradient, by_solid * scales.kappa * stiffer_by])
        return Evaluation(objective, gradient, out, at.u, air.at_nodes, at.residual, at.share)
