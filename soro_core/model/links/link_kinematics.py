"""A place on a link: its pose and its columns B1, seen from the frame of the link's base."""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.lie import exponential, stumpff, tangent_coefficients
from soro_core.model.links.linear import clear, clear_matrix
from soro_core.model.links.link import ad_powers, columns_at, strain_twist
from soro_core.model.links.magnus import magnus_step
from soro_core.model.records import CrossSection, Motion, SubInterval
from soro_core.model.tables import Tables
from soro_core.model.work import STRAIN, Work


@inner
def along_constant(t: Tables, w: Work, i: int, s: float, q: Array, at: CrossSection) -> None:
    """at <- the section `s` metres along link i, of constant strain."""
    xi, c, a = w.vectors[STRAIN], w.stumpff, w.tangent
    strain_twist(t, i, q, xi)
    ad_powers(t, i, xi, w.powers)
    stumpff((xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2]) * s * s, c)
    tangent_coefficients(c, a)
    columns_at(t.offset[i + 1] - t.offset[i], s, a, w.powers, at.columns)
    exponential(xi, s, c, at.R, at.p)


@inner
def begin_varying(at: CrossSection) -> None:
    """at <- the base of a link."""
    R, p, B1 = at
    clear_matrix(B1)
    clear_matrix(R)
    clear(p)
    R[0, 0] = R[1, 1] = R[2, 2] = 1.0


@inner
def whole_step(t: Tables, i: int, k: int) -> SubInterval:
    """Return sub-interval k of link i."""
    return SubInterval(t.fraction[k] * t.length[i], t.shape[k], t.reference[k, i])


@inner
def step_varying(t: Tables, w: Work, i: int, step: SubInterval, q: Array, at: CrossSection) -> None:
    """Advance a section of link i, of varying strain, over a sub-interval."""
    magnus_step(t, w, i, step, Motion(q, w.zero, w.zero, w.zero), at)
