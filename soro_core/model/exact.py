"""The method `exact`: closed forms and Magnus steps along the links, Gauss-Radau quadrature of mass."""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.forces.external import add_external_forces, add_external_tangents
from soro_core.model.links.articulated import complete_rigid, factor, inertia_to_parent, solve
from soro_core.model.links.lie import compose, dot6, to_body, wrench_to_parent
from soro_core.model.links.linear import assign, assign_matrix, clear, clear_matrix
from soro_core.model.links.link_kinematics import along_constant, begin_varying, step_varying, whole_step
from soro_core.model.links.sweep import DRIVEN, FREE, NO, REFERENCE, YES, move, ride, sweep
from soro_core.model.records import Asked, CrossSection, Masses, Motion, SubInterval, TangentFactors
from soro_core.model.tables import Site, Tables
from soro_core.model.work import (
    BASE_ACCELERATION,
    BASE_TWIST,
    BODY,
    BODY_MOMENTUM,
    CLOSING_WRENCH,
    NODE,
    Work,
)


@inner
def own_masses(t: Tables) -> Masses:
    """Return those of the arm itself."""
    return Masses(t.mass, t.tip_mass[0], t.gravity)


@inner
def at_rest(w: Work, q: Array) -> Motion:
    """Return no motion, at q."""
    return Motion(q, w.zero, w.zero, w.zero)


@inner
def close_forces(t: Tables, w: Work, wrench: Array, tau: Array) -> None:
    """tau += what the links outward need: from the wrenches of `sweep`, less `wrench` at the tip."""
    f = w.vectors[CLOSING_WRENCH]
    for r in range(6):
        f[r] = -wrench[r]
    for i in range(t.length.shape[0] - 1, -1, -1):
        wrench_to_parent(w.end_rotation[i], w.end_position[i], f)
        first = t.offset[i]
        for j in range(t.offset[i + 1] - first):
            tau[first + j] += dot6(w.end_columns[i, j], f)
        for r in range(6):
            f[r] += w.own[i, r]


@inner
def inertial_force(t: Tables, w: Work, masses: Masses, none: Array, motion: Motion, tau: Array) -> None:
    """tau <- M(q) a + C(q, qd) v + G(q), by the recursion of Newton and Euler; `none` (6,) is zero."""
    sweep(t, w, masses, motion, Asked(NO, REFERENCE), tau)
    close_forces(t, w, none, tau)


@inner
def motion_force(t: Tables, w: Work, none: Array, tip_mass: float, motion: Motion, tau: Array) -> None:
    """tau <- M a + C qd + G with this mass at the tip; `none` (6,) is zero."""
    sweep(t, w, Masses(t.mass, tip_mass, t.gravity), motion, Asked(NO, DRIVEN), tau)
    close_forces(t, w, none, tau)


@inner
def tip_mass_force(t: Tables, w: Work, q: Array, qd: Array, a: Array, tau: Array) -> None:
    """tau <- force per kg at the tip, J_tip' (0, A + omega x V), after `motion_force` of this motion."""
    V, A = w.vectors[BASE_TWIST], w.vectors[BASE_ACCELERATION]  # the pass has left those of the tip there
    f = w.vectors[CLOSING_WRENCH]
    f[0] = f[1] = f[2] = 0.0
    f[3] = A[3] + V[1] * V[5] - V[2] * V[4]
    f[4] = A[4] + V[2] * V[3] - V[0] * V[5]
    f[5] = A[5] + V[0] * V[4] - V[1] * V[3]
    for i in range(t.length.shape[0] - 1, -1, -1):
        wrench_to_parent(w.end_rotation[i], w.end_position[i], f)
        first = t.offset[i]
        for j in range(t.offset[i + 1] - first):
            tau[first + j] = dot6(w.end_columns[i, j], f)


@inner
def link_ends(t: Tables, w: Work, places: Array, by_q: Array) -> None:
    """places (3 n,) <- ends of the links in the world, by_q (3 n, n_q) <- their derivatives, after a pass."""
    R, p, J = w.frame_rotation[BODY], w.frame_position[BODY], w.columns
    assign_matrix(t.base_rotation, R)
    assign(t.base_position, p)
    clear_matrix(J)
    for i in range(t.length.shape[0]):
        first, behind = t.offset[i], t.offset[i + 1]
        for j in range(behind - first):
            assign(w.end_columns[i, j], J[first + j])
        for b in range(behind):
            to_body(w.end_rotation[i], w.end_position[i], J[b])
        compose(R, p, w.end_rotation[i], w.end_position[i])
        for r in range(3):
            places[3 * i + r] = p[r]
            for b in range(J.shape[0]):
                by_q[3 * i + r, b] = R[r, 0] * J[b, 3] + R[r, 1] * J[b, 4] + R[r, 2] * J[b, 5]


@inner
def external_force(t: Tables, w: Work, wrench: Array, q: Array, qd: Array, tau: Array) -> float:
    """tau <- the generalised force of all that acts from outside; gives the energy stored in it [J]."""
    sweep(t, w, own_masses(t), at_rest(w, q), Asked(NO, NO), tau)
    energy = add_external_forces(t.external, t, w, wrench, Motion(q, qd, qd, w.zero), tau)
    close_forces(t, w, wrench, tau)
    for b in range(q.shape[0]):
        tau[b] = -tau[b]
    return energy


@inner
def inverse_dynamics(t: Tables, w: Work, wrench: Array, motion: Motion, bodies: float, tau: Array) -> None:
    """tau <- M a + C qd + G - what acts from outside; `bodies` = YES leaves what `factor_system` needs."""
    sweep(t, w, own_masses(t), motion, Asked(bodies, DRIVEN), tau)
    add_external_forces(t.external, t, w, wrench, motion, tau)
    close_forces(t, w, wrench, tau)


@inner
def inertia(t: Tables, w: Work, mass: Array, tip_mass: float, q: Array, M: Array) -> None:
    """M <- int J' Mcal J, docs/model.md (13), all of it (n_q, n_q): from the tip inward."""
    n_q = q.shape[0]
    sweep(t, w, Masses(mass, tip_mass, t.gravity), at_rest(w, q), Asked(YES, NO), w.bias)
    beyond, T = w.beyond, w.rotated
    h = w.vectors[BODY_MOMENTUM]
    n = t.length.shape[0]
    clear_matrix(beyond)
    for i in range(n - 1, -1, -1):
        # `beyond`: the links beyond as one rigid body about the end of this one.
        first = t.offset[i]
        m = t.offset[i + 1] - first
        if i < n - 1:
            inertia_to_parent(w.end_rotation[i], w.end_position[i], beyond, T)
            for b in range(first + m, n_q):
                wrench_to_parent(w.end_rotation[i], w.end_position[i], w.columns[b])
        for j in range(m):
            for e in range(j + 1):
                M[first + j, first + e] = w.mass[i, j, e]
            assign(w.coupling[i, j], w.columns[first + j])
            if i < n - 1:
                for r in range(6):
                    h[r] = dot6(beyond[r], w.end_columns[i, j])
                for e in range(j + 1):
                    M[first + j, first + e] += dot6(w.end_columns[i, e], h)
                for r in range(6):
                    w.columns[first + j, r] += h[r]
            for b in range(first + m, n_q):
                M[b, first + j] = dot6(w.end_columns[i, j], w.columns[b])
        complete_rigid(w.inertia[i])
        for r in range(6):
            for c in range(6):
                beyond[r, c] += w.inertia[i, r, c]
    for b in range(n_q):
        for d in range(b):
            M[d, b] = M[b, d]


@inner
def acceleration(t: Tables, w: Work, wrench: Array, q: Array, qd: Array, qdd: Array) -> bool:
    """qdd <- M^-1 (w.applied + what acts from outside - C qd - G); False if M is not positive definite."""
    bias, force, motion = w.bias, w.applied, Motion(q, qd, qd, w.zero)
    sweep(t, w, own_masses(t), motion, Asked(YES, FREE), bias)
    add_external_forces(t.external, t, w, wrench, motion, bias)
    close_forces(t, w, wrench, bias)
    for b in range(q.shape[0]):
        qdd[b] = force[b] - bias[b]
    if not factor(t, w, NO):
        return False
    solve(t, w, qdd)
    return True


@inner
def factor_system(t: Tables, w: Work, q: Array, qd: Array, factors: TangentFactors) -> bool:
    """Factor M(q) + w.block - by_q dF/dq - by_v dF/dqd for `solve`, after `inverse_dynamics` with bodies.

    F is what acts from outside, its tangents made symmetric (`contact.add_tangent`, also for `secant`).

    False if it is not positive definite; `w` is then good for a new pass only.
    """
    add_external_tangents(t.external, t, w, q, qd, factors)
    return factor(t, w, YES)


@inner
def energy(t: Tables, w: Work, q: Array, qd: Array) -> tuple[float, float]:
    """Kinetic and gravitational energy [J], from each link as a body: int V' Mcal V / 2, -int rho p . gamma.

    The latter is zero at the world's origin.
    """
    sweep(t, w, own_masses(t), at_rest(w, q), Asked(YES, NO), w.bias)
    R, p, V = w.frame_rotation[BODY], w.frame_position[BODY], w.vectors[BASE_TWIST]
    assign_matrix(t.base_rotation, R)
    assign(t.base_position, p)
    clear(V)
    ride(t.base, V, V, w.vectors[BASE_ACCELERATION])  # the last is scratch
    kinetic, potential = 0.0, 0.0
    for i in range(t.length.shape[0]):
        N, F, M = w.inertia[i], w.coupling[i], w.mass[i]
        first = t.offset[i]
        m = t.offset[i + 1] - first
        for r in range(3):
            moment = N[3, 3] * p[r] + R[r, 0] * N[3, 0] + R[r, 1] * N[4, 0] + R[r, 2] * N[5, 0]
            potential -= moment * t.gravity[r]
        complete_rigid(N)
        for r in range(6):
            kinetic += 0.5 * V[r] * dot6(N[r], V)
        for j in range(m):
            momentum = dot6(F[j], V) + 0.5 * M[j, j] * qd[first + j]
            for e in range(j):
                momentum += M[j, e] * qd[first + e]
            kinetic += momentum * qd[first + j]
        move(m, w.end_columns[i], qd, first, V, V)
        to_body(w.end_rotation[i], w.end_position[i], V)
        compose(R, p, w.end_rotation[i], w.end_position[i])
    return kinetic, potential


@inner
def kinematics(t: Tables, w: Work, site: Site, q: Array, at: CrossSection) -> None:
    """at <- pose in the world and body Jacobian, transposed (n_q, 6), at a place of the arm."""
    R, p, J = at
    B1 = w.node
    R1, p1 = w.frame_rotation[NODE], w.frame_position[NODE]
    on_link = CrossSection(R1, p1, B1)
    assign_matrix(t.base_rotation, R)
    assign(t.base_position, p)
    clear_matrix(J)
    for i in range(site.link + 1):
        last = i == site.link
        first = t.offset[i]
        m = t.offset[i + 1] - first
        if t.varying[i]:
            begin_varying(on_link)
            for k in range(site.whole if last else t.fraction.shape[0]):
                step_varying(t, w, i, whole_step(t, i, k), q, on_link)
            if last and site.step > 0.0:
                step_varying(t, w, i, SubInterval(site.step, site.shape, site.rest), q, on_link)
        else:
            along_constant(t, w, i, site.place if last else t.length[i], q, on_link)
        for j in range(m):
            assign(B1[j], J[first + j])
        for b in range(first + m):
            to_body(R1, p1, J[b])
        compose(R, p, R1, p1)
