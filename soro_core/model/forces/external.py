"""Forces on the arm from outside at places along it: wrenches, contact, the held tip.

Seen from the frame b of a link's base, a particle at x_b moves with V_b + B1 qd (`sweep`). A force on it is a
wrench in b, and joins the wrench of the link's own mass before the chain is closed (`exact.close_forces`),
so nothing here grows with more than the number of places. The tangent of a force at the point, a symmetric
3 x 3 matrix K, adds A K A' to the link's inertia as a body (A' takes a twist in b to the velocity of the
point), A K A' B1 to its coupling and B1' A K A' B1 to its matrix: the factors of `articulated` stay linear in
the links with contact too.
"""

from __future__ import annotations

from soro_core._by_type import select_by_type
from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.forces.contact import add_force, add_tangent, gap, stored_energy
from soro_core.model.links.lie import compose, dot6, to_body, wrench_to_parent
from soro_core.model.links.linear import assign, assign_matrix, clear, clear_matrix
from soro_core.model.links.link_kinematics import along_constant, begin_varying, step_varying, whole_step
from soro_core.model.links.point import add_point_force, move_point, point_momentum
from soro_core.model.links.sweep import ride
from soro_core.model.records import CrossSection, Motion, SubInterval, TangentFactors
from soro_core.model.tables import CONTACT, HELD, External, NoExternal, Tables
from soro_core.model.work import (
    LINK_BASE,
    LINK_TWIST,
    NORMAL,
    POINT_FORCE,
    POSITION,
    SITE,
    SITE_COLUMNS,
    SITE_TWIST,
    SITE_WRENCH,
    TOUCH,
    UNIT_TWIST,
    UNIT_WRENCH,
    VELOCITY,
    WALKED,
    WALKED_COLUMNS,
    Work,
)


@inner
def _visit(t: Tables, w: Work, wrench: Array, motion: Motion, factors: TangentFactors, tau: Array) -> float:
    """Go outward from place to place; forces where by_q and by_v are 0, else tangents."""
    e, q, qd = t.external, motion.q, motion.qd
    R, p, V = w.site_rotation[LINK_BASE], w.site_position[LINK_BASE], w.site_vectors[LINK_TWIST]
    R_node, p_node = w.site_rotation[WALKED], w.site_position[WALKED]
    Rs, ps = w.site_rotation[SITE], w.site_position[SITE]
    B_node, B1 = w.site_columns[WALKED_COLUMNS], w.site_columns[SITE_COLUMNS]
    walked, site = CrossSection(R_node, p_node, B_node), CrossSection(Rs, ps, B1)
    energy = 0.0
    assign_matrix(t.base_rotation, R)
    assign(t.base_position, p)
    clear(V)
    ride(t.base, V, V, w.site_vectors[SITE_TWIST])  # the last is scratch
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        m = t.offset[i + 1] - first
        done = 0
        if t.varying[i]:
            begin_varying(walked)
        for k in range(e.first[i], e.first[i + 1]):
            whole = e.whole[k]
            if whole == t.fraction.shape[0]:
                assign_matrix(w.end_rotation[i], Rs)
                assign(w.end_position[i], ps)
                assign_matrix(w.end_columns[i], B1)
            elif t.varying[i]:
                for n in range(done, whole):
                    step_varying(t, w, i, whole_step(t, i, n), q, walked)
                done = whole
                assign_matrix(R_node, Rs)
                assign(p_node, ps)
                assign_matrix(B_node, B1)
                if e.step[k] > 0.0:
                    step_varying(t, w, i, SubInterval(e.step[k], e.shape[k], e.rest[k]), q, site)
            else:
                along_constant(t, w, i, e.place[k], q, site)
            Vk = w.site_vectors[SITE_TWIST]
            assign(V, Vk)
            for j in range(m):
                for r in range(6):
                    Vk[r] += B1[j, r] * qd[first + j]
            if factors.by_q + factors.by_v > 0.0:
                _add_tangent(t, w, i, k, factors)
            else:
                energy += _add_force(t, w, i, k, wrench, tau)
        for j in range(m):
            for r in range(6):
                V[r] += w.end_columns[i, j, r] * qd[first + j]
        to_body(w.end_rotation[i], w.end_position[i], V)
        compose(R, p, w.end_rotation[i], w.end_position[i])
    return energy


@inner
def _touch(w: Work, obstacle: Array, radius: float, moving: float) -> float:
    """Depth of the round section at the place in an obstacle that has been `moving` for some seconds.

    Where it is above 0, w.points has NORMAL, in the world, TOUCH, the point of the section that touches, seen
    from the base of the link, its POSITION in the world, and its VELOCITY seen from the obstacle.
    """
    R, p, V = w.site_rotation[LINK_BASE], w.site_position[LINK_BASE], w.site_vectors[SITE_TWIST]
    ps, x, u = w.site_position[SITE], w.points[POSITION], w.points[VELOCITY]
    n, c = w.points[NORMAL], w.points[TOUCH]
    move_point(R, p, ps, V, x, u)
    for r in range(3):
        x[r] -= obstacle[11 + r] * moving
    depth = radius - gap(obstacle, x, n)
    if depth > 0.0:
        for r in range(3):
            c[r] = ps[r] - radius * (R[0, r] * n[0] + R[1, r] * n[1] + R[2, r] * n[2])
        move_point(R, p, c, V, x, u)
        for r in range(3):
            u[r] -= obstacle[11 + r]
    return depth


@inner
def _add_force(t: Tables, w: Work, i: int, k: int, wrench: Array, tau: Array) -> float:
    """Force at place k of link i; gives the energy stored in it."""
    e = t.external
    R, p, V = w.site_rotation[LINK_BASE], w.site_position[LINK_BASE], w.site_vectors[SITE_TWIST]
    Rs, ps, B1 = w.site_rotation[SITE], w.site_position[SITE], w.site_columns[SITE_COLUMNS]
    f, total = w.site_vectors[SITE_WRENCH], w.site_force[k]
    x, u, n = w.points[POSITION], w.points[VELOCITY], w.points[NORMAL]
    c, F = w.points[TOUCH], w.points[POINT_FORCE]
    energy = 0.0
    clear(f)
    clear(total)
    if e.kind[k] == CONTACT:
        for o in range(e.obstacles.shape[0]):
            depth = _touch(w, e.obstacles[o], e.radius[k], e.clock[0])
            if depth > 0.0:
                clear(F)
                add_force(e.obstacles[o], depth, n, u, F)
                add_point_force(R, c, F, f)
                energy += stored_energy(e.obstacles[o], depth)
                for r in range(3):
                    total[r] += F[r]
    elif e.kind[k] == HELD:
        move_point(R, p, ps, V, x, u)
        for r in range(3):
            off = x[r] - e.held[r]
            total[r] = -e.held[3 + r] * off - e.held[6 + r] * u[r]
            energy += 0.5 * e.held[3 + r] * off * off
        add_point_force(R, ps, total, f)
    else:
        for r in range(6):
            f[r] = wrench[e.kind[k] + r]
        wrench_to_parent(Rs, ps, f)
        for r in range(3):
            total[r] = R[r, 0] * f[3] + R[r, 1] * f[4] + R[r, 2] * f[5]
    first = t.offset[i]
    for r in range(6):
        w.own[i, r] -= f[r]
    for j in range(t.offset[i + 1] - first):
        tau[first + j] -= dot6(B1[j], f)
    return energy


@inner
def _add_tangent(t: Tables, w: Work, i: int, k: int, factors: TangentFactors) -> None:
    """Tangent at place k of link i."""
    e = t.external
    K = w.site_stiffness
    u, n = w.points[VELOCITY], w.points[NORMAL]
    if e.kind[k] == CONTACT:
        for o in range(e.obstacles.shape[0]):
            depth = _touch(w, e.obstacles[o], e.radius[k], e.clock[0])
            if depth > 0.0:
                clear_matrix(K)
                add_tangent(e.obstacles[o], depth, n, u, factors, K)
                _add_body(t, w, i, w.points[TOUCH])
    elif e.kind[k] == HELD:
        clear_matrix(K)
        for r in range(3):
            K[r, r] = factors.by_q * e.held[3 + r] + factors.by_v * e.held[6 + r]
        _add_body(t, w, i, w.site_position[SITE])


@inner
def _add_body(t: Tables, w: Work, i: int, c: Array) -> None:
    """Add w.site_stiffness (in the world) at the point c of b to the body of link i."""
    R, K, B1 = w.site_rotation[LINK_BASE], w.site_stiffness, w.site_columns[SITE_COLUMNS]
    unit, h = w.site_vectors[UNIT_TWIST], w.site_vectors[UNIT_WRENCH]
    F, M, N = w.coupling[i], w.mass[i], w.extra[i]
    clear(unit)
    for r in range(6):
        unit[r] = 1.0
        point_momentum(R, c, K, unit, w.points[POINT_FORCE], h)
        unit[r] = 0.0
        for d in range(6):
            N[d, r] += h[d]
    for j in range(t.offset[i + 1] - t.offset[i]):
        point_momentum(R, c, K, B1[j], w.points[POINT_FORCE], h)
        for r in range(6):
            F[j, r] += h[r]
        for d in range(j + 1):
            M[j, d] += dot6(B1[d], h)


@inner
def _no_forces(e: External, t: Tables, w: Work, wrench: Array, motion: Motion, tau: Array) -> float:
    return 0.0


@inner
def _forces(e: External, t: Tables, w: Work, wrench: Array, motion: Motion, tau: Array) -> float:
    return _visit(t, w, wrench, motion, TangentFactors(0.0, 0.0, 0.0), tau)


@inner
def _no_tangents(e: External, t: Tables, w: Work, q: Array, qd: Array, factors: TangentFactors) -> None:
    return


@inner
def _tangents(e: External, t: Tables, w: Work, q: Array, qd: Array, factors: TangentFactors) -> None:
    for i in range(w.extra.shape[0]):
        clear_matrix(w.extra[i])
    if factors.by_q + factors.by_v > 0.0:
        _visit(t, w, w.zero, Motion(q, qd, qd, w.zero), factors, w.zero)


add_external_forces = select_by_type(NoExternal, _no_forces, _forces)
"""add_external_forces(t.external, t, w, wrench, motion, tau), after `sweep` at q: w.own and tau -= what acts
from outside; gives the energy stored in it [J].

`wrench`: that at the tip, left to `close_forces`, then one for each place (6 numbers each, in the frame of
the place). Writes the force at each place, in the world, to w.site_force."""
add_external_tangents = select_by_type(NoExternal, _no_tangents, _tangents)
"""add_external_tangents(t.external, t, w, q, qd, factors), after `sweep` with bodies: w.mass,
w.coupling += and w.extra <- by_q and by_v times the tangents. `secant`: see `contact.add_tangent`."""
