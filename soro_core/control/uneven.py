"""The uneven bend of a link under load, which strains that are constant along links do not have.

Weight bends a link more near its base. With strain that varies linearly along each link, coordinates x, the arm
at rest keeps

    f(x) + m Y(x) = H(x) p,   link ends at those of q

and p makes the force H_1(q) p in the coordinates q, not G + f_e + m Y_m. One step of Newton a tick follows x.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.adaptation.scales import q_scale_of
from soro_core.model import SoftArm
from soro_core.robot.coordinates import strain_fields
from soro_core.robot.discretisation import with_basis
from soro_core.robot.parts import fields as parts_of

Array: TypeAlias = NDArray[np.float64]

_STEP = 1e-6


@dataclass(frozen=True)
class UnevenForce:
    """What the force of an even arm lacks at rest, about coordinates q and a mass.

    Attributes
    ----------
    q, mass_kg : ndarray (n_q,), float
        Where it is found.
    force, by_mass : ndarray (n_q,)
        The force, and its change by the mass at the tip.
    slope : ndarray (n_q, n_q)
        Its change by q.
    """

    q: Array
    mass_kg: float
    force: Array
    by_mass: Array
    slope: Array

    def at(self, q: Array) -> Array:
        return np.asarray(self.force + self.slope @ (q - self.q))


@dataclass(frozen=True)
class Shape:
    deviation: Array
    force: Array
    stiffness: Array | None = None
    even: Array | None = None
    column: int = 0


class Uneven:
    def __init__(self, arm: SoftArm, pieces: int = 1) -> None:
        self.arm = arm
        links = []
        for link in arm.robot.links:
            part = parts_of(link)
            part.update(damping=None, creep=[], hysteresis=[])
            links.append(part)
        fine = with_basis(arm.robot.replace(links=links), "legendre", 1)
        self.fine = SoftArm(fine)
        fields = strain_fields(fine)
        n = arm.n_q
        self.spread = np.zeros((self.fine.n_q, n))
        self.spread[np.arange(0, self.fine.n_q, 2), np.arange(n)] = 1.0
        self.unit = q_scale_of(arm, pieces)
        self.fine_unit = np.repeat(self.unit, 2)
        self.ends = np.cumsum([link.length for link in arm.robot.links])
        self.ends[-1] = arm.length

    def initial_state(self) -> Shape:
        return Shape(np.zeros(self.fine.n_q), np.zeros(self.arm.n_q))

    def step(self, state: Shape, q: Array, mass: float) -> tuple[Shape, UnevenForce]:
        arm, fine, n, nf = self.arm, self.fine, self.arm.n_q, self.fine.n_q
        x = self.spread @ q + state.deviation
        here = arm.actuation_matrix(q)
        scaled = self.unit[:, None] * here
        to_pressure = scaled.T @ np.linalg.solve(scaled @ scaled.T, np.diag(self.unit))
        even = _static(arm, q, mass)
        force = even if state.stiffness is None else state.force
        made = fine.actuation_matrix(x) @ to_pressure
        pressure = to_pressure @ force

        def missed(at: Array) -> Array:
            return _static(fine, at, mass) - fine.actuation_matrix(at) @ pressure

        def missed_even(at: Array) -> Array:
            return _static(arm, at, mass) - arm.actuation_matrix(at) @ pressure

        now = missed(x)
        stiffness = _column(state.stiffness, state.column, x, now, self.fine_unit, missed)
        slope = _column(state.even, state.column, q, missed_even(q), self.unit, missed_even)
        wanted, of_q = self._places(arm, q)
        found, of_x = self._places(fine, x)
        back = np.linalg.pinv(of_q * self.unit) * 1.0
        back = self.unit[:, None] * back
        C = back @ of_x
        us, ux = self.unit, self.fine_unit
        # in units: x = ux xi, u = v / us  (energy)
        A = np.zeros((nf + n, nf + n))
        A[:nf, :nf] = ux[:, None] * stiffness * ux
        A[:nf, nf:] = -ux[:, None] * made / us
        A[nf:, :nf] = C * ux / us[:, None]
        rhs = np.zeros((nf + n, 2 + n))
        rhs[:nf, 0] = -ux * now
        rhs[nf:, 0] = -(back @ (found - wanted)) / us
        zero = np.zeros(nf)
        rhs[:nf, 1] = -ux * fine.tip_mass_force(x, zero, zero)
        rhs[nf:, 2:] = np.diag(1.0 / us)
        sol = np.linalg.solve(A, rhs)
        dx, du = ux[:, None] * sol[:nf], sol[nf:] / us[:, None]
        force = force + du[:, 0]
        none = np.zeros(n)
        result = UnevenForce(
            q, mass, force - even, du[:, 1] - arm.tip_mass_force(q, none, none), du[:, 2:] - slope
        )
        deviation = state.deviation + dx[:, 0]
        return Shape(deviation, force, stiffness, slope, state.column + 1), result

    def _places(self, arm: SoftArm, q: Array) -> tuple[Array, Array]:
        places, slopes = [], []
        for end in self.ends:
            pose, jacobian = arm.pose_and_jacobian(q, end)
            places.append(pose[:3, 3])
            slopes.append(pose[:3, :3] @ jacobian[3:])
        return np.concatenate(places), np.concatenate(slopes)


def _static(arm: SoftArm, q: Array, mass: float) -> Array:
    zero = np.zeros(arm.n_q)
    return np.asarray(
        arm.inverse_dynamics(q, zero, zero, zero) + arm.elastic_force(q) + mass * arm.tip_mass_force(q, zero, zero)
    )


def _column(last, column, q, now, unit, missed):
    first = last is None
    columns = range(q.size) if first else (column % q.size,)
    slope = np.zeros((q.size, q.size)) if first else last.copy()
    for k in columns:
        moved = q.copy()
        moved[k] += _STEP * unit[k]
        slope[:, k] = (missed(moved) - now) / (_STEP * unit[k])
    return slope
