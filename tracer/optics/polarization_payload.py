"""The published payload of a linearly polarised ray: ⟨wavelength, I, v_p, k_phi, O_p, ch⟩.

A payload row stands for the field sqrt(I) v_p exp(-i pi k_phi) exp(i phase): v_p is a real unit
vector, k_phi counts half-wave jumps. The pairs (v_p, k_phi) and (-v_p, k_phi ± 1) are one state,
so states are compared by their fields or coherency matrices, never by v_p. The published payload
has no ``phase``: after a total internal reflection the phase is no multiple of pi, and light that
was neither s nor p is elliptical. Such a ray becomes two coherent rows along the axes of its
ellipse, with one group number. That is exact, for sums of intensities and for coherent sums.

References
----------
V. A. Debelov, D. S. Kushner, a lens module for linearly polarised light (2017).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracer.optics.polarization_rays import PolarizedRays, require_transverse

__all__ = ["LinearPayload", "from_payload", "to_payload"]

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearPayload:
    """Rows of linearly polarised light.

    Attributes
    ----------
    ray : (m,) int64, the ray that the row belongs to
    wavelength_nm : (m,)
    intensity : (m,) flux
    vibration : (m, 3) unit vectors v_p
    half_waves : (m,) int64, k_phi
    phase : (m,) [rad] beyond the half waves; 0 for light that met no total reflection
    optical_path : (m,) [mm]
    channel : (m,) int64, ch: the coherence id
    group : (m,) int64, -1, or a number that the two rows of an elliptical ray share
    """

    ray: NDArray[np.int64]
    wavelength_nm: Real
    intensity: Real
    vibration: Real
    half_waves: NDArray[np.int64]
    phase: Real
    optical_path: Real
    channel: NDArray[np.int64]
    group: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ray)

    @property
    def field(self) -> NDArray[np.complex128]:
        """(m, 3) complex fields without the phase of the path."""
        amplitude = np.sqrt(self.intensity) * np.exp(1j * (self.phase - np.pi * self.half_waves))
        return np.asarray(amplitude[:, np.newaxis] * self.vibration, np.complex128)


def to_payload(
    rays: PolarizedRays, half_waves: ArrayLike | None = None, *, tolerance: float = 1e-9
) -> LinearPayload:
    """Rows of linearly polarised light that are together the light of some rays.

    Parameters
    ----------
    rays : any fully polarised light
    half_waves : (n,) k_phi that a lens counted; it fixes the sign of v_p. Without it k_phi is
        0 or 1
    tolerance : largest minor axis, as a share of the field, that still counts as linear
    """
    n = len(rays)
    flux = rays.flux
    size = np.sqrt(np.where(flux > 0.0, flux, 1.0))
    unit = rays.field / size[:, np.newaxis]
    # Turn the phase until the real part is the major axis and the imaginary part the minor one
    alpha = 0.5 * np.angle(np.sum(unit * unit, axis=1))
    turned = unit * np.exp(-1j * alpha)[:, np.newaxis]
    major, minor = turned.real, turned.imag
    minor_length = np.linalg.norm(minor, axis=1)
    elliptical = minor_length > tolerance

    # Put whole half waves into k_phi: those counted, else the smallest number
    nearest = np.rint(alpha / np.pi)
    whole = np.abs(alpha - np.pi * nearest) < tolerance
    phase = np.where(whole, 0.0, alpha)
    own = np.where(whole, np.abs(nearest), 0.0).astype(np.int64)
    counted = own if half_waves is None else np.asarray(half_waves, np.int64)
    sign = np.where((counted - own) % 2 == 0, 1.0, -1.0)
    length = np.linalg.norm(major, axis=1)
    length = np.where(length > 0.0, length, 1.0)
    first = major * (sign / length)[:, np.newaxis]

    rows = np.concatenate([np.arange(n), np.flatnonzero(elliptical)])
    which = np.concatenate([np.zeros(n, np.int64), np.ones(int(elliptical.sum()), np.int64)])
    order = np.lexsort((which, rows))
    rows, which = rows[order], which[order]
    is_minor = which == 1
    small = np.where(minor_length > 0.0, minor_length, 1.0)
    second = minor * (sign / small)[:, np.newaxis]
    share = np.where(elliptical, length**2, 1.0)
    return LinearPayload(
        ray=rows.astype(np.int64),
        wavelength_nm=rays.wavelengths[rows],
        intensity=flux[rows] * np.where(is_minor, (minor_length**2)[rows], share[rows]),
        vibration=np.where(is_minor[:, np.newaxis], second[rows], first[rows]),
        half_waves=counted[rows],
        phase=phase[rows] + np.where(is_minor, 0.5 * np.pi, 0.0),
        optical_path=rays.optical_path[rows],
        channel=rays.coherence[rows],
        group=np.where(elliptical[rows], rows, rays.group[rows]),
    )


def from_payload(payload: LinearPayload, origin: ArrayLike, direction: ArrayLike) -> PolarizedRays:
    """Rays of payload rows; origins and directions are given per ray that the rows belong to.

    Raises
    ------
    PolarizationError
        a vibration v_p that is not perpendicular to its ray
    """
    places = np.atleast_2d(np.asarray(origin, np.float64))[payload.ray]
    directions = np.atleast_2d(np.asarray(direction, np.float64))[payload.ray]
    require_transverse(payload.vibration, directions)
    return PolarizedRays.from_field(
        places,
        directions,
        payload.field,
        wavelength_nm=payload.wavelength_nm,
        optical_path=payload.optical_path,
        coherence=payload.channel,
        group=payload.group,
    )
