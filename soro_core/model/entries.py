"""Entry points of the model from Python: short compiled functions that take an arm in its box."""

from __future__ import annotations

import math

import numpy as np

from soro_core._box import Box, view
from soro_core._jit import entry, kernel
from soro_core.arrays import Array
from soro_core.model import dynamics
from soro_core.model.forces import chambers, elasticity, internal
from soro_core.model.links.linear import assign, clear
from soro_core.model.method import (
    energy,
    external_force,
    inertia,
    inertial_force,
    kinematics,
    make_work,
    tip_mass_force,
)
from soro_core.model.records import ArmState, CrossSection, Masses, Motion
from soro_core.model.tables import Site, Tables
from soro_core.model.work import Arm


@kernel
def make_box(t: Tables) -> Box:
    """Tables and a workspace of their own."""
    return Box(Arm(t, make_work(t)))


@entry
def check(box: Box, q: Array, qd: Array) -> int:
    """`dynamics.check`."""
    return dynamics.check(view(box).tables, q, qd)


@entry
def finite(x: Array) -> bool:
    """True where all entries are numbers."""
    return dynamics.finite(x)


@entry
def inertia_matrix(box: Box, q: Array, M: Array) -> None:
    """M <- inertia matrix (n_q, n_q)."""
    arm = view(box)
    t = arm.tables
    inertia(t, arm.work, t.mass, t.tip_mass[0], q, M)


@entry
def inertial_forces(
    box: Box,
    masses: tuple[Array, Array, Array],
    motion: tuple[Array, Array, Array, Array],
    forces: Array,
) -> None:
    """forces[k] <- M a[k] + C(q, qd) v[k] + G with the masses of row k; all of shape (n_k, ...).

    `masses` of links (n_k, n) and tip (n_k,), and gravity (3,); `motion`: q, qd (n_q,), v and a.

    One entry for everything linear: C by unit velocities without gravity, regressors by unit masses.
    """
    arm = view(box)
    none = np.zeros(6)
    of_links, of_tip, gravity = masses
    q, qd, v, a = motion
    for k in range(forces.shape[0]):
        row = Masses(of_links[k], of_tip[k], gravity)
        inertial_force(arm.tables, arm.work, row, none, Motion(q, qd, v[k], a[k]), forces[k])


@entry
def motion_forces(
    box: Box, motion: tuple[Array, Array, Array], own: Array, by_mass: Array, gradients: Array
) -> None:
    """own <- M a + C qd + G + dU_e/dq + R qd, by_mass <- force per kg at the tip, gradients <- H'.

    `motion`: q, qd and a, (n_q,).
    """
    arm = view(box)
    t = arm.tables
    q, qd, a = motion
    dynamics.motion_forces(t, arm.work, t.tip_mass[0], Motion(q, qd, qd, a), own, gradients)
    dynamics.add_damping_force(t, qd, own)
    tip_mass_force(t, arm.work, q, qd, a, by_mass)


@entry
def acting(box: Box, pressure: Array, acting: Array) -> int:
    """acting <- the effective pressures; gives a chamber whose area has no bound there, else -1."""
    t = view(box).tables
    for u in range(pressure.shape[0]):
        acting[u] = chambers.acting(t, u, pressure[u])
        if not math.isfinite(acting[u]):
            return u
    return -1


@entry
def external_forces(box: Box, q: Array, qd: Array, wrench: Array, tau: Array, force: Array) -> float:
    """tau <- generalised force, force <- that at each place (n_places, 3); gives the energy stored [J]."""
    arm = view(box)
    energy = external_force(arm.tables, arm.work, wrench, q, qd, tau)
    for k in range(force.shape[0]):
        assign(arm.work.site_force[k], force[k])
    return energy


@entry
def pose_and_jacobian(box: Box, site: Site, q: Array, R: Array, p: Array, J: Array) -> None:
    """Pose (R, p) in the world and body Jacobian, transposed (n_q, 6)."""
    arm = view(box)
    kinematics(arm.tables, arm.work, site, q, CrossSection(R, p, J))


@entry
def sections(box: Box, site: Site, q: Array, poses: Array) -> None:
    """Poses (n, 4, 4) in the world of one section at coordinates (n, n_q)."""
    arm = view(box)
    R, p, J = np.empty((3, 3)), np.empty(3), np.empty((q.shape[1], 6))
    for k in range(q.shape[0]):
        kinematics(arm.tables, arm.work, site, q[k], CrossSection(R, p, J))
        poses[k, :3, :3], poses[k, :3, 3], poses[k, 3, :3], poses[k, 3, 3] = R, p, 0.0, 1.0


@entry
def mechanical_energy(box: Box, q: Array, qd: Array) -> tuple[float, float]:
    """Kinetic energy and U_g [J], the latter zero at the world's origin."""
    arm = view(box)
    return energy(arm.tables, arm.work, q, qd)


@entry
def accelerations(
    box: Box, states: tuple[Array, Array, Array], pressure: Array, wrench: Array, qdd: Array
) -> int:
    """`dynamics.forward_dynamics` of one state (q, qd, z) or of several, behind each other in each array.

    Ends at the first state that is not GOOD, with its code.
    """
    arm = view(box)
    t, w = arm.tables, arm.work
    q, qd, z = states
    n_q, n_z, n_u = t.basis.shape[0], t.internal_kind.shape[0], t.axial_gain.shape[1]
    if q.shape[0] == n_q:
        # Parts of arrays cost one state 3 %.
        return dynamics.forward_dynamics(t, w, ArmState(q, qd, z), pressure, wrench, qdd)
    for k in range(q.shape[0] // n_q):
        b, behind = k * n_q, (k + 1) * n_q
        pk = pressure[k * n_u : (k + 1) * n_u]
        one = ArmState(q[b:behind], qd[b:behind], z[k * n_z : (k + 1) * n_z])
        code = dynamics.forward_dynamics(t, w, one, pk, wrench, qdd[b:behind])
        if code != dynamics.GOOD:
            return code
    return dynamics.GOOD


@entry
def damping_force(box: Box, qd: Array, force: Array) -> None:
    """force <- R qd."""
    clear(force)
    dynamics.add_damping_force(view(box).tables, qd, force)


@entry
def elastic_force(box: Box, q: Array, force: Array) -> None:
    """force <- dU_e/dq (n_q,)."""
    elasticity.elastic_force(view(box).tables, q, force)


@entry
def elastic_energy(box: Box, q: Array) -> float:
    """U_e [J]."""
    return elasticity.elastic_energy(view(box).tables, q)


@entry
def add_stiffness(box: Box, q: Array, K: Array) -> None:
    """K += d2U_e/dq2, the block of each link: row of a coordinate, (n_q, width)."""
    elasticity.add_stiffness(view(box).tables, q, 1.0, K)


@entry
def elastic_regressor(box: Box, q: Array, Y: Array) -> None:
    """Y <- dU_e/dq per (a1, a2, a4, a5) of each link, (n_q, 4 n)."""
    elasticity.elastic_regressor(view(box).tables, q, Y)


@entry
def actuation(box: Box, q: Array, gradients: Array) -> None:
    """gradients <- H', generalised force per pressure, a row each chamber (n, n_u, n_q), at q (n, n_q)."""
    for k in range(q.shape[0]):
        chambers.actuation(view(box).tables, q[k], gradients[k])


@entry
def displaced_volumes(box: Box, q: Array, volume: Array) -> None:
    """volume <- what each chamber displaces beyond its volume at q = 0 [m^3], (n_u,)."""
    chambers.volumes(view(box).tables, q, volume)


@entry
def add_internal_force(box: Box, z: Array, force: Array) -> None:
    """force += generalised force of the internal states on the left-hand side."""
    internal.add_internal_force(view(box).tables, z, force)


@entry
def internal_rate(box: Box, qd: Array, z: Array, rate: Array) -> None:
    """rate <- dz/dt."""
    internal.internal_rate(view(box).tables, qd, z, rate)


@entry
def internal_midpoint(box: Box, qd: Array, z: Array, dt: float, half: Array, new: Array) -> None:
    """new <- the internal states after dt at held rates, by the midpoint rule; `half` is those at dt / 2.

    A state that would not be finite keeps its value.
    """
    t = view(box).tables
    internal.internal_rate(t, qd, z, new)
    for j in range(z.shape[0]):
        half[j] = z[j] + 0.5 * dt * new[j]
    internal.internal_rate(t, qd, half, new)
    for j in range(z.shape[0]):
        new[j] = z[j] + dt * new[j]
        if not math.isfinite(new[j]):
            new[j] = z[j]
