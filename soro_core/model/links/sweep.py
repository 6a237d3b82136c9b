"""One pass along the links: the inertia of each by itself, and the forces that its motion asks for.

Each link is seen from the frame b of its base, in closed form (`link`) or by Magnus steps (`magnus`), so
that nothing of the links before has to be carried to its nodes; the chain is closed in `exact`.
"""

from __future__ import annotations

from soro_core._by_type import select_by_type
from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.lie import (
    add,
    add_ad,
    add_coad,
    dot6,
    exponential,
    stumpff,
    tangent_coefficients,
    to_body,
)
from soro_core.model.links.linear import assign, assign_matrix, clear, clear_matrix
from soro_core.model.links.link import (
    ad_powers,
    chain_powers,
    chain_rate_at,
    columns_at,
    momentum,
    node,
    strain_twist,
)
from soro_core.model.links.magnus import magnus_step
from soro_core.model.records import Asked, CrossSection, Masses, Motion, SubInterval
from soro_core.model.tables import BaseMotion, FixedBase, Tables
from soro_core.model.work import (
    BASE_ACCELERATION,
    BASE_REFERENCE,
    BASE_TWIST,
    COLUMN_RATE,
    FORCE,
    MOMENTUM,
    NODE,
    NODE_ACCELERATION,
    NODE_REFERENCE,
    NODE_TWIST,
    RELATIVE_TWIST,
    STRAIN,
    STRAIN_RATE,
    Work,
)

# Numbers, because a literal truth value would compile the pass again for each combination.
YES, NO = 1.0, 0.0
# Forces of the motion (q, qd) alone, with an acceleration, and with a reference velocity besides.
FREE, DRIVEN, REFERENCE = 1.0, 2.0, 3.0


@inner
def _stay(e: BaseMotion, V: Array, W: Array, A: Array) -> None:
    return


@inner
def _ride(e: BaseMotion, V: Array, W: Array, A: Array) -> None:
    for r in range(6):
        V[r] = W[r] = e.twist[r]
        A[r] += e.rate[r]


ride = select_by_type(FixedBase, _stay, _ride)
"""ride(t.base, V, W, A): V, W <- twist of a base that moves, A += its rate."""


@inner
def start(t: Tables, gravity: Array, V: Array, W: Array, A: Array) -> None:
    """Twists and acceleration of the base; gravity is an acceleration of it."""
    for r in range(3):
        V[r] = V[3 + r] = W[r] = W[3 + r] = A[r] = 0.0
        A[3 + r] = -(
            t.base_rotation[0, r] * gravity[0]
            + t.base_rotation[1, r] * gravity[1]
            + t.base_rotation[2, r] * gravity[2]
        )
    ride(t.base, V, W, A)


@inner
def move(m: int, B1: Array, x: Array, first: int, V: Array, Vk: Array) -> None:
    """Vk <- V + B1 x: the twist of a particle from that of the link's base."""
    y0, y1, y2, y3, y4, y5 = V[0], V[1], V[2], V[3], V[4], V[5]
    for j in range(m):
        f = x[first + j]
        y0 += B1[j, 0] * f
        y1 += B1[j, 1] * f
        y2 += B1[j, 2] * f
        y3 += B1[j, 3] * f
        y4 += B1[j, 4] * f
        y5 += B1[j, 5] * f
    Vk[0], Vk[1], Vk[2], Vk[3], Vk[4], Vk[5] = y0, y1, y2, y3, y4, y5


@inner
def sweep(t: Tables, w: Work, masses: Masses, motion: Motion, asked: Asked, tau: Array) -> None:
    """Fill `w` with the end of each link and, as asked, its inertia (`bodies` above 0) and its forces.

    tau <- what each link's own mass needs of its coordinates, w.own <- the wrench about its base, for the
    motion (q, qd), reference velocity v and acceleration a: C is that of docs/model.md (13), so that Mdot -
    2C is skew. `forces` selects the motion: FREE has v = qd and a = 0, DRIVEN has v = qd, REFERENCE all.
    """
    q, qd, v, a = motion
    bodies, forces = asked
    V, A = w.vectors[BASE_TWIST], w.vectors[BASE_ACCELERATION]
    Vk, Ak = w.vectors[NODE_TWIST], w.vectors[NODE_ACCELERATION]
    apart = forces > DRIVEN
    W, Wk = V, Vk
    if apart:
        W, Wk = w.vectors[BASE_REFERENCE], w.vectors[NODE_REFERENCE]
    h, f, xi, xi_rate = w.vectors[MOMENTUM], w.vectors[FORCE], w.vectors[STRAIN], w.vectors[STRAIN_RATE]
    rate, twist = w.vectors[COLUMN_RATE], w.vectors[RELATIVE_TWIST]
    B1, powers, chain = w.node, w.powers, w.chain
    c, co = w.stumpff, w.tangent
    R, p = w.frame_rotation[NODE], w.frame_position[NODE]
    start(t, masses.gravity, V, W, A)
    clear(tau)
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        m = t.offset[i + 1] - first
        F, M, N, own = w.coupling[i], w.mass[i], w.inertia[i], w.own[i]
        z, z_rate = 0.0, 0.0
        if t.varying[i]:
            clear_matrix(B1)
            clear_matrix(R)
            clear(p)
            clear(rate)
            R[0, 0] = R[1, 1] = R[2, 2] = 1.0
        else:
            strain_twist(t, i, q, xi)
            ad_powers(t, i, xi, powers)
            z = xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2]
            if forces > 0.0:
                clear(xi_rate)
                for j in range(m):
                    for r in range(6):
                        xi_rate[r] += t.basis[first + j, r] * qd[first + j]
                z_rate = 2.0 * (xi[0] * xi_rate[0] + xi[1] * xi_rate[1] + xi[2] * xi_rate[2])
                chain_powers(t, w, i, v)
        clear(own)
        if bodies > 0.0:
            clear_matrix(F)
            clear_matrix(M)
            clear_matrix(N)
        for k in range(t.fraction.shape[0]):
            s, dm, k2 = node(t, i, k, masses.link, masses.tip)
            if t.varying[i]:
                # Written out: a call of `whole_step` here costs links of constant strain a tenth.
                step = SubInterval(t.fraction[k] * t.length[i], t.shape[k], t.reference[k, i])
                magnus_step(t, w, i, step, motion, CrossSection(R, p, B1))
            else:
                stumpff(z * s * s, c)
                tangent_coefficients(c, co)
                columns_at(m, s, co, powers, B1)
                exponential(xi, s, c, R, p)
                if forces > 0.0:
                    chain_rate_at(s, z_rate * s * s, co, chain, rate)
            if forces > 0.0:
                # True twist V, reference twist W = J v, acceleration A = J a + Jdot v, in the base frame b.
                move(m, B1, qd, first, V, Vk)
                if apart:
                    move(m, B1, v, first, W, Wk)
                if forces > FREE:
                    move(m, B1, a, first, A, Ak)
                else:
                    assign(A, Ak)
                add((rate[0], rate[1], rate[2], rate[3], rate[4], rate[5]), 1.0, Ak)
                # f = N (A + ad_Vb W) - ad_V' N W
                momentum(dm, k2, R, p, Wk, h)
                assign(Ak, twist)
                add_ad(V, Wk, 1.0, twist)
                momentum(dm, k2, R, p, twist, f)
                add_coad(Vk, h, -1.0, f)
                add((f[0], f[1], f[2], f[3], f[4], f[5]), 1.0, own)
                for j in range(m):
                    tau[first + j] += dot6(B1[j], f)
            if bodies > 0.0:
                add_rigid(dm, k2, R, p, N)
                for j in range(m):
                    momentum(dm, k2, R, p, B1[j], h)
                    for r in range(6):
                        F[j, r] += h[r]
                    for e in range(j + 1):
                        M[j, e] += dot6(B1[e], h)
        assign_matrix(B1, w.end_columns[i])
        assign_matrix(R, w.end_rotation[i])
        assign(p, w.end_position[i])
        if forces > 0.0:
            # Jdot_next v = Ad^-1 (Jdot v - ad_w J v), w the twist of the end relative to b.
            for r in range(6):
                twist[r] = Vk[r] - V[r]
            add_ad(twist, Wk, -1.0, Ak)
            assign(Vk, V)
            assign(Ak, A)
            to_body(R, p, V)
            to_body(R, p, A)
            if apart:
                assign(Wk, W)
                to_body(R, p, W)


@inner
def add_rigid(dm: float, k2: float, R: Array, p: Array, N: Array) -> None:
    """N += inertia about the frame's origin of a round slice at p with normal R e3, as `momentum` has it.

    Only the lower triangle of the rotary block, the first moment and the mass: `articulated` completes it.
    """
    x, y, z = p[0], p[1], p[2]
    a, b, c = R[0, 2], R[1, 2], R[2, 2]
    N[0, 0] += dm * (y * y + z * z + k2 * (1.0 + a * a))
    N[1, 1] += dm * (x * x + z * z + k2 * (1.0 + b * b))
    N[2, 2] += dm * (x * x + y * y + k2 * (1.0 + c * c))
    N[1, 0] += dm * (k2 * a * b - x * y)
    N[2, 0] += dm * (k2 * a * c - x * z)
    N[2, 1] += dm * (k2 * b * c - y * z)
    N[3, 0] += dm * x
    N[4, 0] += dm * y
    N[5, 0] += dm * z
    N[3, 3] += dm
