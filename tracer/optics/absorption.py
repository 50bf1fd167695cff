"""Absorption coefficients from internal transmittance.

The internal transmittance τ of a catalogue is what a plate of a reference thickness lets through
between its faces, reflections excluded: μ = -ln τ / thickness, and a path s keeps exp(-μ s).
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from tracer.optics.dispersion import OutOfRangeWarning

__all__ = ["absorption_from_transmittance", "extinction_index"]


def absorption_from_transmittance(
    wavelength_nm: ArrayLike,
    table_nm: ArrayLike,
    transmittance: ArrayLike,
    thickness: float,
    *,
    name: str = "",
) -> NDArray[np.float64]:
    """Absorption coefficient [1 / unit of ``thickness``].

    Parameters
    ----------
    wavelength_nm : (...) [nm]
    table_nm : (n,) wavelengths of the table [nm]
    transmittance : (n,) internal transmittance, 0 .. 1; 0 means opaque
    thickness : of the plate that the table speaks of
    name : of the medium, for messages

    Returns
    -------
    absorption : (...) ln τ is interpolated linearly in λ; infinite where a neighbouring entry is
        opaque. Outside the table its end values hold, with a warning.
    """
    table = np.asarray(table_nm, np.float64)
    tau = np.asarray(transmittance, np.float64)
    label = f"medium {name!r}: " if name else ""
    if table.ndim != 1 or table.size == 0 or table.shape != tau.shape:
        raise SceneError(f"{label}a transmittance table needs as many values as wavelengths")
    order = np.argsort(table, kind="stable")
    table, tau = table[order], tau[order]
    if not (np.all(np.isfinite(table)) and np.all(np.diff(table) > 0.0)):
        raise SceneError(f"{label}a wavelength stands twice in its transmittance table")
    if not np.all((tau >= 0.0) & (tau <= 1.0)):
        raise SceneError(f"{label}internal transmittance must lie between 0 and 1")
    if not (np.isfinite(thickness) and thickness > 0.0):
        raise SceneError(f"{label}the reference thickness must be positive, got {thickness:g}")
    wavelength = np.asarray(wavelength_nm, np.float64)
    outside = (wavelength < table[0]) | (wavelength > table[-1])
    if np.any(outside):
        example = np.atleast_1d(wavelength)[np.atleast_1d(outside)][0]
        warnings.warn(
            f"{label}absorption asked for at {example:g} nm, its data cover {table[0]:g} to "
            f"{table[-1]:g} nm; the end value is used",
            OutOfRangeWarning,
            stacklevel=2,
        )
    # Interpolate between transparent entries; next to an opaque one the medium is opaque
    opaque = tau == 0.0
    logarithm = np.log(np.where(opaque, 1.0, tau))
    values = -np.interp(wavelength, table, logarithm) / thickness
    near_opaque = np.interp(wavelength, table, opaque.astype(np.float64)) > 0.0
    return np.where(near_opaque, np.inf, np.abs(values))


def extinction_index(absorption_per_mm: ArrayLike, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Imaginary part κ of the index of a medium that absorbs: μ λ / 4π."""
    wavelength_mm = np.asarray(wavelength_nm, np.float64) * 1e-6
    return np.asarray(absorption_per_mm, np.float64) * wavelength_mm / (4.0 * np.pi)
