"""Workspace of the derivatives: arrays that they write into, made once and used again.

All twists and wrenches in it are seen from the frame of the arm's base. Rules as in `soro_core.model.work`.

====================================================  =================================================
written by                                            read by
====================================================  =================================================
`chain`: frame LINK, twists LINK_*, row n of          itself; `link` passes the frame and the twists on
wrench, inertia, turn and linear                      from link to link
`link`: frames, twists SECTION_*, node, pieces,       itself, within one step along a link
jet, stumpff, tangent, factor, rates
`link`: end, omega, coefficient, powers, columns,     `chain` and `curvature`, for the same link
force
`slice`: twists NODE_* to FORCE, change, slice_turn   itself; `link` reads motion and force of the node
`slice`: outer, wrench, inertia, turn, linear         `chain`
`slice`, `chain`, `curvature`: equation, each adds    whoever has asked for the derivatives
`curvature`: dual, phi, pairs, twist UNIT_BRACKET     itself
`equation`: block, gradient, actuation; equation      itself; whoever has asked
====================================================  =================================================
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core._jit import inner
from soro_core.arrays import Array, Integers
from soro_core.model.tables import Tables

# What a force is derived by: acceleration, coordinate, velocity. Rows of `equation`, `change` and `outer`.
BY_A, BY_Q, BY_V = 0, 1, 2
# Fourth row of `outer`.
TURNED = 3
# Rows of `twists`: twist and acceleration at the base of a link, at the start of a sub-interval, at a node;
# momentum and force of a node's slice; scratch.
LINK_TWIST, LINK_ACCELERATION, SECTION_TWIST, SECTION_ACCELERATION = 0, 1, 2, 3
NODE_TWIST, NODE_ACCELERATION, MOMENTUM, FORCE, UNIT_BRACKET = 4, 5, 6, 7, 8
N_TWISTS = 9
# Rows of `rotation` and `position`: base of a link, start of a sub-interval, section of a slice, exponential.
LINK, SECTION, SLICE, STEP = 0, 1, 2, 3
# Rows of `columns`.
START, UNIT, ADDED = 0, 1, 2


class DerivativeWork(NamedTuple):
    """Arrays for n links of at most m coordinates each.

    K steps along each link are kept, each with G columns: two for each strain of a varying link, else one for
    each coordinate.
    """

    group: Integers
    """Number of each coordinate's strain among those of its link, (n_q,)."""
    equation: Array
    """Derivatives of the force that the motion asks for by a, q and qd, (3, n_q, n_q)."""
    actuation: Array
    """H, (n_q, n_u)."""
    end: Array
    """Column of each coordinate at the end of its link, its first and second rate, (3, n_q, 6)."""
    outer: Array
    """Wrench of the coordinate's link and all beyond it, by its acceleration, itself and its velocity; and
    Q' of its column, docs/model.md (45). (4, n_q, 6)."""
    wrench: Array
    """Wrench that each link's own mass asks for, and of all beyond the present link, (n + 1, 6)."""
    inertia: Array
    """Inertia of each link as a rigid body, and of all beyond, (n + 1, 6, 6)."""
    turn: Array
    """Rotary block of its velocity matrix Q, docs/model.md (44): (n + 1, 3, 3)."""
    linear: Array
    """Its linear momentum, (n + 1, 3)."""
    change: Array
    """Change of a slice's wrench by one coordinate, (3, 6)."""
    slice_turn: Array
    """Rotary block of a slice's Q, (3, 3)."""
    rotation: Array
    """Rotations of poses in use, (4, 3, 3)."""
    position: Array
    twists: Array
    """Twists and wrenches in use, (N_TWISTS, 6)."""
    node: Array
    """Columns of a link's coordinates at a node and their rates, (3, m, 6)."""
    pieces: Array
    """Columns that a sub-interval adds, and their rates, (3, G, 6)."""
    jet: Array
    """Strain at the two points of a sub-interval, unit twist, summand; each with its rates: (4, 3, 6)."""
    stumpff: Array
    """c_0 ... c_9, (10,)."""
    tangent: Array
    """a_0 ... a_4, their first derivatives, their second, (15,)."""
    factor: Array
    """Their products with powers of the arc length, and rates, (3, 5)."""
    rates: Array
    """First and second rates of `powers` in one step, (2, 5, G, 6)."""
    omega: Array
    """Exponent of each step and its rates, (n, K, 3, 6)."""
    coefficient: Array
    """a_n and a_n' of each step; with powers of the length for a link of constant strain: (n, K, 2, 5)."""
    powers: Array
    """ad_Omega^n of each column, (n, K, 5, G, 6)."""
    columns: Array
    """Blocks of each step: columns of the coordinates at its start, unit twists of the strains, columns
    added; (n, K, 3, G, 6)."""
    force: Array
    """Wrench of the nodes before each step in the first row; for constant strain sums over all nodes, of
    coefficients times force: (n, K, 10, 6)."""
    dual: Array
    """(G, 6)."""
    phi: Array
    """(10, 6)."""
    pairs: Array
    """(G, G)."""
    block: Array
    """Stiffness, link by link: (n_q, m)."""
    gradient: Array
    """Column of H of one chamber, (n_q,)."""


@inner
def derivative_workspace(t: Tables) -> DerivativeWork:
    """Arrays for the robot of these tables."""
    n, n_q, m = t.length.shape[0], t.basis.shape[0], t.stiffness.shape[1]
    group = np.zeros(n_q, dtype=np.int64)
    strains, varies = 1, False
    for i in range(n):
        varies = varies or t.varying[i]
        for c in range(t.offset[i] + 1, t.offset[i + 1]):
            fresh = False
            for r in range(6):
                fresh = fresh or t.basis[c, r] != t.basis[c - 1, r]
            group[c] = group[c - 1] + (1 if fresh else 0)
            strains = max(strains, group[c] + 1)
    steps = t.fraction.shape[0] if varies else 1
    most = max(m, 2 * strains) if varies else m
    return DerivativeWork(
        group,
        np.zeros((3, n_q, n_q)),  # equation
        np.zeros((n_q, t.axial_gain.shape[1])),  # actuation
        np.zeros((3, n_q, 6)),  # end
        np.zeros((4, n_q, 6)),  # outer
        np.zeros((n + 1, 6)),  # wrench
        np.zeros((n + 1, 6, 6)),  # inertia
        np.zeros((n + 1, 3, 3)),  # turn
        np.zeros((n + 1, 3)),  # linear
        np.zeros((3, 6)),  # change
        np.zeros((3, 3)),  # slice_turn
        np.zeros((4, 3, 3)),  # rotation
        np.zeros((4, 3)),  # position
        np.zeros((N_TWISTS, 6)),  # twists
        np.zeros((3, m, 6)),  # node
        np.zeros((3, most, 6)),  # pieces
        np.zeros((4, 3, 6)),  # jet
        np.zeros(10),  # stumpff
        np.zeros(15),  # tangent
        np.zeros((3, 5)),  # factor
        np.zeros((2, 5, most, 6)),  # rates
        np.zeros((n, steps, 3, 6)),  # omega
        np.zeros((n, steps, 2, 5)),  # coefficient
        np.zeros((n, steps, 5, most, 6)),  # powers
        np.zeros((n, steps, 3, most, 6)),  # columns
        np.zeros((n, steps, 10, 6)),  # force
        np.zeros((most, 6)),  # dual
        np.zeros((10, 6)),  # phi
        np.zeros((most, most)),  # pairs
        np.zeros((n_q, m)),  # block
        np.zeros(n_q),  # gradient
    )
