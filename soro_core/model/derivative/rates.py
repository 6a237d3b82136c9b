"""Twists with their first and second rates along a motion: what the derivatives of the dynamics are made of.

docs/model.md (40), (41). All are seen from one fixed frame, that of the arm's base, so a rate contains how
the section turns: the twist Ad_g x of a section with the twist V and the acceleration A has the rates
Ad_g x' + ad_V Ad_g x and so on (`carry`). The columns of the tangent T(Omega) X = sum_n a_n ad_Omega^n X
follow by the product rule (`bracket`, `combine`), with a_n(y) and its two derivatives from the Stumpff
functions (`coefficients`).
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.lie import ad, add_ad, series, stumpff, tangent_coefficients, to_parent

# Coefficients (-1)^n k! / (2 n + k)! of the series of k! c_k for k = 8 and 9, to 1e-16 for y < 4.
_C8 = tuple((-1) ** n * math.factorial(8) / math.factorial(2 * n + 8) for n in range(12))
_C9 = tuple((-1) ** n * math.factorial(9) / math.factorial(2 * n + 9) for n in range(12))


@inner
def coefficients(y: float, c: Array, a: Array) -> None:
    """c (10,) <- Stumpff functions c_0 ... c_9 of y >= 0; a (15,) <- a_0 ... a_4, their first derivatives by
    y, and their second.

    Two more Stumpff functions than `lie.stumpff` gives; dc_k/dy = -(c_(k+1) - k c_(k+2)) / 2, twice.
    """
    stumpff(y, c)
    tangent_coefficients(c, a)
    if y < 4.0:
        c[8] = series(y, _C8) / 40320.0
        c[9] = series(y, _C9) / 362880.0
    else:
        c[8] = (1.0 / 720.0 - c[6]) / y
        c[9] = (1.0 / 5040.0 - c[7]) / y
    e1 = 0.25 * (c[3] - 3.0 * c[4] + 3.0 * c[5])
    e2 = 0.25 * (c[4] - 5.0 * c[5] + 8.0 * c[6])
    e3 = 0.25 * (c[5] - 7.0 * c[6] + 15.0 * c[7])
    e4 = 0.25 * (c[6] - 9.0 * c[7] + 24.0 * c[8])
    e5 = 0.25 * (c[7] - 11.0 * c[8] + 35.0 * c[9])
    a[10] = 0.0
    a[11] = 2.0 * e2 - 0.5 * e1
    a[12] = 0.5 * (5.0 * e3 - e2)
    a[13] = 0.5 * e3 - e4
    a[14] = 0.5 * (e4 - 3.0 * e5)


@inner
def carry(R: Array, p: Array, V: Array, A: Array, twist: Array) -> None:
    """twist (3, 6) <- the twist of the section g = (R, p) and its rates, seen from the fixed frame.

    V and A are twist and acceleration of the section, seen from there too.
    """
    x, xd, xdd = twist[0], twist[1], twist[2]
    to_parent(R, p, x)
    to_parent(R, p, xd)
    to_parent(R, p, xdd)
    add_ad(A, x, 1.0, xdd)
    add_ad(V, xd, 1.0, xdd)
    add_ad(V, x, 1.0, xd)
    add_ad(V, xd, 1.0, xdd)


@inner
def add_bracket(x: Array, y: Array, factor: float, out: Array) -> None:
    """out += factor * ad_x y with its rates; x, y, out (3, 6)."""
    add_ad(x[0], y[0], factor, out[0])
    add_ad(x[1], y[0], factor, out[1])
    add_ad(x[0], y[1], factor, out[1])
    add_ad(x[2], y[0], factor, out[2])
    add_ad(x[1], y[1], 2.0 * factor, out[2])
    add_ad(x[0], y[2], factor, out[2])


@inner
def bracket(count: int, omega: Array, powers: Array, rates: Array) -> None:
    """powers[n], rates[0, n], rates[1, n] <- ad_Omega^n X and its rates, from those of n = 0.

    `omega` (3, 6): Omega and its rates; `powers` (5, count, 6), `rates` (2, 5, count, 6).
    """
    for n in range(4):
        for j in range(count):
            x, xd, xdd = powers[n, j], rates[0, n, j], rates[1, n, j]
            y, yd, ydd = powers[n + 1, j], rates[0, n + 1, j], rates[1, n + 1, j]
            ad(omega[0], x, y)
            ad(omega[1], x, yd)
            add_ad(omega[0], xd, 1.0, yd)
            ad(omega[2], x, ydd)
            add_ad(omega[1], xd, 2.0, ydd)
            add_ad(omega[0], xdd, 1.0, ydd)


@inner
def along(s: float, rate: float, rate2: float, a: Array, k: Array) -> None:
    """k (3, 5) <- s^(n+1) a_n(s^2 y) and its rates, where y has the rates `rate` and `rate2`."""
    y1, y2 = rate * s * s, rate2 * s * s
    power = s
    for n in range(5):
        k[0, n] = power * a[n]
        k[1, n] = power * a[5 + n] * y1
        k[2, n] = power * (a[10 + n] * y1 * y1 + a[5 + n] * y2)
        power *= s


@inner
def _sum(k: Array, order: int, first: int, P: Array, j: int, r: int) -> float:
    """Return sum_n k_n ad_Omega^n X from n = `first` on, one entry; the coefficient of n = 0 has no rates."""
    value: float = k[order, first] * P[first, j, r]
    for n in range(first + 1, 5):
        value += k[order, n] * P[n, j, r]
    return value


@inner
def combine(count: int, k: Array, powers: Array, rates: Array, columns: Array) -> None:
    """columns (3, count, 6) <- sum_n k_n ad_Omega^n X and its rates."""
    D, DD = rates[0], rates[1]
    for j in range(count):
        for r in range(6):
            x = _sum(k, 0, 0, powers, j, r)
            xd = _sum(k, 0, 0, D, j, r) + _sum(k, 1, 1, powers, j, r)
            xdd = _sum(k, 0, 0, DD, j, r) + 2.0 * _sum(k, 1, 1, D, j, r) + _sum(k, 2, 1, powers, j, r)
            columns[0, j, r], columns[1, j, r], columns[2, j, r] = x, xd, xdd


@inner
def begin(V: Array, A: Array, X: Array, Xd: Array, Xdd: Array) -> None:
    """Xd, Xdd <- rates of a twist X that is fixed in the section of twist V and acceleration A."""
    ad(V, X, Xd)
    ad(A, X, Xdd)
    add_ad(V, Xd, 1.0, Xdd)
