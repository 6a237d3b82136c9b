"""Workspace of the kernels: arrays that a computation writes into, made once and used again.

An allocation costs a tenth of a link's dynamics. A workspace belongs to one thread at a time.

Who owns what. A kernel writes its own arrays and rows, and calls others that write theirs; no array or row
has two owners that can be at work at the same time.

====================================================  =================================================
written by                                            read by
====================================================  =================================================
`sweep`: node, powers, chain, stumpff, tangent,       itself, while it passes along one link
frame NODE, vectors BASE_TWIST ... RELATIVE_TWIST
`sweep`: end_rotation, end_position, end_columns,     whatever follows on the same state: `close_forces`,
own, inertia, coupling, mass                          `factor`, `inertia`, `energy`, `external`
`magnus_step`: chain, stumpff, tangent, frame STEP,   itself; its callers (`sweep`, `place`) take their
vectors STRAIN_1 ... SHAPED_2                         own state as arguments
`place`: powers, stumpff, tangent, vectors STRAIN     itself, between two passes of `sweep`
and COLUMN_RATE
`close_forces`, `solve`: vectors CLOSING_WRENCH,      themselves
JOINT_WRENCH, JOINT_ACCELERATION
`factor`: beyond, rotated, gain, force, and mass,     `solve`, until the next `sweep`
which it turns into the factors of the joints
`inertia`: beyond, rotated, columns, vector           itself
BODY_MOMENTUM
`energy`: frame BODY, vectors BASE_TWIST,             itself
BASE_ACCELERATION
`link_ends`: frame BODY, columns                      itself
`tip_mass_force`: vector CLOSING_WRENCH               itself
`kinematics`: node, frame NODE                        itself
`external`: site_*, points; it adds to own, mass,     `close_forces`, `factor`; the caller gets site_force
coupling and fills extra
`dynamics`: applied; `acceleration`: bias             themselves
system of a stepper: block, gradient                  `factor`
method `mde`: mde_*, pivots, columns                  itself
====================================================  =================================================

`zero` is the argument for "no velocity", "no acceleration" and "no wrench". Nothing writes it: kernels that
take it read it only, and a value left in it would be a motion that the caller did not ask for
(tests/soro_core/model/test_model_scratch.py).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core._jit import inner
from soro_core.arrays import Array, Integers
from soro_core.model.tables import Tables

# Rows of `Work.vectors`. Of `sweep`: true, reference and acceleration twist of a link's base and of a node.
BASE_TWIST, BASE_REFERENCE, BASE_ACCELERATION = 0, 1, 2
NODE_TWIST, NODE_REFERENCE, NODE_ACCELERATION = 3, 4, 5
MOMENTUM, FORCE, STRAIN, STRAIN_RATE, COLUMN_RATE, RELATIVE_TWIST = 6, 7, 8, 9, 10, 11
# Of `magnus_step`: at the two Gauss points the strains, their rates along qd and v; the exponent Omega.
STRAIN_1, STRAIN_2, RATE_1, RATE_2, REFERENCE_1, REFERENCE_2 = 12, 13, 14, 15, 16, 17
EXPONENT, EXPONENT_RATE, EXPONENT_BY_V, EXPONENT_BY_V_RATE = 18, 19, 20, 21
SUMMAND, SUMMAND_BY_V, STEP_TWIST, SHAPED_1, SHAPED_2 = 22, 23, 24, 25, 26
# Of the chain of links.
CLOSING_WRENCH, JOINT_WRENCH, JOINT_ACCELERATION, BODY_MOMENTUM = 27, 28, 29, 30
N_VECTORS = 31
# Rows of `Work.frame_rotation` and `Work.frame_position`.
NODE, STEP, BODY = 0, 1, 2
# Rows of `Work.site_rotation` and `Work.site_position`: base of the link in the world; in that base the end
# of the last sub-interval before a place, and the place.
LINK_BASE, WALKED, SITE = 0, 1, 2
# Rows of `Work.site_vectors`.
LINK_TWIST, SITE_TWIST, SITE_WRENCH, UNIT_TWIST, UNIT_WRENCH = 0, 1, 2, 3, 4
# Rows of `Work.site_columns`.
WALKED_COLUMNS, SITE_COLUMNS = 0, 1
# Rows of `Work.points`.
POSITION, VELOCITY, NORMAL, TOUCH, POINT_FORCE = 0, 1, 2, 3, 4


class Work(NamedTuple):
    """Arrays for n links of at most m coordinates each."""

    zero: Array
    """(n_q,), never written."""
    node: Array
    """B1 at the present node, one column a row, (m, 6)."""
    powers: Array
    """ad_xi^k of each column of B, (5, m, 6)."""
    chain: Array
    """ad_xi^k of B v and its rates, (2, 5, 6)."""
    stumpff: Array
    """c_0 ... c_7, (8,)."""
    tangent: Array
    """Coefficients of the tangent of exp, and their derivatives, (10,)."""
    vectors: Array
    """Twists and wrenches, (N_VECTORS, 6)."""
    frame_rotation: Array
    """Rotations of poses in use, (3, 3, 3)."""
    frame_position: Array
    end_rotation: Array
    """Rotation of the end of each link in its base, (n, 3, 3)."""
    end_position: Array
    end_columns: Array
    """B1 at the end of each link, (n, m, 6)."""
    own: Array
    """Wrench of each link's own mass about its base, (n, 6)."""
    inertia: Array
    """Inertia of each link as a rigid body about its base, (n, 6, 6)."""
    coupling: Array
    """Momentum of each link by its coordinates, int N B1, (n, m, 6)."""
    mass: Array
    """Inertia matrix of each link by itself, (n, m, m), lower triangle; then the factors of the joint."""
    gain: Array
    """D^-1 U of each joint, (n, m, 6)."""
    force: Array
    """U of each joint, (n, m, 6)."""
    beyond: Array
    """Inertia of what lies beyond a link, (6, 6)."""
    rotated: Array
    """A block of it, (6, 6)."""
    block: Array
    """Added to the inertia matrix, link by link: (n_q, m)."""
    gradient: Array
    """Column of H of one chamber, (n_q,)."""
    columns: Array
    """Columns of all coordinates, (n_q, 6)."""
    bias: Array
    """Generalised force of C qd, G and what acts from outside, (n_q,)."""
    applied: Array
    """Generalised force of pressures, elasticity and losses, (n_q,)."""
    mde_inertia: Array
    """Inertia matrix of the method `mde`, (n_q, n_q); empty for `exact`."""
    mde_coriolis: Array
    mde_system: Array
    pivots: Integers
    extra: Array
    """Tangents of what acts from outside, as bodies about the links' bases: (n, 6, 6), empty without."""
    site_force: Array
    """Force at each place where something acts, in the world, (n_places, 3)."""
    site_rotation: Array
    """Rotations of poses from place to place, (3, 3, 3)."""
    site_position: Array
    site_stiffness: Array
    """Tangent of the force at a place, in the world, (3, 3)."""
    site_vectors: Array
    """Twists and wrenches there, (5, 6)."""
    site_columns: Array
    """B1 there, (2, m, 6)."""
    points: Array
    """Positions, velocities and forces there, (5, 3)."""


class Arm(NamedTuple):
    """Parameters of an arm and workspace, for the kernels."""

    tables: Tables
    work: Work


@inner
def workspace(t: Tables, n_mde: int) -> Work:
    """Arrays for the robot of these tables; with `n_mde` rows of the matrices of the method `mde`."""
    n = t.length.shape[0]
    n_q = t.basis.shape[0]
    m = t.stiffness.shape[1]
    n_places = t.external.kind.shape[0]
    n_extra = n if n_places > 0 else 0
    return Work(
        np.zeros(n_q),  # zero
        np.zeros((m, 6)),  # node
        np.zeros((5, m, 6)),  # powers
        np.zeros((2, 5, 6)),  # chain
        np.zeros(8),  # stumpff
        np.zeros(10),  # tangent
        np.zeros((N_VECTORS, 6)),  # vectors
        np.zeros((3, 3, 3)),  # frame_rotation
        np.zeros((3, 3)),  # frame_position
        np.zeros((n, 3, 3)),  # end_rotation
        np.zeros((n, 3)),  # end_position
        np.zeros((n, m, 6)),  # end_columns
        np.zeros((n, 6)),  # own
        np.zeros((n, 6, 6)),  # inertia
        np.zeros((n, m, 6)),  # coupling
        np.zeros((n, m, m)),  # mass
        np.zeros((n, m, 6)),  # gain
        np.zeros((n, m, 6)),  # force
        np.zeros((6, 6)),  # beyond
        np.zeros((6, 6)),  # rotated
        np.zeros((n_q, m)),  # block
        np.zeros(n_q),  # gradient
        np.zeros((n_q, 6)),  # columns
        np.zeros(n_q),  # bias
        np.zeros(n_q),  # applied
        np.zeros((n_mde, n_mde)),  # mde_inertia
        np.zeros((n_mde, n_mde)),  # mde_coriolis
        np.zeros((n_mde, n_mde)),  # mde_system
        np.zeros(n_q, dtype=np.int64),  # pivots
        np.zeros((n_extra, 6, 6)),  # extra
        np.zeros((n_places, 3)),  # site_force
        np.zeros((3, 3, 3)),  # site_rotation
        np.zeros((3, 3)),  # site_position
        np.zeros((3, 3)),  # site_stiffness
        np.zeros((5, 6)),  # site_vectors
        np.zeros((2, m, 6)),  # site_columns
        np.zeros((5, 3)),  # points
    )


@inner
def mde_workspace(t: Tables) -> Work:
    """Workspace of the method `mde`, which computes with matrices of all coordinates."""
    return workspace(t, t.basis.shape[0])


@inner
def exact_workspace(t: Tables) -> Work:
    """Workspace of the method `exact`, which needs no matrix of all coordinates."""
    return workspace(t, 0)
