"""Waves of a crystal for a given wave normal or ray direction, and their absorption.

An interface hands out waves by their tangential wave vector; a source or a camera inside a crystal
needs them by direction.

References
----------
M. Born, E. Wolf, Principles of Optics, 7th ed., 15.2 (wave and ray surfaces), 15.6 (absorption).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import inner_kernel
from raymap.optics.frames import transverse_axes
from tracer.optics.crystals.media import Crystal
from tracer.optics.crystals.rows import EPS_ABSORPTION

__all__ = ["CrystalWaves", "absorption_coefficient", "ray_absorption", "waves_along"]

Array = np.ndarray[Any, np.dtype[Any]]
Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CrystalWaves:
    """Two waves for each direction: fast, then slow.

    Attributes
    ----------
    refraction_vector : (n, 2, 3), N = wave normal times index
    direction : (n, 2, 3), unit ray direction
    field : (n, 2, 3), real E of unit length
    index : (n, 2), |N|
    """

    refraction_vector: Real
    direction: Real
    field: Real

    @property
    def index(self) -> Real:
        size: Real = np.linalg.norm(self.refraction_vector, axis=-1)
        return size


def _transverse(unit: Real) -> Real:
    """(n, 3, 2) orthonormal pair across each unit vector."""
    helper = np.where(np.abs(unit[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    x, y = transverse_axes(unit, helper)
    return np.stack([y, -x], axis=-1)


def waves_along(
    medium: Crystal, unit: ArrayLike, wavelength_nm: float, *, ray: bool = False
) -> CrystalWaves:
    """The two waves with given wave normals, or with given ray directions.

    On a binormal (with ``ray`` on a biradial) any polarisation travels; two orthogonal ones are
    returned.

    Parameters
    ----------
    unit : (n, 3) unit vectors
    ray : they are ray directions rather than wave normals
    """
    k = np.atleast_2d(np.asarray(unit, np.float64))
    eps = medium.tensor(wavelength_nm)
    plane = _transverse(k)
    if not ray:
        # Diagonalise the impermeability across the wave normal: 1/n^2 and D
        eta = np.linalg.inv(eps)
        values, vectors = np.linalg.eigh(np.swapaxes(plane, 1, 2) @ eta @ plane)
        order = [1, 0]
        d = np.swapaxes(plane @ vectors, 1, 2)[:, order]
        n = 1.0 / np.sqrt(values[:, order])
        field = d @ eta
        big_n = n[..., None] * k[:, None, :]
    else:
        # Diagonalise the permittivity across the ray: n_r^2 and E
        values, vectors = np.linalg.eigh(np.swapaxes(plane, 1, 2) @ eps @ plane)
        field = np.swapaxes(plane @ vectors, 1, 2)
        d = field @ eps
        along = np.einsum("nki,ni->nk", d, k)
        normal = k[:, None, :] - d * (along / np.einsum("nki,nki->nk", d, d))[..., None]
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        cosine = np.einsum("nki,ni->nk", normal, k)
        big_n = normal * (np.sqrt(values) / cosine)[..., None]
    field = field / np.linalg.norm(field, axis=-1, keepdims=True)
    flow = np.cross(field, np.cross(big_n, field))
    direction = flow / np.linalg.norm(flow, axis=-1, keepdims=True)
    return CrystalWaves(refraction_vector=big_n, direction=direction, field=field)


@inner_kernel
def ray_absorption(
    row: Array, px: float, py: float, pz: float, ex: complex, ey: complex, ez: complex
) -> float:
    """E^H eps'' E / |Re(E x H*)| of a wave with refraction vector p: decay in units of k0."""
    i = EPS_ABSORPTION
    loss: float = (
        row[i] * (ex * ex.conjugate()).real
        + row[i + 1] * (ey * ey.conjugate()).real
        + row[i + 2] * (ez * ez.conjugate()).real
        + 2.0 * row[i + 3] * (ex * ey.conjugate()).real
        + 2.0 * row[i + 4] * (ex * ez.conjugate()).real
        + 2.0 * row[i + 5] * (ey * ez.conjugate()).real
    )
    if loss <= 0.0:
        return 0.0
    hx = py * ez - pz * ey
    hy = pz * ex - px * ez
    hz = px * ey - py * ex
    sx = (ey * hz.conjugate() - ez * hy.conjugate()).real
    sy = (ez * hx.conjugate() - ex * hz.conjugate()).real
    sz = (ex * hy.conjugate() - ey * hx.conjugate()).real
    size: float = np.sqrt(sx * sx + sy * sy + sz * sz)
    return loss / size


def absorption_coefficient(
    medium: Crystal, refraction_vector: ArrayLike, field: ArrayLike, wavelength_nm: float
) -> Real:
    """Absorption per mm along the ray, for waves of a weakly absorbing crystal.

    alpha = k0 E^H eps'' E / |Re(E x H*)|; the flux falls as exp(-alpha L). For a wave polarised
    along a principal axis this is 4 pi kappa / lambda.

    Parameters
    ----------
    refraction_vector, field : (..., 3)
    """
    big_n = np.asarray(refraction_vector, np.float64)
    e = np.asarray(field, np.complex128)
    loss = np.einsum("...i,ij,...j", e.conj(), medium.absorption_tensor(wavelength_nm), e).real
    flow = np.cross(e, np.cross(big_n, e).conj()).real
    k0 = 2.0 * np.pi / (wavelength_nm * 1e-6)
    result: Real = k0 * loss / np.linalg.norm(flow, axis=-1)
    return result
