"""The two forward waves of a medium for a given tangential wave vector.

The frame has z along the interface normal and x along the tangential refraction vector
N = (xi, 0, q). A wave is the vector Psi = (E_x, H_y, E_y, -H_x), which is continuous through the
interface; Delta Psi = q Psi, and the flux along z is Psi^H J Psi / 4 with Psi^H J Psi =
2 Re(E_x* H_y - E_y* H_x). Forward means: carries energy towards +z (not: positive q), or decays
towards +z.

Closed forms serve isotropic and uniaxial media. In a biaxial medium single eigenvectors lose all
meaning near a binormal, where two waves of one side become equal: there the *plane* of both
forward waves is computed first, which stays well conditioned, then its power-orthogonal basis
that diagonalises J Delta. So fluxes add up to rounding at any distance from a binormal.

References
----------
D. W. Berreman, J. Opt. Soc. Am. 62, 502 (1972); P. Yeh, J. Opt. Soc. Am. 69, 742 (1979).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from raymap.jit.kernels import inner_kernel
from tracer.optics.crystals.biaxial_modes import biaxial_forward_modes
from tracer.optics.crystals.rows import BIAXIAL, ISOTROPIC

__all__ = [
    "MODE",
    "TurnedMedium",
    "complete_mode",
    "forward_modes",
    "mirror_modes",
    "orthogonalise_pair",
]

MODE = 7
"""Columns of a mode: Psi (4), E_z, q, and 1 for a propagating or 0 for an evanescent wave."""

Array = np.ndarray[Any, np.dtype[Any]]


@inner_kernel
def _put(modes: Array, k: int, ex: complex, hy: complex, ey: complex, hx: complex) -> None:
    """Store Psi with |Psi| = 1."""
    size = math.sqrt(
        (ex * ex.conjugate() + hy * hy.conjugate() + ey * ey.conjugate() + hx * hx.conjugate()).real
    )
    modes[k, 0] = ex / size
    modes[k, 1] = hy / size
    modes[k, 2] = ey / size
    modes[k, 3] = -hx / size


@inner_kernel
def _put_real(modes: Array, k: int, xi: float, q: float, ex: float, ey: float, ez: float) -> None:
    """Store a travelling wave from its field, |Psi| = 1."""
    hy = q * ex - xi * ez
    hx = -q * ey
    scale = 1.0 / math.sqrt(ex * ex + hy * hy + ey * ey + hx * hx)
    modes[k, 0] = ex * scale
    modes[k, 1] = hy * scale
    modes[k, 2] = ey * scale
    modes[k, 3] = -hx * scale
    modes[k, 4] = ez * scale
    modes[k, 5] = q
    modes[k, 6] = 1.0


@inner_kernel
def complete_mode(modes: Array, k: int, frame: Array, xi: float) -> None:
    """E_z from the tangential field; ``frame`` holds e11, e22, e33, e12, e13, e23."""
    modes[k, 4] = -(frame[4] * modes[k, 0] + frame[5] * modes[k, 2] + xi * modes[k, 1]) / frame[2]


@inner_kernel
def _isotropic(n2: float, xi: float, hint: float, modes: Array, k: int) -> None:
    """s, then p."""
    square = n2 - xi * xi
    travelling = 1.0 if square >= 0.0 or hint < 0.0 else 0.0
    if hint < 0.0:
        q = complex(-hint, 0.0)
    elif square >= 0.0:
        q = complex(math.sqrt(square), 0.0)
    else:
        q = complex(0.0, math.sqrt(-square))
    _put(modes, k, 0.0j, 0.0j, 1.0 + 0.0j, -q)
    modes[k, 4] = 0.0
    _put(modes, k + 1, q / n2, 1.0 + 0.0j, 0.0j, 0.0j)
    modes[k + 1, 4] = -xi / n2 * modes[k + 1, 1]
    for j in range(2):
        modes[k + j, 5] = q
        modes[k + j, 6] = travelling


@inner_kernel
def _axis_across(
    xi: float, q: float, cx: float, cy: float, cz: float
) -> tuple[float, float, float, float]:
    """Unit vector along the part of the optic axis across the wave normal, and that part's size.

    Projected twice, so that it lies across the normal to rounding however small it is; along the
    axis itself any transverse direction serves.
    """
    n = math.sqrt(xi * xi + q * q)
    kx = xi / n
    kz = q / n
    along = kx * cx + kz * cz
    tx = cx - along * kx
    ty = cy
    tz = cz - along * kz
    along = kx * tx + kz * tz
    tx -= along * kx
    tz -= along * kz
    size = math.sqrt(tx * tx + ty * ty + tz * tz)
    if size < 1e-150:
        return 0.0, 1.0, 0.0, 0.0
    return tx / size, ty / size, tz / size, size


@inner_kernel
def _uniaxial(
    eo: float,
    ee: float,
    cx: float,
    cy: float,
    cz: float,
    xi: float,
    hint: float,
    modes: Array,
    k: int,
) -> bool:
    """Ordinary, then extraordinary; False where both are evanescent and nearly the same wave."""
    # Solve both dispersion equations
    de = ee - eo
    square_o = eo - xi * xi
    a = eo + de * cz * cz
    b = de * xi * cx * cz
    square_e = eo * (ee * a - xi * xi * (eo + de * (cx * cx + cz * cz)))
    root_o = math.sqrt(max(square_o, 0.0))
    root_e = math.sqrt(max(square_e, 0.0))

    # A grazing wave knows its own partner better than a difference of squares does
    if not math.isnan(hint):
        hint_o = -hint
        hint_e = -(a * hint + b)
        miss_o = abs(hint_o * hint_o - square_o)
        miss_e = abs(hint_e * hint_e - square_e)
        if hint_o > 0.0 and miss_o <= miss_e and miss_o < 1e-12:
            root_o = hint_o
            square_o = root_o * root_o
        elif hint_e > 0.0 and miss_e < 1e-12:
            root_e = hint_e
            square_e = root_e * root_e

    # Ordinary wave: E across both the wave normal and the optic axis
    if square_o >= 0.0:
        q = root_o
        tx, ty, tz, _ = _axis_across(xi, q, cx, cy, cz)
        n = math.sqrt(eo)
        kx = xi / n
        kz = q / n
        ex = -kz * ty
        ey = kz * tx - kx * tz
        ez = kx * ty
        _put_real(modes, k, xi, q, ex, ey, ez)
    else:
        qc = complex(0.0, math.sqrt(-square_o))
        cex = -qc * cy
        cey = qc * cx - xi * cz
        cez = xi * cy + 0.0j
        _put(modes, k, cex, qc * cex - xi * cez, cey, -qc * cey)
        modes[k, 5] = qc
        modes[k, 6] = 0.0

    # Extraordinary wave: D in the plane of wave normal and axis
    if square_e >= 0.0:
        q = (root_e - b) / a
        tx, ty, tz, _ = _axis_across(xi, q, cx, cy, cz)
        along = (1.0 / ee - 1.0 / eo) * (cx * tx + cy * ty + cz * tz)
        ex = tx / eo + along * cx
        ey = ty / eo + along * cy
        ez = tz / eo + along * cz
        _put_real(modes, k + 1, xi, q, ex, ey, ez)
    else:
        qc = complex(-b / a, math.sqrt(-square_e) / a)
        along_c = xi * cx + qc * cz
        cex = eo * cx - along_c * xi
        cey = eo * cy + 0.0j
        cez = eo * cz - along_c * qc
        _put(modes, k + 1, cex, qc * cex - xi * cez, cey, -qc * cey)
        modes[k + 1, 5] = qc
        modes[k + 1, 6] = 0.0

    if square_o >= 0.0 or square_e >= 0.0:
        return True
    overlap = 0.0j
    for j in range(4):
        overlap += modes[k, j].conjugate() * modes[k + 1, j]
    return abs(overlap) < 1.0 - 1e-4


@inner_kernel
def _product(modes: Array, i: int, j: int) -> complex:
    """Psi_i^H J Psi_j."""
    value: complex = (
        modes[i, 0].conjugate() * modes[j, 1]
        + modes[i, 1].conjugate() * modes[j, 0]
        + modes[i, 2].conjugate() * modes[j, 3]
        + modes[i, 3].conjugate() * modes[j, 2]
    )
    return value


@inner_kernel
def orthogonalise_pair(modes: Array, k: int) -> None:
    """Remove the rounding from the fluxes of a pair of forward waves of a lossless medium.

    Two travelling waves carry no common flux, a travelling and an evanescent one neither, and an
    evanescent wave carries none of its own.
    """
    first = modes[k, 6].real > 0.5
    second = modes[k + 1, 6].real > 0.5
    if not first and not second:
        return
    if first and second:
        flux = 2.0 * (modes[k, 0].real * modes[k, 1].real + modes[k, 2].real * modes[k, 3].real)
        if flux > 1e-12:
            shared = (
                modes[k, 0].real * modes[k + 1, 1].real
                + modes[k, 1].real * modes[k + 1, 0].real
                + modes[k, 2].real * modes[k + 1, 3].real
                + modes[k, 3].real * modes[k + 1, 2].real
            ) / flux
            for c in range(4):
                modes[k + 1, c] = modes[k + 1, c].real - shared * modes[k, c].real
        return
    i, j = (k, k + 1) if first else (k + 1, k)
    flux = _product(modes, i, i).real
    if flux <= 1e-12:
        return
    common = _product(modes, i, j) / flux
    for c in range(4):
        modes[j, c] -= common * modes[i, c]

    # Take the evanescent wave's own flux away with its growing partner, the conjugate field
    own = _product(modes, j, j).real
    cross = 2.0 * (modes[j, 0] * modes[j, 1] + modes[j, 2] * modes[j, 3]).conjugate()
    if abs(cross) > 1e-6:
        beta = -0.5 * own * cross.conjugate() / (abs(cross) ** 2)
        for c in range(4):
            modes[j, c] += beta * modes[j, c].conjugate()


@inner_kernel
def mirror_modes(modes: Array, k: int) -> None:
    """Forward waves of the mirrored medium (e13, e23 negated) into backward waves of the medium."""
    for j in range(k, k + 2):
        modes[j, 1] = -modes[j, 1]
        modes[j, 3] = -modes[j, 3]
        modes[j, 4] = -modes[j, 4]
        modes[j, 5] = -modes[j, 5]


class TurnedMedium(NamedTuple):
    """A medium in the frame of an interface.

    kind : ISOTROPIC, UNIAXIAL or BIAXIAL
    tensor : (6,) e11, e22, e33, e12, e13, e23
    eo, ee : n_o^2 and n_e^2 (uniaxial), n^2 in ``eo`` (isotropic)
    cx, cy, cz : optic axis (uniaxial)
    """

    kind: int
    tensor: Array
    eo: float
    ee: float
    cx: float
    cy: float
    cz: float


@inner_kernel
def forward_modes(
    medium: TurnedMedium,
    xi: float,
    hint: float,
    modes: Array,
    k: int,
    work: Array,
    cwork: Array,
) -> None:
    """Write the two forward waves to rows k and k + 1 of ``modes`` ((n, MODE) complex128).

    Parameters
    ----------
    xi : tangential component of the refraction vector
    hint : q of a known backward wave at grazing incidence, else nan; its forward partner is then
        computed from it instead of from a difference of nearly equal squares
    work, cwork : (3, 4, 4) float64 and (2, 4, 4) complex128, scratch

    Order: s, p; ordinary, extraordinary; fast (smaller q), slow.
    """
    kind, frame, eo, ee, cx, cy, cz = medium
    if kind == ISOTROPIC:
        _isotropic(eo, xi, hint, modes, k)
        return
    closed = kind != BIAXIAL and _uniaxial(eo, ee, cx, cy, cz, xi, hint, modes, k)
    if not closed:
        biaxial_forward_modes(frame, xi, hint, modes, k, work, cwork)
    orthogonalise_pair(modes, k)
    complete_mode(modes, k, frame, xi)
    complete_mode(modes, k + 1, frame, xi)
