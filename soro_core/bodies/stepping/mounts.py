"""Arms at the tip of another arm: one mover, with the coordinates of the carrier and of all that it carries.

The base of a carried arm k rides on the tip of its carrier h. With the twist of the tip J_h v_h, seen from
that base, its equation and the wrench that its base takes are

    A_k x_k + B_k a_k = r_k        f_k = B_k' x_k + C_k a_k + b_k        a_k = J_h x_h + Jdot_h v_h

and f_k acts back on the tip. Of x_k nothing is left in (C_k - B_k' A_k^-1 B_k) a_k + b_k + B_k' A_k^-1 r_k,
which the tip carries like a rigid body [F08, chapter 7]; the factors of each arm by itself stay as they are,
and the tip adds a change of rank 6 to those of the carrier. B and C are those of inertia alone: what they
lack (gravity and gyroscopic forces of a base that turns within a step) Newton's iteration finds by the
residual.
"""

from __future__ import annotations

from soro_core._box import view_at
from soro_core._by_type import select_by_type
from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.bodies.stepping.records import ArmTables
from soro_core.bodies.stepping.vectors import cross, subtract, turn
from soro_core.integrate.base_motion import WIDTH, move_base
from soro_core.integrate.step_work import Stepping
from soro_core.model.exact import inertial_force
from soro_core.model.links.lie import compose, dot6, to_body, wrench_to_parent
from soro_core.model.links.linear import assign, assign_matrix, clear, clear_matrix, lu_factor, lu_solve_rows
from soro_core.model.method import solve_system
from soro_core.model.records import Masses, Motion
from soro_core.model.tables import BaseMotion, FixedBase, Tables
from soro_core.model.work import BASE_ACCELERATION, BASE_TWIST, CLOSING_WRENCH, Work

# Rows of `MountTables.scratch`.
_TIP, _OWN, _GAIN = 0, 1, 2


@inner
def _ride_nothing(e: BaseMotion, arms: ArmTables, i: int, inputs: Array) -> None:
    return


@inner
def _ride(e: BaseMotion, arms: ArmTables, i: int, inputs: Array) -> None:
    m, h = arms.mounts, arms.mounts.carrier[i]
    if h < 0:
        return
    n = inputs.shape[0] - WIDTH
    R, p = m.carried_rotation[i], m.carried_place[i]
    assign_matrix(m.tip_rotation[h], R)
    assign(m.tip_place[h], p)
    compose(R, p, m.offset_rotation[i], m.offset_place[i])
    for r in range(3):
        for c in range(3):
            inputs[n + 3 * r + c] = R[r, c]
        inputs[n + 9 + r] = p[r]
    for row in range(2):
        x = inputs[n + 12 + 6 * row : n + 18 + 6 * row]
        assign(m.tip_motion[h, row], x)
        to_body(m.offset_rotation[i], m.offset_place[i], x)


ride_on_carrier = select_by_type(FixedBase, _ride_nothing, _ride)
"""ride_on_carrier(t.base, arms, i, inputs): inputs of the base of arm i <- that on its carrier, if any."""


@inner
def _locate_nothing(e: BaseMotion, arms: ArmTables, i: int, run: Stepping, v: Array) -> None:
    return


@inner
def _locate(e: BaseMotion, arms: ArmTables, i: int, run: Stepping, v: Array) -> None:
    m, h = arms.mounts, arms.mounts.carrier[i]
    if h < 0:
        return
    s = arms.first_site[h + 1] - 1
    assign_matrix(arms.R[s], m.tip_rotation[h])
    assign(arms.p[s], m.tip_place[h])
    clear_matrix(m.tip_motion[h])
    inputs = run.work.stage_pressure
    ride_on_carrier(e, arms, i, inputs)
    move_base(e, run.tables, inputs)
    assign(m.carried_place[i], arms.base_place[i])
    # Velocity of the tip in the world, for the speed of this arm: of its base at the end of the span.
    twist, seen = m.scratch[_TIP], m.scratch[_OWN]
    assign(arms.base_twist[h], twist)
    subtract(arms.p[s], arms.base_place[h], seen)
    cross(twist, seen, seen)
    for r in range(3):
        twist[3 + r] += seen[r]
    for b in range(arms.first_q[h], arms.first_q[h + 1]):
        column = arms.columns[s, b - arms.first_q[h]]
        turn(arms.R[s], column, seen)
        turn(arms.R[s], column[3:], seen[3:])
        for r in range(6):
            twist[r] += v[b] * seen[r]
    subtract(arms.base_place[i], arms.p[s], seen)
    cross(twist, seen, seen)
    for r in range(3):
        arms.base_twist[i, r] = twist[r]
        arms.base_twist[i, 3 + r] = twist[3 + r] + seen[r]


locate_mount = select_by_type(FixedBase, _locate_nothing, _locate)
"""locate_mount(t.base, arms, i, run, v): base of arm i at the start of a step <- its carrier's tip, if any.

Behind the sections of the carrier; v (n_q,) of all arms."""


@inner
def _note_nothing(e: BaseMotion, arms: ArmTables, i: int, t: Tables, w: Work) -> None:
    return


@inner
def _note(e: BaseMotion, arms: ArmTables, i: int, t: Tables, w: Work) -> None:
    m = arms.mounts
    assign(w.vectors[CLOSING_WRENCH], m.wrench[i])
    if not m.is_carrier[i]:
        return
    R, p, J = m.tip_rotation[i], m.tip_place[i], m.columns[i]
    assign_matrix(t.base_rotation, R)
    assign(t.base_position, p)
    for k in range(t.length.shape[0]):
        first, behind = t.offset[k], t.offset[k + 1]
        for j in range(behind - first):
            assign(w.end_columns[k, j], J[first + j])
        for b in range(behind):
            to_body(w.end_rotation[k], w.end_position[k], J[b])
        compose(R, p, w.end_rotation[k], w.end_position[k])
    # The pass has left the motion of the tip there, gravity among its accelerations.
    assign(w.vectors[BASE_TWIST], m.tip_motion[i, 0])
    assign(w.vectors[BASE_ACCELERATION], m.tip_motion[i, 1])
    g = t.gravity
    for r in range(3):
        m.tip_motion[i, 1, 3 + r] += R[0, r] * g[0] + R[1, r] * g[1] + R[2, r] * g[2]


note_tip = select_by_type(FixedBase, _note_nothing, _note)
"""note_tip(t.base, arms, i, t, w): wrench at the base of arm i; pose, columns, motion of a carrier's tip.

Behind `inverse_dynamics` in w."""


@inner
def _weigh_nothing(e: BaseMotion, arms: ArmTables, i: int, run: Stepping, q: Array) -> None:
    return


@inner
def _weigh(e: BaseMotion, arms: ArmTables, i: int, run: Stepping, q: Array) -> None:
    m, h = arms.mounts, arms.mounts.carrier[i]
    t, w, n = run.tables, run.work.model, q.shape[0]
    if m.is_carrier[i]:
        clear_matrix(m.load[i])
    if h < 0:
        return
    B, Z, C = m.columns[i], m.answers[i], m.load[i]
    zero, tau = w.zero, w.bias
    clear(e.twist)
    for c in range(6):
        clear(e.rate)
        e.rate[c] = 1.0
        masses = Masses(t.mass, t.tip_mass[0], m.no_gravity)
        inertial_force(t, w, masses, m.no_wrench[i], Motion(q, zero, zero, zero), tau)
        for b in range(n):
            B[b, c] = tau[b]
        for r in range(6):
            C[r, c] = w.vectors[CLOSING_WRENCH, r]
    x = run.work.residual
    for c in range(6):
        for b in range(n):
            x[b] = B[b, c]
        solve_system(t, run.work.system, x)
        for b in range(n):
            Z[b, c] = x[b]
        for r in range(6):
            for b in range(n):
                C[r, c] -= B[b, r] * x[b]
    # Seen from the tip: Ad^-T C Ad^-1, column by column of the unit twists there.
    unit, f = m.scratch[_TIP], m.scratch[_OWN]
    for c in range(6):
        clear(unit)
        unit[c] = 1.0
        to_body(m.offset_rotation[i], m.offset_place[i], unit)
        for r in range(6):
            f[r] = dot6(C[r], unit)
        wrench_to_parent(m.offset_rotation[i], m.offset_place[i], f)
        for r in range(6):
            m.load[h, r, c] += f[r]


weigh_mount = select_by_type(FixedBase, _weigh_nothing, _weigh)
"""weigh_mount(t.base, arms, i, run, q): B, A^-1 B of a carried arm, and its part of its carrier's load.

Of a carrier the load is first cleared; its own factors are there. Overwrites the motion of the base,
run.work.model and run.work.residual."""


@inner
def _close_nothing(e: BaseMotion, arms: ArmTables, like: Stepping) -> bool:
    return True


@inner
def _close(e: BaseMotion, arms: ArmTables, like: Stepping) -> bool:
    """Gain K = (I + C W)^-1 C of each carrier, with W = J A^-1 J' of its tip and the load C on it."""
    m = arms.mounts
    for i in range(arms.address.shape[0]):
        if not m.is_carrier[i]:
            continue
        run = view_at(like, arms.address[i])
        x, n = run.work.residual, arms.first_q[i + 1] - arms.first_q[i]
        J, Z, C = m.columns[i], m.answers[i], m.load[i]
        for c in range(6):
            for b in range(n):
                x[b] = J[b, c]
            solve_system(run.tables, run.work.system, x)
            for b in range(n):
                Z[b, c] = x[b]
        for c in range(6):
            for r in range(6):
                total = 0.0
                for b in range(n):
                    total += J[b, r] * Z[b, c]
                m.block[1, r, c] = total
        for r in range(6):
            for c in range(6):
                total = 1.0 if r == c else 0.0
                for k in range(6):
                    total += C[r, k] * m.block[1, k, c]
                m.block[0, r, c] = total
        if not lu_factor(m.block[0], m.pivots):
            return False
        lu_solve_rows(m.block[0], m.pivots, C)
    return True


close_carriers = select_by_type(FixedBase, _close_nothing, _close)
"""close_carriers(like.tables.base, arms, like): answers and gain of each; False: singular."""


@inner
def _solve_alone(e: BaseMotion, arms: ArmTables, like: Stepping, m: int, row: Array, wrench: Array) -> None:
    i = arms.first_arm[m]
    run = view_at(like, arms.address[i])
    solve_system(run.tables, run.work.system, row[: arms.first_q[i + 1] - arms.first_q[i]])


@inner
def _solve_tree(e: BaseMotion, arms: ArmTables, like: Stepping, m: int, row: Array, wrench: Array) -> None:
    t, h = arms.mounts, arms.first_arm[m]
    carrier = view_at(like, arms.address[h])
    n_h = arms.first_q[h + 1] - arms.first_q[h]
    tip, own, gain = t.scratch[_TIP], t.scratch[_OWN], t.scratch[_GAIN]
    clear(tip)
    for i in range(arms.address.shape[0]):
        if t.carrier[i] == h:
            run = view_at(like, arms.address[i])
            first, n = arms.column[i], arms.first_q[i + 1] - arms.first_q[i]
            solve_system(run.tables, run.work.system, row[first : first + n])
            for r in range(6):
                own[r] = wrench[i, r]
                for b in range(n):
                    own[r] += t.columns[i, b, r] * row[first + b]
            wrench_to_parent(t.offset_rotation[i], t.offset_place[i], own)
            for r in range(6):
                tip[r] += own[r]
    if t.is_carrier[h]:
        for b in range(n_h):
            row[b] -= dot6(t.columns[h, b], tip)
    solve_system(carrier.tables, carrier.work.system, row[:n_h])
    if not t.is_carrier[h]:
        return
    clear(tip)
    for b in range(n_h):
        for r in range(6):
            tip[r] += t.columns[h, b, r] * row[b]
    for r in range(6):
        gain[r] = dot6(t.load[h, r], tip)
    clear(tip)
    for b in range(n_h):
        row[b] -= dot6(t.answers[h, b], gain)
        for r in range(6):
            tip[r] += t.columns[h, b, r] * row[b]
    for i in range(arms.address.shape[0]):
        if t.carrier[i] == h:
            assign(tip, own)
            to_body(t.offset_rotation[i], t.offset_place[i], own)
            first = arms.column[i]
            for b in range(arms.first_q[i + 1] - arms.first_q[i]):
                row[first + b] -= dot6(t.answers[i, b], own)


solve_mover = select_by_type(FixedBase, _solve_alone, _solve_tree)
"""solve_mover(like.tables.base, arms, like, m, row, wrench): row <- A^-1 row of the arms of mover m.

wrench (n_a, 6): on the bases of carried arms, beside what their rows give. Behind `close_carriers`."""
