"""Contacts of arms: with bodies, with each other, and of an arm with itself.

A piece of an arm runs between two sections, as the cubic through their places and directions, with their
radius: the contact is at its nearest place, not at a section, so that it does not depend on their number.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.bodies.stepping.contacts import (
    arm_side,
    body_side,
    is_joined,
    keep_contact,
    open_contact,
)
from soro_core.bodies.stepping.near import distance, nearest_part, nearest_parts
from soro_core.bodies.stepping.pairs import FEATURES
from soro_core.bodies.stepping.records import HERE, MOST_CONTACTS, OUT, ArmTables, WorldTables
from soro_core.bodies.stepping.vectors import dot, subtract


@inner
def _set_piece(arms: ArmTables, s: int) -> None:
    """Curve of the piece that begins at section s, its middle, and how far it reaches from there."""
    piece, chord = arms.piece[s], arms.middle[s]
    subtract(arms.p[s + 1], arms.p[s], chord)
    length = math.sqrt(dot(chord, chord))
    for r in range(3):
        piece[0, r], piece[1, r] = arms.p[s, r], arms.p[s + 1, r]
        piece[2, r], piece[3, r] = length * arms.R[s, r, 2], length * arms.R[s + 1, r, 2]
        arms.middle[s, r] = 0.5 * (arms.p[s, r] + arms.p[s + 1, r])
    arms.half[s] = 0.6 * length + max(arms.radius[s], arms.radius[s + 1])


@inner
def find_arm_contacts(arms: ArmTables, w: WorldTables, h: float, margin: float, among_arms: float) -> bool:
    """Find those of arms, by the margins to bodies and among arms; False if more than `MOST_CONTACTS`."""
    for i in range(arms.address.shape[0]):
        for s in range(arms.first_site[i], arms.first_site[i + 1] - 1):
            _set_piece(arms, s)
            for b in range(w.bodies.kind.shape[0]):
                if not is_joined(arms, i, b) and not _touch_body(arms, w, (i, s), b, h, margin):
                    return False
            for j in range(i + 1 if arms.touch_arms else 0):
                if arms.mounts.carrier[i] == j:
                    continue
                for t in range(arms.first_site[j], min(arms.first_site[j + 1] - 1, s)):
                    if not _touch_piece(arms, w, (i, s), (j, t), h, among_arms):
                        return False
    return True


@inner
def _touch_body(
    arms: ArmTables, w: WorldTables, one: tuple[int, int], b: int, h: float, margin: float
) -> bool:
    """Contact of the piece `one`, (arm, section), with body b; False if there is no room."""
    i, s = one
    n_b = w.bodies.kind.shape[0]
    if distance(w, b, arms.middle[s]) > arms.half[s] + margin:
        return True
    taper = arms.radius[s + 1] - arms.radius[s]
    part = nearest_part(w, b, arms.piece[s], taper)
    radius = arms.radius[s] + part * taper
    gap = distance(w, b, w.points[HERE]) - radius
    if gap > margin:
        return True
    k, c = w.contacts, open_contact(w, ((n_b + s) * n_b + b) * FEATURES, radius, gap)
    if c == MOST_CONTACTS:
        return False
    k.part[c, 0] = part
    arm_side(w, arms, c, 0, i, s)
    body_side(w, c, 1, b)
    k.friction[c], k.restitution[c] = w.bodies.friction[b], w.bodies.restitution[b]
    keep_contact(w, c, h)
    return True


@inner
def _touch_piece(
    arms: ArmTables, w: WorldTables, one: tuple[int, int], other: tuple[int, int], h: float, margin: float
) -> bool:
    """Contact of two pieces, (arm, section) each; False if there is no room.

    Pieces of one arm are neighbours up to an arc of pi times the radius: even where its skin meets itself on
    the inner side of the bend, such pieces touch only by that bend.
    """
    (i, s), (j, t) = one, other
    radii, out = arms.radius, w.points[OUT]
    subtract(arms.middle[s], arms.middle[t], out)
    if dot(out, out) > (arms.half[s] + arms.half[t] + margin) ** 2:
        return True
    if i == j and arms.arc[s] - arms.arc[t + 1] < math.pi * max(radii[s], radii[t]):
        return True
    tapers = (radii[s + 1] - radii[s], radii[t + 1] - radii[t])
    parts = nearest_parts(w, arms.piece[s], arms.piece[t], tapers)
    apart = math.sqrt(dot(out, out))
    radius = radii[s] + parts[0] * tapers[0]
    gap = apart - radius - radii[t] - parts[1] * tapers[1]
    if gap > margin:
        return True
    for r in range(3):
        # Axes that cross have no direction between them: that of a section.
        out[r] = out[r] / apart if apart > 0.0 else arms.R[s, r, 0]
    n_b = w.bodies.kind.shape[0]
    n_s = arms.radius.shape[0]
    k, c = w.contacts, open_contact(w, ((n_b + n_s) * n_b + s * n_s + t) * FEATURES, radius, gap)
    if c == MOST_CONTACTS:
        return False
    k.part[c, 0], k.part[c, 1] = parts
    arm_side(w, arms, c, 0, i, s)
    arm_side(w, arms, c, 1, j, t)
    k.friction[c], k.restitution[c] = arms.friction, 0.0
    keep_contact(w, c, h)
    return True
