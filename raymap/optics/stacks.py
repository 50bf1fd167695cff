"""Layers between two media, by characteristic matrices for s and p polarisation.

Unpolarised light takes the mean of both. Convention: exp(-i w t), n + i kappa.

References
----------
M. Born, E. Wolf, Principles of Optics, 7th ed., 1.6.2.
H. A. Macleod, Thin-Film Optical Filters, 4th ed., CRC Press (2010), ch. 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Layer", "stack_shares"]

F64 = NDArray[np.float64]
C128 = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """A layer of a stack.

    Attributes
    ----------
    index : (n_wavelengths,) complex refractive index n + i kappa
    thickness_nm : its thickness [nm]
    """

    index: C128
    thickness_nm: float


def stack_shares(
    n_i: ArrayLike,
    n_o: ArrayLike,
    layers: Sequence[Layer],
    wavelength_nm: ArrayLike,
    sine: ArrayLike,
) -> tuple[F64, F64]:
    """Reflectance and transmittance (shares of flux) of a stack for unpolarised light.

    Parameters
    ----------
    n_i, n_o : (n_wavelengths,) real indices on the incident side and beyond
    layers : in the order in which the light meets them
    wavelength_nm : (n_wavelengths,) vacuum wavelengths [nm]
    sine : (n_angles,) sines of the angle of incidence

    Returns
    -------
    R, T : (n_wavelengths, n_angles)
    """
    wavelength = np.asarray(wavelength_nm, np.float64)[:, None]
    entry = np.asarray(n_i, np.float64)[:, None]
    leave = np.asarray(n_o, np.float64)[:, None]
    tangential = entry * np.asarray(sine, np.float64)[None, :]
    reflected, transmitted = np.zeros(tangential.shape), np.zeros(tangential.shape)
    for polarisation in ("s", "p"):
        front = _admittance(entry, tangential, polarisation)
        back = _admittance(leave, tangential, polarisation)
        # Fields E and H at the back, carried through the layers to the front
        e: C128 = np.ones_like(back)
        h: C128 = back.copy()
        for layer in reversed(layers):
            n = np.asarray(layer.index, np.complex128)[:, None]
            normal = _root(n * n - tangential**2)
            delta = 2.0 * np.pi * normal * layer.thickness_nm / wavelength
            # Beyond this damping nothing gets through, and the numbers would overflow
            delta = delta.real + 1j * np.minimum(delta.imag, 300.0)
            admittance = normal if polarisation == "s" else n * n / normal
            cosine, sinus = np.cos(delta), np.sin(delta)
            e, h = (
                cosine * e - 1j * sinus / admittance * h,
                cosine * h - 1j * admittance * sinus * e,
            )
        reflected += 0.5 * np.abs((front * e - h) / (front * e + h)) ** 2
        flux = 4.0 * front.real * back.real / np.abs(front * e + h) ** 2
        transmitted += 0.5 * flux
    return reflected, transmitted


def _admittance(n: F64, tangential: F64, polarisation: str) -> C128:
    normal = _root((n * n - tangential**2).astype(np.complex128))
    # Grazing light: keep the limit finite
    normal = np.where(np.abs(normal) < 1e-12, 1e-12, normal)
    return np.asarray(normal if polarisation == "s" else n * n / normal)


def _root(square: C128) -> C128:
    """Root with a positive imaginary part: waves decay along their way."""
    root = np.sqrt(square)
    return np.where(root.imag < 0.0, -root, root)
