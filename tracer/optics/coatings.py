"""Coatings of an interface: constant, tabulated, or computed from their layers.

A coating is compiled into one table per channel, of reflectance R and transmittance T on both
sides over the cosine on the *rarer* side of the interface (nothing bends sharply there), and of R
beyond the critical angle. What R + T leaves is absorbed. Bare interfaces use
`tracer.optics.fresnel`. Total reflection stays total unless layers absorb.

Layers are computed by characteristic matrices for s and p polarisation, of which unpolarised light
takes the mean. Convention: exp(-i w t), n + i kappa.

References
----------
M. Born, E. Wolf, Principles of Optics, 7th ed., 1.6.2.
H. A. Macleod, Thin-Film Optical Filters, 4th ed., CRC Press (2010), ch. 2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.model.errors import SceneError

__all__ = [
    "COATING_ANGLES",
    "Layer",
    "coating_share",
    "constant_coating",
    "layer_coating",
    "stack_shares",
    "tabulated_coating",
]

F64 = NDArray[np.float64]
C128 = NDArray[np.complex128]

COATING_ANGLES = 181
"""Nodes of a coating's table."""

_SIZE = 4 * COATING_ANGLES  # R from the rarer side, R from the denser side, T, R beyond critical


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


@lean_kernel
def coating_share(
    tables: F64, first: int, n_i: float, n_o: float, cos_i: float
) -> tuple[float, float]:
    """Reflectance and transmittance of a coated interface for unpolarised light.

    Parameters
    ----------
    tables, first : flat pool, and where the table of this coating and channel stands in it
    n_i, n_o : indices on the incident side and beyond
    cos_i : cosine of the angle of incidence

    Returns
    -------
    R, T : what they leave to 1 is absorbed
    """
    # From the rarer side the cosine is the table's own
    if n_i <= n_o:
        column, x = 0, cos_i
    else:
        ratio = n_i / n_o
        square = 1.0 - ratio * ratio * (1.0 - cos_i * cos_i)
        if square < 0.0:
            # Beyond the critical angle: from there (0) to grazing (1)
            critical = math.sqrt(max(0.0, 1.0 - 1.0 / (ratio * ratio)))
            x = 1.0 - cos_i / critical if critical > 0.0 else 1.0
            return _at(tables, first + 3 * COATING_ANGLES, x), 0.0
        column, x = 1, math.sqrt(square)
    reflected = _at(tables, first + column * COATING_ANGLES, x)
    return reflected, _at(tables, first + 2 * COATING_ANGLES, x)


@inner_kernel
def _at(tables: F64, first: int, x: float) -> float:
    place = min(1.0, max(0.0, x)) * (COATING_ANGLES - 1)
    low = min(COATING_ANGLES - 2, int(place))
    value = tables[first + low]
    return float(value + (place - low) * (tables[first + low + 1] - value))


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


def layer_coating(
    n_1: ArrayLike,
    n_2: ArrayLike,
    layers: Sequence[Layer],
    wavelengths_nm: ArrayLike,
    *,
    name: str = "",
) -> F64:
    """Tables of a stack of layers between two media, for the flat pool of tables.

    Parameters
    ----------
    n_1, n_2 : (n_channels,) real indices of both media
    layers : from medium 1 to medium 2
    wavelengths_nm : (n_channels,)
    name : of the surface, for messages

    Returns
    -------
    tables : (n_channels, size) one row per channel
    """
    wavelengths = np.atleast_1d(np.asarray(wavelengths_nm, np.float64))
    first, second = (np.broadcast_to(np.asarray(n, float), wavelengths.shape) for n in (n_1, n_2))
    for number, layer in enumerate(layers):
        if np.shape(layer.index) != wavelengths.shape:
            raise SceneError(
                f"surface {name!r}: layer {number + 1} needs its index at {len(wavelengths)} "
                f"wavelengths, got {np.shape(layer.index)}"
            )
        if np.any(np.imag(layer.index) < 0.0) or np.any(np.real(layer.index) <= 0.0):
            raise SceneError(
                f"surface {name!r}: layer {number + 1} has an index n + i k with n <= 0 or k < 0; "
                "absorption is a positive k"
            )
        if not (math.isfinite(layer.thickness_nm) and layer.thickness_nm >= 0.0):
            raise SceneError(f"surface {name!r}: layer {number + 1} has no sound thickness")
    table = np.zeros((len(wavelengths), _SIZE))
    x = np.linspace(0.0, 1.0, COATING_ANGLES)
    for channel, wavelength in enumerate(wavelengths):
        single = [
            Layer(index=np.asarray(layer.index)[[channel]], thickness_nm=layer.thickness_nm)
            for layer in layers
        ]
        turned = first[channel] > second[channel]
        rare, dense = sorted((first[channel], second[channel]))
        to_dense = single[::-1] if turned else single
        sine = np.sqrt(1.0 - x**2)
        at = [wavelength]
        r_rare, through = stack_shares([rare], [dense], to_dense, at, sine)
        r_dense, _ = stack_shares([dense], [rare], to_dense[::-1], at, sine * rare / dense)
        # Beyond the critical angle, as laid out in coating_share
        critical = math.sqrt(max(0.0, 1.0 - (rare / dense) ** 2))
        beyond = np.sqrt(1.0 - ((1.0 - x) * critical) ** 2)
        r_total, _ = stack_shares([dense], [rare], to_dense[::-1], at, beyond)
        parts = (r_rare[0], r_dense[0], through[0], r_total[0])
        table[channel] = np.clip(np.concatenate(parts), 0.0, 1.0)
    # What bends the table's straight lines above 1 is rounding
    a = COATING_ANGLES
    over = np.maximum(table[:, :a], table[:, a : 2 * a]) + table[:, 2 * a : 3 * a]
    table[:, 2 * a : 3 * a] -= np.maximum(0.0, over - 1.0)
    return table


def constant_coating(reflectance: ArrayLike, *, name: str = "") -> F64:
    """Tables of a coating that reflects the same share at all angles and absorbs nothing.

    Parameters
    ----------
    reflectance : (n_channels,)

    Returns
    -------
    tables : (n_channels, size); beyond the critical angle reflection is total
    """
    shares = np.atleast_1d(np.asarray(reflectance, np.float64))
    if not np.all((shares >= 0.0) & (shares <= 1.0)):
        raise SceneError(f"surface {name!r}: a coating's reflectance must lie between 0 and 1")
    table = np.ones((len(shares), _SIZE))
    table[:, : 2 * COATING_ANGLES] = shares[:, None]
    table[:, 2 * COATING_ANGLES : 3 * COATING_ANGLES] = 1.0 - shares[:, None]
    return table


def tabulated_coating(
    wavelengths_nm: ArrayLike,
    table_nm: ArrayLike,
    angle_deg: ArrayLike,
    reflectance: ArrayLike,
    transmittance: ArrayLike,
    *,
    name: str = "",
) -> F64:
    """Tables of a measured coating.

    Parameters
    ----------
    wavelengths_nm : (n_channels,) of the trace
    table_nm : (w,) wavelengths of the measurement, rising [nm]
    angle_deg : (a,) angles of incidence on the rarer side, rising, within 0 .. 90 [deg]
    reflectance, transmittance : (w, a) shares of flux; the rest is absorbed
    name : of the surface, for messages

    Returns
    -------
    tables : (n_channels, size). Both sides share R and T (at angles that Snell's law joins), as
        they do without absorption; beyond the critical angle reflection is total. Interpolation is
        linear; outside the angles the end values hold.

    Raises
    ------
    SceneError
        if R + T exceeds 1 somewhere, or the wavelengths do not cover the channels
    """
    channels = np.atleast_1d(np.asarray(wavelengths_nm, np.float64))
    wavelengths, angles = np.asarray(table_nm, np.float64), np.asarray(angle_deg, np.float64)
    r, t = np.asarray(reflectance, np.float64), np.asarray(transmittance, np.float64)
    shape = (wavelengths.size, angles.size)
    if r.shape != shape or t.shape != shape:
        raise SceneError(
            f"surface {name!r}: a coating table of {shape[0]} wavelengths and {shape[1]} angles "
            f"needs R and T of that shape, got {r.shape} and {t.shape}"
        )
    if np.any(np.diff(wavelengths) <= 0.0) or np.any(np.diff(angles) <= 0.0):
        raise SceneError(f"surface {name!r}: wavelengths and angles of a coating must rise")
    if angles[0] < 0.0 or angles[-1] > 90.0:
        raise SceneError(f"surface {name!r}: angles of a coating lie within 0 and 90 degrees")
    outside = (channels < wavelengths[0]) | (channels > wavelengths[-1])
    if np.any(outside):
        raise SceneError(
            f"surface {name!r}: its coating is given from {wavelengths[0]:g} to "
            f"{wavelengths[-1]:g} nm, the trace needs it at {channels[outside][0]:g} nm"
        )
    total = r + t
    if not (np.all(r >= 0.0) and np.all(t >= 0.0) and np.all(total <= 1.0 + 1e-9)):
        row, column = np.unravel_index(int(np.argmax(total)), shape)
        raise SceneError(
            f"surface {name!r}: its coating creates energy: R + T = {total[row, column]:.4g} at "
            f"{wavelengths[row]:g} nm and {angles[column]:g} degrees"
            if total.max() > 1.0
            else f"surface {name!r}: R and T of a coating must not be negative"
        )
    x_deg = np.degrees(np.arccos(np.linspace(0.0, 1.0, COATING_ANGLES)))
    table = np.ones((len(channels), _SIZE))
    for channel, wavelength in enumerate(channels):
        for values, columns in ((r, (0, 1)), (t, (2,))):
            over_angle = [
                np.interp(wavelength, wavelengths, values[:, k]) for k in range(angles.size)
            ]
            row_values = np.interp(x_deg, angles, over_angle)
            for part in columns:
                table[channel, part * COATING_ANGLES : (part + 1) * COATING_ANGLES] = row_values
    return table
