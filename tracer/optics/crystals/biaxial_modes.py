"""Forward waves of a general lossless tensor, robust at binormals and critical angles.

The quartic is factored into two quadratics. With four travelling waves the factor of the other
side, as a polynomial of Delta, maps every vector into the plane of the forward waves; in it J is
positive definite and J Delta symmetric, so a Cholesky factor and one Jacobi rotation give modes
that are power-orthogonal to rounding, however close the two are. Single eigenvectors (columns of
the adjugate of eps + N N^T - N^2) are used only for waves that stand apart.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from raymap.jit.kernels import inner_kernel
from tracer.optics.crystals.quartic import booker_coefficients, factor_quartic, factor_with_root

__all__ = ["biaxial_forward_modes"]

Array = np.ndarray[Any, np.dtype[Any]]


@inner_kernel
def _delta(frame: Array, xi: float, delta: Array) -> None:
    """Berreman's matrix for Psi = (E_x, H_y, E_y, -H_x)."""
    e11, e22, e33 = frame[0], frame[1], frame[2]
    e12, e13, e23 = frame[3], frame[4], frame[5]
    delta[0, 0] = -xi * e13 / e33
    delta[0, 1] = 1.0 - xi * xi / e33
    delta[0, 2] = -xi * e23 / e33
    delta[0, 3] = 0.0
    delta[1, 0] = e11 - e13 * e13 / e33
    delta[1, 1] = -xi * e13 / e33
    delta[1, 2] = e12 - e13 * e23 / e33
    delta[1, 3] = 0.0
    delta[2, 0] = 0.0
    delta[2, 1] = 0.0
    delta[2, 2] = 0.0
    delta[2, 3] = 1.0
    delta[3, 0] = e12 - e13 * e23 / e33
    delta[3, 1] = -xi * e23 / e33
    delta[3, 2] = e22 - e23 * e23 / e33 - xi * xi
    delta[3, 3] = 0.0


@inner_kernel
def _filter(delta: Array, b: complex, c: complex, out: Array) -> None:
    """Delta^2 + b Delta + c: what the other factor's waves do not survive."""
    for i in range(4):
        for j in range(4):
            value = b * delta[i, j]
            for m in range(4):
                value += delta[i, m] * delta[m, j]
            out[i, j] = value
        out[i, i] += c


@inner_kernel
def _two_columns(matrix: Array) -> bool:
    """Orthonormal basis of the column space of a rank-2 matrix, into its first two columns."""
    for target in range(2):
        best = -1.0
        column = target
        for j in range(target, 4):
            size = 0.0
            for i in range(4):
                size += (matrix[i, j] * np.conj(matrix[i, j])).real
            if size > best:
                best = size
                column = j
        if best <= 1e-28:
            return False
        scale = 1.0 / math.sqrt(best)
        for i in range(4):
            swap = matrix[i, target]
            matrix[i, target] = matrix[i, column] * scale
            if column != target:
                matrix[i, column] = swap
        for _ in range(2):
            for j in range(target + 1, 4):
                overlap = np.conj(matrix[0, target]) * matrix[0, j]
                for i in range(1, 4):
                    overlap += np.conj(matrix[i, target]) * matrix[i, j]
                for i in range(4):
                    matrix[i, j] -= overlap * matrix[i, target]
    return True


@inner_kernel
def _flux(matrix: Array, i: int, j: int) -> float:
    """Psi_i^T J Psi_j of two real columns."""
    value: float = (
        matrix[0, i] * matrix[1, j]
        + matrix[1, i] * matrix[0, j]
        + matrix[2, i] * matrix[3, j]
        + matrix[3, i] * matrix[2, j]
    )
    return value


@inner_kernel
def _travelling_pair(
    delta: Array, b: float, c: float, basis: Array, product: Array, modes: Array, k: int
) -> bool:
    """Power-orthogonal modes of the forward plane; False if J is not positive definite there."""
    _filter(delta, b, c, basis)
    if not _two_columns(basis):
        return False

    # Flux-orthonormalise the basis (Cholesky)
    g11 = _flux(basis, 0, 0)
    g12 = _flux(basis, 0, 1)
    g22 = _flux(basis, 1, 1)
    if g11 < g22:
        for i in range(4):
            swap = basis[i, 0]
            basis[i, 0] = basis[i, 1]
            basis[i, 1] = swap
        g11, g22 = g22, g11
    if g11 <= 1e-14 or g22 - g12 * g12 / g11 <= 1e-14:
        return False
    scale = 1.0 / math.sqrt(g11)
    for i in range(4):
        basis[i, 0] *= scale
    for _ in range(2):
        common = _flux(basis, 0, 1)
        for i in range(4):
            basis[i, 1] -= common * basis[i, 0]
    scale = 1.0 / math.sqrt(_flux(basis, 1, 1))
    for i in range(4):
        basis[i, 1] *= scale

    # Diagonalise J Delta in it
    for j in range(2):
        for i in range(4):
            value = 0.0
            for m in range(4):
                value += delta[i, m] * basis[m, j]
            product[i, j] = value
        for i in range(4):
            basis[i, 2 + j] = product[i, j]
    k11 = _flux(basis, 0, 2)
    k12 = 0.5 * (_flux(basis, 0, 3) + _flux(basis, 1, 2))
    k22 = _flux(basis, 1, 3)
    half = 0.5 * (k11 - k22)
    radius = math.sqrt(half * half + k12 * k12)
    angle = 0.5 * math.atan2(k12, half) if radius > 0.0 else 0.0
    ca = math.cos(angle)
    sa = math.sin(angle)
    mean = 0.5 * (k11 + k22)

    # Store the fast wave, then the slow one
    for i in range(4):
        modes[k, i] = ca * basis[i, 1] - sa * basis[i, 0]
        modes[k + 1, i] = ca * basis[i, 0] + sa * basis[i, 1]
    modes[k, 5] = mean - radius
    modes[k + 1, 5] = mean + radius
    for j in range(k, k + 2):
        modes[j, 6] = 1.0
        _unit(modes, j)
    return True


@inner_kernel
def _unit(modes: Array, k: int) -> None:
    size = 0.0
    for i in range(4):
        size += (modes[k, i] * modes[k, i].conjugate()).real
    scale = 1.0 / math.sqrt(size)
    for i in range(4):
        modes[k, i] *= scale


@inner_kernel
def _single(frame: Array, xi: float, q: complex, modes: Array, k: int) -> float:
    """Mode of one root that stands apart; returns its flux Psi^H J Psi."""
    m11 = frame[0] - q * q
    m22 = frame[1] - xi * xi - q * q
    m33 = frame[2] - xi * xi + 0.0j
    m12 = frame[3] + 0.0j
    m13 = frame[4] + xi * q
    m23 = frame[5] + 0.0j

    # Take the largest column of the adjugate as E
    a11 = m22 * m33 - m23 * m23
    a22 = m11 * m33 - m13 * m13
    a33 = m11 * m22 - m12 * m12
    a12 = m13 * m23 - m12 * m33
    a13 = m12 * m23 - m13 * m22
    a23 = m12 * m13 - m11 * m23
    s1 = abs(a11) + abs(a12) + abs(a13)
    s2 = abs(a12) + abs(a22) + abs(a23)
    s3 = abs(a13) + abs(a23) + abs(a33)
    if s1 >= s2 and s1 >= s3:
        ex, ey, ez = a11, a12, a13
    elif s2 >= s3:
        ex, ey, ez = a12, a22, a23
    else:
        ex, ey, ez = a13, a23, a33
    modes[k, 0] = ex
    modes[k, 1] = q * ex - xi * ez
    modes[k, 2] = ey
    modes[k, 3] = q * ey
    modes[k, 5] = q
    _unit(modes, k)
    flux: float = (
        2.0 * (modes[k, 0].conjugate() * modes[k, 1] + modes[k, 2].conjugate() * modes[k, 3]).real
    )
    return flux


@inner_kernel
def _real_forward(frame: Array, xi: float, b: float, disc: float, modes: Array, k: int) -> None:
    """The root of a quadratic with two real roots whose wave carries energy forward."""
    root = math.sqrt(max(disc, 0.0))
    modes[k, 6] = 1.0
    if _single(frame, xi, complex(-0.5 * b + root, 0.0), modes, k) < 0.0:
        _single(frame, xi, complex(-0.5 * b - root, 0.0), modes, k)


@inner_kernel
def _evanescent_pair(
    delta: Array, b1: float, d1: float, b2: float, d2: float, cbasis: Array, modes: Array, k: int
) -> None:
    """A basis of the plane of two decaying waves (total reflection needs no more)."""
    q1 = complex(-0.5 * b1, math.sqrt(-d1))
    q2 = complex(-0.5 * b2, math.sqrt(-d2))
    b = -(q1.conjugate() + q2.conjugate())
    c = q1.conjugate() * q2.conjugate()
    _filter(delta, b, c, cbasis)
    _two_columns(cbasis)
    for j in range(2):
        for i in range(4):
            modes[k + j, i] = cbasis[i, j]
        modes[k + j, 6] = 0.0
    modes[k, 5] = q1
    modes[k + 1, 5] = q2


@inner_kernel
def _out_of_order(
    frame: Array, xi: float, b1: float, d1: float, b2: float, d2: float, modes: Array, k: int
) -> int:
    """Four travelling waves, forward and backward interleaved: sort them one by one."""
    found = 0
    for side in range(2):
        b = b1 if side == 0 else b2
        root = math.sqrt(max(d1 if side == 0 else d2, 0.0))
        for sign in (1.0, -1.0):
            if found < 2:
                row = k + found
                if _single(frame, xi, complex(-0.5 * b + sign * root, 0.0), modes, row) > 0.0:
                    modes[row, 6] = 1.0
                    found += 1
    if found == 2 and modes[k, 5].real > modes[k + 1, 5].real:
        for i in range(7):
            swap = modes[k, i]
            modes[k, i] = modes[k + 1, i]
            modes[k + 1, i] = swap
    return found


@inner_kernel
def biaxial_forward_modes(
    frame: Array, xi: float, hint: float, modes: Array, k: int, work: Array, cwork: Array
) -> None:
    """The two forward waves of any real symmetric positive tensor; fast before slow.

    ``hint``: q of a known backward wave that is close to its forward partner, or nan.
    """
    xi_used = xi
    for attempt in range(3):
        a3, a2, a1, a0 = booker_coefficients(
            frame[0], frame[1], frame[2], frame[3], frame[4], frame[5], xi_used
        )
        b1, c1, b2, c2 = factor_quartic(a3, a2, a1, a0)
        if not math.isnan(hint):
            b1, c1, b2, c2 = factor_with_root(a3, a2, a1, a0, b1, c1, b2, c2, hint)
        d1 = 0.25 * b1 * b1 - c1
        d2 = 0.25 * b2 * b2 - c2

        # A double root beside the others, all on one side, is a binormal: rounding made it complex
        tiny = 1e-11 * (abs(c1) + abs(c2))
        gap = 0.5 * (b2 - b1)
        if d1 < 0.0 and d1 > -tiny and gap > math.sqrt(max(d2, 0.0)) + 1e-3:
            d1 = 0.0
        if d2 < 0.0 and d2 > -tiny and gap > math.sqrt(max(d1, 0.0)) + 1e-3:
            d2 = 0.0

        _delta(frame, xi_used, work[0])
        if d1 >= 0.0 and d2 >= 0.0:
            if _travelling_pair(work[0], b2, c2, work[1], work[2], modes, k):
                return
            if _out_of_order(frame, xi_used, b1, d1, b2, d2, modes, k) == 2:
                return
        elif d1 >= 0.0 or d2 >= 0.0:
            # One wave travels, one decays; put the travelling one by its q
            if d1 >= 0.0:
                _real_forward(frame, xi_used, b1, d1, modes, k)
                q = complex(-0.5 * b2, math.sqrt(-d2))
            else:
                _real_forward(frame, xi_used, b2, d2, modes, k)
                q = complex(-0.5 * b1, math.sqrt(-d1))
            _single(frame, xi_used, q, modes, k + 1)
            modes[k + 1, 6] = 0.0
            for i in range(7):
                swap = modes[k, i]
                modes[k, i] = modes[k + 1, i]
                modes[k + 1, i] = swap
            return
        else:
            _evanescent_pair(work[0], b1, d1, b2, d2, cwork[0], modes, k)
            return

        # Exactly at a critical angle a forward and a backward wave are one: step aside
        xi_used = xi * (1.0 - 1e-13 * 10.0**attempt)
