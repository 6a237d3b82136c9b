"""A place on a link: its pose and its columns B1, seen from the frame of the link's base."""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.lie import exponential, stumpff, tangent_coefficients
from soro_core.model.links.linear import clear, clear_matrix
from soro_core.model.links.link import ad_powers, columns_at, strain_twist
from soro_core.model.links.magnus import magnus_step
from soro_core.model.tables import Tables
from soro_core.model.work import COLUMN_RATE, STRAIN, Work


@inner
def along_constant(t: Tables, w: Work, i: int, s: float, q: Array, R: Array, p: Array, B1: Array) -> None:
    """R, p, B1 <- those `s` metres along link i, of constant strain."""
    xi, c, a = w.vectors[STRAIN], w.stumpff, w.tangent
    strain_twist(t, i, q, xi)
    ad_powers(t, i, xi, w.powers)
    stumpff((xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2]) * s * s, c)
    tangent_coefficients(c, a)
    columns_at(t.offset[i + 1] - t.offset[i], s, a, w.powers, B1)
    exponential(xi, s, c, R, p)


@inner
def begin_varying(R: Array, p: Array, B1: Array) -> None:
    """R, p, B1 <- those at the base of a link."""
    clear_matrix(B1)
    clear_matrix(R)
    clear(p)
    R[0, 0] = R[1, 1] = R[2, 2] = 1.0


@inner
def along_varying(
    t: Tables, w: Work, i: int, begin: int, end: int, q: Array, R: Array, p: Array, B1: Array
) -> None:
    """Advance R, p, B1 over sub-intervals of link i, of varying strain."""
    for k in range(begin, end):
        step_varying(t, w, i, t.fraction[k] * t.length[i], t.shape[k], q, R, p, B1)


@inner
def step_varying(
    t: Tables, w: Work, i: int, h: float, shape: Array, q: Array, R: Array, p: Array, B1: Array
) -> None:
    """Advance R, p, B1 over h metres with the given shape functions (n_q, 2)."""
    magnus_step(t, w, i, h, shape, q, w.zero, w.zero, R, p, B1, w.vectors[COLUMN_RATE])
