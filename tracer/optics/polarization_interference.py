"""Interference: light of one coherence id and wavelength adds as fields, all other as fluxes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import kernel
from tracer.optics.polarization_rays import PolarizationError, PolarizedRays

__all__ = ["coherent_flux", "interfere"]

Real = NDArray[np.float64]


def interfere(
    rays: PolarizedRays,
    point: ArrayLike = 0,
    *,
    n_points: int | None = None,
    coherence_length: float | None = None,
) -> Real:
    """Flux at points where rays meet.

    Parameters
    ----------
    rays : light at the points, with its optical paths
    point : (n,) number of the point where each ray arrives
    n_points : how many points there are; by default one more than the largest number
    coherence_length : l_c [mm]: pairs of rays interfere by exp(-(path difference / l_c)²); None for
        perfect coherence

    Returns
    -------
    (n_points,) float64
    """
    points = np.broadcast_to(np.asarray(point, np.int64), (len(rays),))
    total = int(points.max(initial=-1)) + 1 if n_points is None else n_points
    return coherent_flux(
        rays.field, rays.optical_path, rays.wavelengths, rays.coherence, points, total,
        coherence_length=coherence_length,
    )  # fmt: skip


def coherent_flux(
    field: ArrayLike,
    optical_path: ArrayLike,
    wavelength_nm: ArrayLike,
    coherence: ArrayLike,
    point: ArrayLike,
    n_points: int,
    *,
    coherence_length: float | None = None,
) -> Real:
    """`interfere` for plain columns: field (n, 3), all others (n,); paths in mm."""
    e = np.ascontiguousarray(field, np.complex128)
    path = np.ascontiguousarray(optical_path, np.float64)
    wavelength = np.ascontiguousarray(wavelength_nm, np.float64)
    ids, where = np.asarray(coherence, np.int64), np.asarray(point, np.int64)
    if coherence_length is not None and not coherence_length > 0.0:
        raise PolarizationError(
            f"coherence_length is {coherence_length:g}: it is a positive length, or None"
        )
    if len(where) and not (where.min() >= 0 and where.max() < n_points):
        raise PolarizationError(f"point: numbers must lie in 0 .. {n_points - 1}")
    order = np.lexsort((wavelength, ids, where))
    result = np.zeros(n_points)
    _sum_groups(
        e, path, wavelength, ids, where, order,
        0.0 if coherence_length is None else coherence_length, result,
    )  # fmt: skip
    return result


@kernel
def _sum_groups(
    field: NDArray[np.complex128], path: Real, wavelength: Real, ids: NDArray[np.int64],
    point: NDArray[np.int64], order: NDArray[np.int64], coherence_length: float, result: Real,
) -> None:  # fmt: skip
    """Add the flux of every group of mutually coherent rays to its point."""
    n = len(order)
    wave = np.empty((n, 3), np.complex128)
    start = 0
    while start < n:
        first = order[start]
        stop = start
        while (
            stop < n
            and point[order[stop]] == point[first]
            and ids[order[stop]] == ids[first]
            and wavelength[order[stop]] == wavelength[first]
        ):
            stop += 1
        # Take paths relative to the first ray of the group: phases keep their digits
        for k in range(start, stop):
            row = order[k]
            phase = 2.0 * math.pi * ((path[row] - path[first]) / (wavelength[row] * 1e-6))
            turn = complex(math.cos(phase), math.sin(phase))
            for axis in range(3):
                wave[k, axis] = field[row, axis] * turn
        flux = 0.0
        if coherence_length == 0.0:
            for axis in range(3):
                total = 0.0j
                for k in range(start, stop):
                    total += wave[k, axis]
                flux += total.real * total.real + total.imag * total.imag
        else:
            for k in range(start, stop):
                for m in range(start, stop):
                    away = (path[order[k]] - path[order[m]]) / coherence_length
                    share = math.exp(-away * away)
                    for axis in range(3):
                        flux += share * (wave[k, axis] * wave[m, axis].conjugate()).real
        result[point[first]] += flux
        start = stop
