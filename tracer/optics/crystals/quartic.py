"""The Booker quartic: normal components q of the four waves of one tangential wave vector.

In the frame of an interface (z its normal, x along the tangential part of the wave vector) the
refraction vector is N = (xi, 0, q), and det(eps + N N^T - N^2) = 0 is a quartic in q with real
coefficients. It is kept as a product of two real quadratics rather than as four roots: near an
optic axis two roots of one side meet, each of them is then ill conditioned, their quadratic is not.

References
----------
H. G. Booker, Proc. R. Soc. London A 155, 235 (1936); R. Descartes, La Géométrie (1637), book III.
"""

from __future__ import annotations

import math

from raymap.jit.kernels import inner_kernel

__all__ = ["booker_coefficients", "factor_quartic", "factor_with_root", "largest_cubic_root"]


@inner_kernel
def booker_coefficients(
    e11: float, e22: float, e33: float, e12: float, e13: float, e23: float, xi: float
) -> tuple[float, float, float, float]:
    """Coefficients (a3, a2, a1, a0) of q^4 + a3 q^3 + a2 q^2 + a1 q + a0 in the interface frame."""
    c = e33 - xi * xi
    b = e22 - xi * xi
    a3 = 2.0 * e13 * xi
    a2 = -c * (e11 + b) + e23 * e23 - b * xi * xi + e13 * e13
    a1 = 2.0 * xi * (e12 * e23 - b * e13)
    a0 = c * (e11 * b - e12 * e12) + 2.0 * e12 * e13 * e23 - e11 * e23 * e23 - b * e13 * e13
    return a3 / e33, a2 / e33, a1 / e33, a0 / e33


@inner_kernel
def largest_cubic_root(b: float, c: float, d: float) -> float:
    """Largest real root of z^3 + b z^2 + c z + d."""
    shift = b / 3.0
    p = c - b * shift
    q = 2.0 * shift * shift * shift - shift * c + d
    discriminant = 0.25 * q * q + p * p * p / 27.0

    # Take the trigonometric form for three real roots, Cardano's for one
    if discriminant <= 0.0 and p < 0.0:
        radius = math.sqrt(-p / 3.0)
        argument = -0.5 * q / (radius * radius * radius)
        z = 2.0 * radius * math.cos(math.acos(min(1.0, max(-1.0, argument))) / 3.0) - shift
    else:
        half = -0.5 * q
        root = math.sqrt(max(discriminant, 0.0))
        cube = half + root if half >= 0.0 else half - root
        u = math.copysign(abs(cube) ** (1.0 / 3.0), cube)
        z = (u - p / (3.0 * u) if u != 0.0 else 0.0) - shift

    # Polish where the slope allows it
    for _ in range(2):
        slope = (3.0 * z + 2.0 * b) * z + c
        if slope > 0.0:
            z -= (((z + b) * z + c) * z + d) / slope
    return z


@inner_kernel
def factor_quartic(a3: float, a2: float, a1: float, a0: float) -> tuple[float, float, float, float]:
    """Real quadratics (q^2 + b1 q + c1)(q^2 + b2 q + c2) of the quartic.

    Four real roots: the first factor holds the two largest. Two real roots: one factor holds them.
    No real root: each factor holds a conjugate pair.
    """
    # Remove the cubic term, y = q + a3 / 4
    h = 0.25 * a3
    h2 = h * h
    p = a2 - 6.0 * h2
    r = a1 - 2.0 * a2 * h + 8.0 * h2 * h
    s = a0 - a1 * h + a2 * h2 - 3.0 * h2 * h2

    # Split into (y^2 - u y + v)(y^2 + u y + w) with the largest u^2
    z = max(largest_cubic_root(2.0 * p, p * p - 4.0 * s, -r * r), 0.0)
    u = math.sqrt(z)
    if u > 1e-8 * math.sqrt(abs(p) + 1e-300):
        v = 0.5 * (p + z + r / u)
        w = 0.5 * (p + z - r / u)
    else:
        root = math.sqrt(max(p * p - 4.0 * s, 0.0))
        v = 0.5 * (p + root)
        w = 0.5 * (p - root)

    # Shift back
    b1 = 2.0 * h - u
    c1 = h2 - u * h + v
    b2 = 2.0 * h + u
    c2 = h2 + u * h + w

    # Polish both factors together; well conditioned as long as they share no root
    for _ in range(3):
        r3 = a3 - b1 - b2
        r2 = a2 - c1 - c2 - b1 * b2 - b1 * r3
        r1 = a1 - b1 * c2 - b2 * c1 - c1 * r3 - b1 * r2
        r0 = a0 - c1 * c2 - c1 * r2
        m11 = c2 - c1 + b1 * (b1 - b2)
        m12 = b2 - b1
        m21 = c1 * (b1 - b2)
        m22 = c2 - c1
        determinant = m11 * m22 - m12 * m21
        if abs(determinant) < 1e-14:
            break
        step_b = (r1 * m22 - m12 * r0) / determinant
        step_c = (m11 * r0 - m21 * r1) / determinant
        b1 += step_b
        c2 += r2 - step_c + (b1 - step_b - b2) * step_b
        c1 += step_c
        b2 += r3 - step_b
        if abs(step_b) + abs(step_c) < 1e-15 * (1.0 + abs(c1)):
            break
    return b1, c1, b2, c2


@inner_kernel
def factor_with_root(
    a3: float,
    a2: float,
    a1: float,
    a0: float,
    b1: float,
    c1: float,
    b2: float,
    c2: float,
    root: float,
) -> tuple[float, float, float, float]:
    """The factors of `factor_quartic` anew, from one accurately known root.

    Two roots that nearly meet across the factors are ill conditioned together; with one of them
    given the other is not.
    """
    # Deflate the quartic by the known root
    e2 = a3 + root
    e1 = a2 + root * e2
    e0 = a1 + root * e1
    residual_1 = abs((root + b1) * root + c1)
    residual_2 = abs((root + b2) * root + c2)
    if min(residual_1, residual_2) > 1e-4:
        return b1, c1, b2, c2

    # Find the other root of the factor that holds it, where that is real and stands apart
    b = b1 if residual_1 < residual_2 else b2
    other = -b - root
    for _ in range(3):
        slope = (3.0 * other + 2.0 * e2) * other + e1
        if abs(slope) < 1e-3:
            return b1, c1, b2, c2
        other -= (((other + e2) * other + e1) * other + e0) / slope

    # Deflate again
    rest_b = e2 + other
    rest_c = e1 + other * rest_b
    if residual_1 < residual_2:
        return -(root + other), root * other, rest_b, rest_c
    return rest_b, rest_c, -(root + other), root * other
