"""One wave meets the plane interface of two media: up to two reflected and two refracted rays.

The incident wave is given by its refraction vector N (wave normal times index) and field E. The
tangential field (E_x, H_y, E_y, -H_x) of incident and reflected waves equals that of the refracted
ones: four equations for four amplitudes. Shares are fluxes through the interface over the incident
flux; fields of the outgoing waves come with their amplitudes, in the same phase reference (the
point of incidence), so that coherent sums need only the paths between.

References
----------
D. W. Berreman, J. Opt. Soc. Am. 62, 502 (1972); conventions of Born & Wolf, Principles of Optics.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from raymap.jit.kernels import inner_kernel, kernel
from tracer.optics.crystals.interface_modes import interface_frame, medium_modes
from tracer.optics.crystals.modes import MODE
from tracer.optics.crystals.rows import (
    EPS_ORDINARY,
    ISOTROPIC,
    KIND,
)

__all__ = [
    "WAVE",
    "InterfaceScratch",
    "interface_batch",
    "interface_event",
    "interface_scratch",
]

WAVE = 16
"""Columns of an outgoing wave: N (3), ray direction (3), Re E (3), Im E (3), share, amplitude
(2, of its unit mode), and 0 none or evanescent, 1 one ray of an isotropic medium, 2 ordinary or
fast, 3 extraordinary or slow."""

Array = np.ndarray[Any, np.dtype[Any]]


class InterfaceScratch(NamedTuple):
    """Working arrays for one thread: matrices (real, complex), modes, and frame."""

    work: Array
    cwork: Array
    modes: Array
    frame: Array


@kernel
def interface_scratch() -> InterfaceScratch:
    """New working arrays."""
    return InterfaceScratch(
        np.zeros((3, 4, 4), np.float64),
        np.zeros((2, 4, 5), np.complex128),
        np.zeros((4, MODE), np.complex128),
        np.zeros((8, 6), np.float64),
    )


@inner_kernel
def _solve(m: Array) -> None:
    """Gaussian elimination with pivoting of a 4 x 5 system; the solution is left in column 4."""
    for column in range(4):
        best = -1.0
        pivot = column
        for row in range(column, 4):
            size = m[row, column].real ** 2 + m[row, column].imag ** 2
            if size > best:
                best = size
                pivot = row
        if pivot != column:
            for j in range(column, 5):
                swap = m[column, j]
                m[column, j] = m[pivot, j]
                m[pivot, j] = swap
        if best == 0.0:
            m[column, column] = 1e-300
        inverse = 1.0 / m[column, column]
        for row in range(column + 1, 4):
            factor = m[row, column] * inverse
            if factor != 0.0:
                for j in range(column + 1, 5):
                    m[row, j] -= factor * m[column, j]
    for row in range(3, -1, -1):
        value = m[row, 4]
        for j in range(row + 1, 4):
            value -= m[row, j] * m[j, 4]
        m[row, 4] = value / m[row, row]


@inner_kernel
def _store(
    modes: Array,
    k: int,
    amplitude: complex,
    incident_flux: float,
    frame: Array,
    xi: float,
    label: float,
    out: Array,
    row: int,
) -> None:
    """One outgoing wave in world coordinates."""
    for i in range(WAVE):
        out[row, i] = 0.0
    out[row, 13] = amplitude.real
    out[row, 14] = amplitude.imag
    ex = modes[k, 0]
    ey = modes[k, 2]
    ez = modes[k, 4]
    hx = -modes[k, 3]
    hy = modes[k, 1]
    q = modes[k, 5].real

    # Ray direction, Re(E x H*), with H_z = xi E_y
    hz = xi * ey
    sx = (ey * hz.conjugate() - ez * hy.conjugate()).real
    sy = (ez * hx.conjugate() - ex * hz.conjugate()).real
    sz = (ex * hy.conjugate() - ey * hx.conjugate()).real
    size = math.sqrt(sx * sx + sy * sy + sz * sz)
    travelling = modes[k, 6].real > 0.5
    if size > 0.0:
        sx /= size
        sy /= size
        sz /= size
    for i in range(3):
        e = amplitude * (frame[0, i] * ex + frame[1, i] * ey + frame[2, i] * ez)
        out[row, i] = xi * frame[0, i] + q * frame[2, i]
        out[row, 3 + i] = sx * frame[0, i] + sy * frame[1, i] + sz * frame[2, i]
        out[row, 6 + i] = e.real
        out[row, 9 + i] = e.imag
    if travelling:
        flux = 2.0 * sz * size
        out[row, 12] = abs(flux) * (amplitude.real**2 + amplitude.imag**2) / incident_flux
        out[row, 15] = label


@inner_kernel
def _store_isotropic(
    n2: float,
    q: complex,
    sign: float,
    hy: complex,
    ey: complex,
    incident_flux: float,
    frame: Array,
    xi: float,
    out: Array,
    row: int,
) -> None:
    """The one ray of an isotropic medium with tangential fields H_y and E_y; q is its |q|."""
    for i in range(WAVE):
        out[row, i] = 0.0
        out[row + 1, i] = 0.0
    ex = sign * q / n2 * hy
    ez = -xi / n2 * hy
    n = math.sqrt(n2)
    for i in range(3):
        e = frame[0, i] * ex + frame[1, i] * ey + frame[2, i] * ez
        big_n = xi * frame[0, i] + sign * q.real * frame[2, i]
        out[row, i] = big_n
        out[row, 3 + i] = big_n / n
        out[row, 6 + i] = e.real
        out[row, 9 + i] = e.imag
    if q.imag == 0.0:
        square_h = hy.real * hy.real + hy.imag * hy.imag
        square_e = ey.real * ey.real + ey.imag * ey.imag
        out[row, 12] = 2.0 * q.real * (square_h / n2 + square_e) / incident_flux
        out[row, 15] = 1.0


@inner_kernel
def _cramer(
    a11: complex,
    a12: complex,
    a21: complex,
    a22: complex,
    b1: complex,
    b2: complex,
) -> tuple[complex, complex]:
    """Solve a 2 x 2 system."""
    determinant = a11 * a22 - a12 * a21
    size = determinant.real * determinant.real + determinant.imag * determinant.imag
    if size == 0.0:
        return 0.0j, 0.0j
    inverse = determinant.conjugate() * (1.0 / size)
    return (b1 * a22 - b2 * a12) * inverse, (a11 * b2 - a21 * b1) * inverse


@inner_kernel
def interface_event(
    medium_1: Array,
    medium_2: Array,
    px: float,
    py: float,
    pz: float,
    field: Array,
    nx: float,
    ny: float,
    nz: float,
    out: Array,
    scratch: InterfaceScratch,
) -> float:
    """Reflect and refract one wave; returns its incident flux 2 Re(E_x* H_y - E_y* H_x).

    Parameters
    ----------
    medium_1, medium_2 : (ROW,) float64, before and behind the interface
    px, py, pz : refraction vector N of the incident wave
    field : (3,) complex128, its E
    nx, ny, nz : unit normal, pointing into medium 2
    out : (4, WAVE) float64; rows 0, 1 reflected, 2, 3 refracted
    scratch : from `interface_scratch`
    """
    work, cwork, modes, frame = scratch
    # Set up the frame and the incident tangential field
    xi = interface_frame(nx, ny, nz, px, py, pz, frame)
    q = px * nx + py * ny + pz * nz
    ex = frame[0, 0] * field[0] + frame[0, 1] * field[1] + frame[0, 2] * field[2]
    ey = frame[1, 0] * field[0] + frame[1, 1] * field[1] + frame[1, 2] * field[2]
    ez = nx * field[0] + ny * field[1] + nz * field[2]
    hx = -q * ey
    hy = q * ex - xi * ez
    if medium_1[KIND] == ISOTROPIC:
        ex = q * hy / medium_1[EPS_ORDINARY]
    incident_flux: float = 2.0 * (ex.conjugate() * hy - ey.conjugate() * hx).real
    size = (ex * ex.conjugate() + hy * hy.conjugate() + ey * ey.conjugate()).real
    size += (hx * hx.conjugate()).real
    grazing = incident_flux < 0.3 * size
    hint = q if grazing or medium_1[KIND] == ISOTROPIC else math.nan

    if medium_1[KIND] == ISOTROPIC:
        # Only the refracted waves are unknown: what they lack is an isotropic reflected wave
        medium_modes(medium_2, frame, xi, 1.0, math.nan, modes, 2, work, cwork[:, :, :4])
        n2 = medium_1[EPS_ORDINARY]
        z = q / n2
        t1, t2 = _cramer(
            modes[2, 0] + z * modes[2, 1],
            modes[3, 0] + z * modes[3, 1],
            modes[2, 3] + q * modes[2, 2],
            modes[3, 3] + q * modes[3, 2],
            ex + z * hy,
            q * ey - hx,
        )
        _store_isotropic(
            n2,
            complex(q, 0.0),
            -1.0,
            t1 * modes[2, 1] + t2 * modes[3, 1] - hy,
            t1 * modes[2, 2] + t2 * modes[3, 2] - ey,
            incident_flux,
            frame,
            xi,
            out,
            0,
        )
        if medium_2[KIND] == ISOTROPIC:
            _store_isotropic(
                medium_2[EPS_ORDINARY],
                modes[2, 5],
                1.0,
                t1 * modes[2, 1] + t2 * modes[3, 1],
                t1 * modes[2, 2] + t2 * modes[3, 2],
                incident_flux,
                frame,
                xi,
                out,
                2,
            )
        else:
            _store(modes, 2, t1, incident_flux, frame, xi, 2.0, out, 2)
            _store(modes, 3, t2, incident_flux, frame, xi, 3.0, out, 3)
    elif medium_2[KIND] == ISOTROPIC:
        # Only the reflected waves are unknown: with the incident one they make an isotropic wave
        medium_modes(medium_1, frame, xi, -1.0, hint, modes, 0, work, cwork[:, :, :4])
        n2 = medium_2[EPS_ORDINARY]
        square = n2 - xi * xi
        root = math.sqrt(abs(square))
        qt = complex(root, 0.0) if square >= 0.0 else complex(0.0, root)
        zt = qt / n2
        r1, r2 = _cramer(
            modes[0, 0] - zt * modes[0, 1],
            modes[1, 0] - zt * modes[1, 1],
            modes[0, 3] - qt * modes[0, 2],
            modes[1, 3] - qt * modes[1, 2],
            zt * hy - ex,
            qt * ey + hx,
        )
        _store(modes, 0, r1, incident_flux, frame, xi, 2.0, out, 0)
        _store(modes, 1, r2, incident_flux, frame, xi, 3.0, out, 1)
        _store_isotropic(
            n2,
            qt,
            1.0,
            hy + r1 * modes[0, 1] + r2 * modes[1, 1],
            ey + r1 * modes[0, 2] + r2 * modes[1, 2],
            incident_flux,
            frame,
            xi,
            out,
            2,
        )
    else:
        # Match the tangential fields of all waves
        medium_modes(medium_1, frame, xi, -1.0, hint, modes, 0, work, cwork[:, :, :4])
        medium_modes(medium_2, frame, xi, 1.0, math.nan, modes, 2, work, cwork[:, :, :4])
        matrix = cwork[1]
        for i in range(4):
            matrix[i, 0] = modes[2, i]
            matrix[i, 1] = modes[3, i]
            matrix[i, 2] = -modes[0, i]
            matrix[i, 3] = -modes[1, i]
        matrix[0, 4] = ex
        matrix[1, 4] = hy
        matrix[2, 4] = ey
        matrix[3, 4] = -hx
        _solve(matrix)
        for j in range(2):
            label = 2.0 + j
            _store(modes, j, matrix[2 + j, 4], incident_flux, frame, xi, label, out, j)
            _store(modes, 2 + j, matrix[j, 4], incident_flux, frame, xi, label, out, 2 + j)

    # At grazing incidence the products behind a flux are rounded to 1e-16 of the wave, not of its
    # flux through the interface; that rounding is spread over the shares
    total = out[0, 12] + out[1, 12] + out[2, 12] + out[3, 12]
    if grazing and abs(total - 1.0) < max(1e-6, 1e-8 * size / incident_flux):
        for j in range(4):
            out[j, 12] /= total
    return incident_flux


@kernel
def interface_batch(
    media: Array,
    first: Array,
    second: Array,
    refraction_vectors: Array,
    fields: Array,
    normals: Array,
    out: Array,
    flux: Array,
) -> None:
    """`interface_event` for a column of n waves.

    Parameters
    ----------
    media : (m, ROW) float64
    first, second : (n,) int, rows of ``media`` before and behind the interface
    refraction_vectors : (n, 3) float64
    fields : (n, 3) complex128
    normals : (n, 3) float64, unit, pointing into the second medium
    out : (n, 4, WAVE) float64
    flux : (n,) float64, incident flux through the interface
    """
    scratch = interface_scratch()
    for i in range(first.shape[0]):
        flux[i] = interface_event(
            media[first[i]],
            media[second[i]],
            refraction_vectors[i, 0],
            refraction_vectors[i, 1],
            refraction_vectors[i, 2],
            fields[i],
            normals[i, 0],
            normals[i, 1],
            normals[i, 2],
            out[i],
            scratch,
        )
