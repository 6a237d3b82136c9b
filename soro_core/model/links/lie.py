"""SE(3) in closed form: exponential and its tangent, smooth through zero curvature.

docs/model.md (6), (7). All functions are written with the Stumpff functions [S59] c_k(y) = sum_n (-y)^n /
(2n + k)!, y = (s |omega|)^2, which are entire in y: no division by the curvature, no branch that the
derivative could see. Twists are (angular, linear).
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array

# Coefficients (-1)^n k! / (2 n + k)! of the series of k! c_k for k = 6 and 7, to 1e-16 for y < 4.
_C6 = tuple((-1) ** n * 720.0 / math.factorial(2 * n + 6) for n in range(12))
_C7 = tuple((-1) ** n * 5040.0 / math.factorial(2 * n + 7) for n in range(12))


@inner
def series(y: float, terms: tuple[float, ...]) -> float:
    """Return sum_n terms[n] y^n of twelve terms."""
    # Two shorter chains of products, in z = y^2, which the processor runs side by side.
    z = y * y
    even, odd = terms[10], terms[11]
    for n in range(8, -1, -2):
        even = even * z + terms[n]
        odd = odd * z + terms[n + 1]
    return even + y * odd


@inner
def stumpff(y: float, c: Array) -> None:
    """Write c_0 ... c_7 of y >= 0 into `c` (8,).

    Below y = 4 the two highest come from their series and the others by c_k = 1/k! - y c_(k+2), which does
    not cancel there; above, cosine and sine start the same recursion upwards.
    """
    if y < 4.0:
        c[6] = series(y, _C6) / 720.0
        c[7] = series(y, _C7) / 5040.0
        c[5] = 1.0 / 120.0 - y * c[7]
        c[4] = 1.0 / 24.0 - y * c[6]
        c[3] = 1.0 / 6.0 - y * c[5]
        c[2] = 0.5 - y * c[4]
        c[1] = 1.0 - y * c[3]
        c[0] = 1.0 - y * c[2]
    else:
        angle = math.sqrt(y)
        c[0] = math.cos(angle)
        c[1] = math.sin(angle) / angle
        c[2] = (1.0 - c[0]) / y
        c[3] = (1.0 - c[1]) / y
        c[4] = (0.5 - c[2]) / y
        c[5] = (1.0 / 6.0 - c[3]) / y
        c[6] = (1.0 / 24.0 - c[4]) / y
        c[7] = (1.0 / 120.0 - c[5]) / y


@inner
def tangent_coefficients(c: Array, a: Array) -> None:
    """Coefficients a_n of int_0^1 exp(t ad_X) dt = sum_(n=0)^4 a_n ad_X^n, and their derivatives by y in
    a[5:].

    ad_X obeys (ad^2 + y)^2 ad = 0, so four powers are enough; with dc_k/dy = -(c_(k+1) - k c_(k+2)) / 2.
    """
    a[0] = 1.0
    a[1] = 2.0 * c[2] - 0.5 * c[1]
    a[2] = 0.5 * (5.0 * c[3] - c[2])
    a[3] = 0.5 * c[3] - c[4]
    a[4] = 0.5 * (c[4] - 3.0 * c[5])
    d1 = -0.5 * (c[2] - c[3])
    d2 = -0.5 * (c[3] - 2.0 * c[4])
    d3 = -0.5 * (c[4] - 3.0 * c[5])
    d4 = -0.5 * (c[5] - 4.0 * c[6])
    d5 = -0.5 * (c[6] - 5.0 * c[7])
    a[5] = 0.0
    a[6] = 2.0 * d2 - 0.5 * d1
    a[7] = 0.5 * (5.0 * d3 - d2)
    a[8] = 0.5 * d3 - d4
    a[9] = 0.5 * (d4 - 3.0 * d5)


@inner
def exponential(xi: Array, s: float, c: Array, R: Array, p: Array) -> None:
    """Write exp(s xi) as rotation R (3, 3) and position p (3,); `c`: Stumpff functions of (s |omega|)^2."""
    x, y, z = xi[0], xi[1], xi[2]
    f = s * c[1]
    g = s * s * c[2]
    R[0, 0] = 1.0 - g * (y * y + z * z)
    R[1, 1] = 1.0 - g * (x * x + z * z)
    R[2, 2] = 1.0 - g * (x * x + y * y)
    R[0, 1] = g * x * y - f * z
    R[1, 0] = g * x * y + f * z
    R[0, 2] = g * x * z + f * y
    R[2, 0] = g * x * z - f * y
    R[1, 2] = g * y * z - f * x
    R[2, 1] = g * y * z + f * x
    # p = (s + s^2 c2 [w] + s^3 c3 [w]^2) u
    u0, u1, u2 = xi[3], xi[4], xi[5]
    h = s * s * s * c[3]
    w0, w1, w2 = y * u2 - z * u1, z * u0 - x * u2, x * u1 - y * u0
    p[0] = s * u0 + g * w0 + h * (y * w2 - z * w1)
    p[1] = s * u1 + g * w1 + h * (z * w0 - x * w2)
    p[2] = s * u2 + g * w2 + h * (x * w1 - y * w0)


# Six numbers are computed before the first is stored: then the compiler, which must suppose that arrays
# overlap, may take several at once.


@inner
def add_ad(V: Array, x: Array, factor: float, out: Array) -> None:
    """out += factor * ad_V x for twists V, x (6,)."""
    a0 = V[1] * x[2] - V[2] * x[1]
    a1 = V[2] * x[0] - V[0] * x[2]
    a2 = V[0] * x[1] - V[1] * x[0]
    l0 = V[4] * x[2] - V[5] * x[1] + V[1] * x[5] - V[2] * x[4]
    l1 = V[5] * x[0] - V[3] * x[2] + V[2] * x[3] - V[0] * x[5]
    l2 = V[3] * x[1] - V[4] * x[0] + V[0] * x[4] - V[1] * x[3]
    add((a0, a1, a2, l0, l1, l2), factor, out)


@inner
def ad(V: Array, x: Array, out: Array) -> None:
    """out <- ad_V x for twists V, x (6,)."""
    a0 = V[1] * x[2] - V[2] * x[1]
    a1 = V[2] * x[0] - V[0] * x[2]
    a2 = V[0] * x[1] - V[1] * x[0]
    l0 = V[4] * x[2] - V[5] * x[1] + V[1] * x[5] - V[2] * x[4]
    l1 = V[5] * x[0] - V[3] * x[2] + V[2] * x[3] - V[0] * x[5]
    l2 = V[3] * x[1] - V[4] * x[0] + V[0] * x[4] - V[1] * x[3]
    out[0], out[1], out[2], out[3], out[4], out[5] = a0, a1, a2, l0, l1, l2


@inner
def add_coad(V: Array, h: Array, factor: float, out: Array) -> None:
    """out += factor * ad_V' h for a twist V and a momentum or wrench h (6,)."""
    n0 = V[2] * h[1] - V[1] * h[2] + V[5] * h[4] - V[4] * h[5]
    n1 = V[0] * h[2] - V[2] * h[0] + V[3] * h[5] - V[5] * h[3]
    n2 = V[1] * h[0] - V[0] * h[1] + V[4] * h[3] - V[3] * h[4]
    f0 = V[2] * h[4] - V[1] * h[5]
    f1 = V[0] * h[5] - V[2] * h[3]
    f2 = V[1] * h[3] - V[0] * h[4]
    add((n0, n1, n2, f0, f1, f2), factor, out)


@inner
def add(x: tuple[float, float, float, float, float, float], factor: float, out: Array) -> None:
    """out += factor * x, six numbers."""
    x0, x1, x2, x3, x4, x5 = x
    y0, y1, y2 = out[0] + factor * x0, out[1] + factor * x1, out[2] + factor * x2
    y3, y4, y5 = out[3] + factor * x3, out[4] + factor * x4, out[5] + factor * x5
    out[0], out[1], out[2], out[3], out[4], out[5] = y0, y1, y2, y3, y4, y5


@inner
def to_body(R: Array, p: Array, x: Array) -> None:
    """x <- Ad_g^-1 x: the twist x of the parent frame seen from the frame g = (R, p)."""
    w0, w1, w2 = x[0], x[1], x[2]
    v0 = x[3] - (p[1] * w2 - p[2] * w1)
    v1 = x[4] - (p[2] * w0 - p[0] * w2)
    v2 = x[5] - (p[0] * w1 - p[1] * w0)
    for i in range(3):
        x[i] = R[0, i] * w0 + R[1, i] * w1 + R[2, i] * w2
        x[3 + i] = R[0, i] * v0 + R[1, i] * v1 + R[2, i] * v2


@inner
def to_parent(R: Array, p: Array, x: Array) -> None:
    """x <- Ad_g x: the twist x of the frame g = (R, p) seen from the parent frame."""
    w0, w1, w2 = x[0], x[1], x[2]
    v0, v1, v2 = x[3], x[4], x[5]
    for i in range(3):
        x[i] = R[i, 0] * w0 + R[i, 1] * w1 + R[i, 2] * w2
    for i in range(3):
        x[3 + i] = R[i, 0] * v0 + R[i, 1] * v1 + R[i, 2] * v2
    x[3] += p[1] * x[2] - p[2] * x[1]
    x[4] += p[2] * x[0] - p[0] * x[2]
    x[5] += p[0] * x[1] - p[1] * x[0]


@inner
def wrench_to_parent(R: Array, p: Array, h: Array) -> None:
    """h <- Ad_g^-T h: the wrench h of the frame g = (R, p) seen from the parent frame."""
    n0, n1, n2 = h[0], h[1], h[2]
    f0, f1, f2 = h[3], h[4], h[5]
    for i in range(3):
        h[3 + i] = R[i, 0] * f0 + R[i, 1] * f1 + R[i, 2] * f2
    for i in range(3):
        h[i] = R[i, 0] * n0 + R[i, 1] * n1 + R[i, 2] * n2
    h[0] += p[1] * h[5] - p[2] * h[4]
    h[1] += p[2] * h[3] - p[0] * h[5]
    h[2] += p[0] * h[4] - p[1] * h[3]


@inner
def compose(R: Array, p: Array, R1: Array, p1: Array) -> None:
    """(R, p) <- (R, p)(R1, p1)."""
    for i in range(3):
        a, b, c = R[i, 0], R[i, 1], R[i, 2]
        p[i] += a * p1[0] + b * p1[1] + c * p1[2]
        for j in range(3):
            R[i, j] = a * R1[0, j] + b * R1[1, j] + c * R1[2, j]


@inner
def dot6(x: Array, y: Array) -> float:
    """Inner product of a twist and a wrench."""
    value: float = x[0] * y[0] + x[1] * y[1] + x[2] * y[2] + x[3] * y[3] + x[4] * y[4] + x[5] * y[5]
    return value
