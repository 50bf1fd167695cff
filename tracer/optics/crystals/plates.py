"""Plane-parallel crystal plates between isotropic media: retardation and Jones matrices.

The plate's normal is z. A plane wave is named by its tangential refraction vector (s_x, s_y) =
n sin(theta) (cos(phi), sin(phi)), the same in all layers. Waves inside run to and fro between the
two faces; the complete tree of their reflections is a geometric series of 2 x 2 matrices, which is
summed either level by level or at once.

Phase reference: the transmitted field at the exit face above the point of incidence (the phase
along the faces left out), the reflected one at the entry face.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import kernel
from raymap.model.errors import SceneError
from tracer.optics.crystals.interface import interface_scratch
from tracer.optics.crystals.interface_modes import interface_frame, medium_modes
from tracer.optics.crystals.media import Crystal
from tracer.optics.crystals.modes import MODE

__all__ = ["jones_bases", "outside_fields", "plate_jones", "plate_retardation", "plate_waves"]

Complex = NDArray[Any]
Array = np.ndarray[Any, np.dtype[Any]]


@kernel
def _plate_modes(row: Array, s_x: Array, s_y: Array, out: Array) -> None:
    work, cwork, modes, frame = interface_scratch()
    for i in range(s_x.shape[0]):
        xi = interface_frame(0.0, 0.0, 1.0, s_x[i], s_y[i], 0.0, frame)
        if xi == 0.0:
            frame[0, 0], frame[0, 1], frame[0, 2] = 1.0, 0.0, 0.0
            frame[1, 0], frame[1, 1], frame[1, 2] = 0.0, 1.0, 0.0
        medium_modes(row, frame, xi, 1.0, np.nan, modes, 0, work, cwork[:, :, :4])
        medium_modes(row, frame, xi, -1.0, np.nan, modes, 2, work, cwork[:, :, :4])
        for j in range(4):
            for c in range(MODE):
                out[i, j, c] = modes[j, c]


def plate_waves(medium: Crystal, s_x: ArrayLike, s_y: ArrayLike, wavelength_nm: float) -> Complex:
    """The four waves of a medium for given tangential refraction vectors.

    Returns
    -------
    (..., 4, 7) complex: forward ordinary (fast) and extraordinary (slow), the same backward; for
    each E_r, H_a, E_a, -H_r, E_z, q and 1 or 0 (travelling or evanescent), with r along
    (s_x, s_y) and a at 90 deg to it
    """
    x, y = np.broadcast_arrays(np.asarray(s_x, np.float64), np.asarray(s_y, np.float64))
    out = np.zeros((x.size, 4, MODE), np.complex128)
    _plate_modes(medium.row(wavelength_nm), x.ravel().copy(), y.ravel().copy(), out)
    return out.reshape(*x.shape, 4, MODE)


def plate_retardation(
    medium: Crystal, s_x: ArrayLike, s_y: ArrayLike, thickness: float, wavelength_nm: float
) -> NDArray[np.float64]:
    """Retardation of a plate, thickness times |q_slow - q_fast| [unit of ``thickness``].

    Exact for any direction and any birefringence; nan where a wave is evanescent.
    """
    waves = plate_waves(medium, s_x, s_y, wavelength_nm)
    travelling = (waves[..., 0, 6].real > 0.5) & (waves[..., 1, 6].real > 0.5)
    difference = np.abs(waves[..., 0, 5].real - waves[..., 1, 5].real)
    result: NDArray[np.float64] = np.where(travelling, thickness * difference, np.nan)
    return result


def outside_fields(n: float, xi: NDArray[np.float64], sign: float) -> Complex:
    """(..., 4, 2) tangential fields of unit waves polarised along theta and phi."""
    cosine = np.sqrt(1.0 - (xi / n) ** 2 + 0j)
    fields = np.zeros((*xi.shape, 4, 2), np.complex128)
    fields[..., 0, 0] = cosine
    fields[..., 1, 0] = sign * n
    fields[..., 2, 1] = 1.0
    fields[..., 3, 1] = sign * n * cosine
    return fields


def _solve(left: Complex, right: Complex) -> Complex:
    result: Complex = np.linalg.solve(left, right)
    return result


def jones_bases(transmission: Complex, reflection: Complex) -> tuple[Complex, Complex]:
    """Amplitudes along theta and phi as amplitudes along s and p."""
    order = np.array([[0.0, 1.0], [-1.0, 0.0]])
    mirrored = np.array([[0.0, 1.0], [1.0, 0.0]])
    return order @ transmission @ order.T, mirrored @ reflection @ order.T


def plate_jones(
    medium: Crystal,
    s_x: ArrayLike,
    s_y: ArrayLike,
    thickness_mm: float,
    wavelength_nm: float,
    *,
    n_before: float = 1.0,
    n_after: float = 1.0,
    basis: Literal["sp", "pupil"] = "sp",
    levels: int | None = None,
) -> tuple[Complex, Complex]:
    """Transmitted and reflected Jones matrices of a plate, all inner reflections included.

    Parameters
    ----------
    medium : of the plate, taken as lossless (`tracer.optics.crystals.absorbing` is exact)
    s_x, s_y : (...) tangential refraction vector, n_before times the direction's sines
    thickness_mm : of the plate
    n_before, n_after : indices of the isotropic media on both sides
    basis : "sp": amplitudes along s and p = d x s (s = d x n / |d x n|, n against the ray; at
        normal incidence s along y). "pupil": what a lens that makes all rays parallel to z would
        show, E_x and E_y in the plane of (s_x, s_y)
    levels : None sums the complete tree at once; a number sums that many passes through the plate
        (1 = straight through), as a ray tree truncated there does

    Returns
    -------
    transmission, reflection : (..., 2, 2) complex field amplitudes, [out, in]. Flux transmittance
        is |t|^2 times n_after cos(theta_after) / (n_before cos(theta_before))
    """
    if not thickness_mm > 0.0:
        raise SceneError(f"plate: thickness_mm is {thickness_mm:g}, it must be positive")
    x, y = np.broadcast_arrays(np.asarray(s_x, np.float64), np.asarray(s_y, np.float64))
    xi = np.hypot(x, y)
    if np.any(xi >= n_before):
        raise SceneError("plate: (s_x, s_y) must be shorter than n_before, the index outside")

    # Fields on both sides of both faces
    waves = plate_waves(medium, x, y, wavelength_nm)
    inside = np.swapaxes(waves[..., :4], -1, -2)
    forward, backward = inside[..., :2], inside[..., 2:]
    k0d = 2.0 * np.pi * thickness_mm * 1e6 / wavelength_nm
    down = np.exp(1j * k0d * waves[..., :2, 5])[..., :, None]
    up = np.exp(-1j * k0d * waves[..., 2:, 5])[..., :, None]
    incident = outside_fields(n_before, xi, 1.0)
    reflected = outside_fields(n_before, xi, -1.0)
    transmitted = outside_fields(n_after, xi, 1.0)

    # Enter, reflect inside at the back, reflect inside at the front
    entry = _solve(np.concatenate([forward, -reflected], -1), incident)
    back = _solve(np.concatenate([transmitted, -backward], -1), forward)
    front = _solve(np.concatenate([forward, -reflected], -1), -backward)
    t_in, r_out = entry[..., :2, :], entry[..., 2:, :]
    t_out, r_back = back[..., :2, :], back[..., 2:, :]
    r_front, t_up = front[..., :2, :], front[..., 2:, :]

    # Sum the passes
    round_trip = r_front @ (up * r_back) * np.swapaxes(down, -1, -2)
    if levels is None:
        start = _solve(np.eye(2) - round_trip, t_in)
    else:
        start = level = t_in
        for _ in range(levels - 1):
            level = round_trip @ level
            start = start + level
    arriving = down * start
    transmission = t_out @ arriving
    reflection = r_out + t_up @ (up * (r_back @ arriving))
    if basis == "sp":
        return jones_bases(transmission, reflection)

    # Turn the radial and azimuthal axes back to x and y
    radius = np.where(xi > 0.0, xi, 1.0)
    cosine = np.where(xi > 0.0, x / radius, 1.0)
    sine = np.where(xi > 0.0, y / radius, 0.0)
    turn = np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)
    turned_back = np.swapaxes(turn, -1, -2)
    return turn @ transmission @ turned_back, turn @ reflection @ turned_back
