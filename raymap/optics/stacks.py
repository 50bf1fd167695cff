"""Layers between two media, by characteristic matrices for s and p polarisation.

Unpolarised light takes the mean of both. Convention: exp(-i w t), n + i kappa.

References
----------
M. Born, E. Wolf, Principles of Optics, 7th ed., 1.6.2.
H. A. Macleod, Thin-Film Optical Filters, 4th ed., CRC Press (2010), ch. 2.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import inner_kernel, kernel, lean_kernel

__all__ = ["Layer", "layer_numbers", "stack_amplitudes", "stack_shares"]

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
    wavelength = np.atleast_1d(np.asarray(wavelength_nm, np.float64))
    entry, leave = (np.broadcast_to(np.asarray(n, float), wavelength.shape) for n in (n_i, n_o))
    sines = np.asarray(sine, np.float64)
    reflected, transmitted = np.empty((2, len(wavelength), len(sines)))
    for row, nm in enumerate(wavelength):
        flat = np.array([layer_numbers(layer, row, float(nm)) for layer in layers]).ravel()
        _fill_shares(
            float(entry[row]), float(leave[row]), flat, sines, reflected[row], transmitted[row]
        )
    return reflected, transmitted


def layer_numbers(layer: Layer, channel: int, wavelength_nm: float) -> tuple[float, float, float]:
    """n, k and 2 pi thickness / wavelength of a layer in a channel, for `stack_amplitudes`."""
    index = complex(np.asarray(layer.index)[channel])
    return index.real, index.imag, 2.0 * math.pi * layer.thickness_nm / wavelength_nm


@kernel
def stack_amplitudes(
    n_i: float, n_o: float, sine: float, layers: F64, first: int, count: int, step: int
) -> tuple[complex, complex, complex, complex]:
    """Amplitudes r_s, r_p, t_s, t_p of a stack, as roots of shares of flux.

    Signs and phases as of `raymap.optics.fresnel.fresnel_amplitudes`, which this is without layers,
    but for transmission, whose squared modulus is the share of flux. Phases are those at the two
    outer faces; t_s = t_p = 0 where nothing can leave.

    Parameters
    ----------
    n_i, n_o : real indices on the incident side and beyond
    sine : of the angle of incidence
    layers : flat; of each layer n, k and 2 pi thickness / wavelength
    first, count, step : where the first layer that the light meets stands, how many there are, and
        the step to the next one: 3, or -3 where they are met in reverse
    """
    tangential = n_i * sine
    front_normal = _normal_part(complex(n_i), tangential)
    back_normal = _normal_part(complex(n_o), tangential)
    found_r, found_t = (0j, 0j), (0j, 0j)
    for polarisation in range(2):
        front, back = front_normal, back_normal
        if polarisation == 1:
            front, back = n_i * n_i / front_normal, n_o * n_o / back_normal
        # Fields E and H at the back, carried through the layers to the front
        e, h = 1.0 + 0j, back
        for j in range(count - 1, -1, -1):
            row = first + j * step
            n = complex(layers[row], layers[row + 1])
            normal = _normal_part(n, tangential)
            delta = normal * layers[row + 2]
            # Beyond this damping nothing gets through, and the numbers would overflow
            delta = complex(delta.real, min(delta.imag, 300.0))
            admittance = normal if polarisation == 0 else n * n / normal
            cosine, sinus = cmath.cos(delta), cmath.sin(delta)
            e, h = (
                cosine * e - 1j * sinus / admittance * h,
                cosine * h - 1j * admittance * sinus * e,
            )
        below = front * e + h
        r = (front * e - h) / below
        flux = front.real * back.real
        t = 2.0 * math.sqrt(flux) / below if flux > 0.0 else 0j
        if polarisation == 0:
            found_r, found_t = (r, r), (t, t)
        else:
            # Fields along the surface have the other sign of r_p
            found_r, found_t = (found_r[0], -r), (found_t[0], t)
    return found_r[0], found_r[1], found_t[0], found_t[1]


@inner_kernel
def _normal_part(n: complex, tangential: float) -> complex:
    """Part of n times the direction across the layers; its imaginary part makes waves decay."""
    root = cmath.sqrt(n * n - tangential * tangential)
    if root.imag < 0.0:
        root = -root
    # Grazing light: keep the limit finite
    return root if abs(root) >= 1e-12 else complex(1e-12)


@lean_kernel
def _fill_shares(
    n_i: float, n_o: float, layers: F64, sines: F64, reflected: F64, transmitted: F64
) -> None:
    """Shares of natural light at the angles."""
    for i in range(len(sines)):
        r_s, r_p, t_s, t_p = stack_amplitudes(n_i, n_o, sines[i], layers, 0, len(layers) // 3, 3)
        reflected[i] = 0.5 * (abs(r_s) ** 2 + abs(r_p) ** 2)
        transmitted[i] = 0.5 * (abs(t_s) ** 2 + abs(t_p) ** 2)
