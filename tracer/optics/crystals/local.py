"""The local model for arrays: what happens where light meets the boundary of two media."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from raymap.optics.frames import transverse_axes
from tracer.optics.crystals.interface import WAVE, interface_batch
from tracer.optics.crystals.media import Crystal

__all__ = ["InterfaceWaves", "s_and_p", "solve_interface"]


@dataclass(frozen=True, kw_only=True)
class InterfaceWaves:
    """Outgoing waves of n events; axis 1: two reflected, then two refracted.

    In an isotropic medium the first of the two holds the whole ray and the second is empty; in a
    crystal they are the ordinary (or fast) and the extraordinary (or slow) ray.

    Attributes
    ----------
    refraction_vector : (n, 4, 3), N = wave normal times index (real part for evanescent waves)
    direction : (n, 4, 3), unit ray (energy) direction
    field : (n, 4, 3) complex, E with its amplitude, at the point of incidence
    share : (n, 4), flux over the incident flux; 0 for evanescent waves
    kind : (n, 4) int, 0 none or evanescent, 1 isotropic, 2 ordinary or fast, 3 extraordinary or
        slow
    incident_flux : (n,), 2 Re(E x H*) along the normal
    """

    refraction_vector: NDArray[np.float64]
    direction: NDArray[np.float64]
    field: NDArray[np.complex128]
    share: NDArray[np.float64]
    kind: NDArray[np.int64]
    incident_flux: NDArray[np.float64]

    @property
    def index(self) -> NDArray[np.float64]:
        """(n, 4) refractive index |N|, 0 for an empty place."""
        size: NDArray[np.float64] = np.linalg.norm(self.refraction_vector, axis=-1)
        return np.where(self.kind > 0, size, 0.0)

    @property
    def reflected(self) -> NDArray[np.float64]:
        """(n,) reflected share."""
        return np.asarray(self.share[:, 0] + self.share[:, 1])

    @property
    def refracted(self) -> NDArray[np.float64]:
        """(n,) refracted share."""
        return np.asarray(self.share[:, 2] + self.share[:, 3])


def s_and_p(
    direction: ArrayLike, normal: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors s and p of rays that meet a surface.

    s = d x n / |d x n| with n against the ray, p = d x s; at normal incidence some s across d.

    Parameters
    ----------
    direction, normal : (..., 3), unit; the normal on either side
    """
    d = np.atleast_2d(np.asarray(direction, np.float64))
    n = np.broadcast_to(np.asarray(normal, np.float64), d.shape)
    n = np.where(np.einsum("...i,...i", d, n)[..., None] > 0.0, -n, n)
    x, s = transverse_axes(d, n)
    return s, -x


def solve_interface(
    first: Crystal,
    second: Crystal,
    refraction_vector: ArrayLike,
    field: ArrayLike,
    normal: ArrayLike,
    *,
    wavelength_nm: float = 589.3,
) -> InterfaceWaves:
    """Reflected and refracted waves of n incident plane waves.

    Parameters
    ----------
    first, second : media before and behind the boundary
    refraction_vector : (n, 3), N of the incident waves (in an isotropic medium n times the
        direction); must belong to a wave of the first medium
    field : (n, 3) complex, E of the incident waves
    normal : (n, 3) or (3,), unit, pointing into the second medium

    Raises
    ------
    SceneError
        if an incident wave carries no energy towards the boundary
    """
    waves = np.atleast_2d(np.asarray(refraction_vector, np.float64))
    count = waves.shape[0]
    fields = np.ascontiguousarray(np.broadcast_to(np.asarray(field, np.complex128), waves.shape))
    normals = np.ascontiguousarray(np.broadcast_to(np.asarray(normal, np.float64), waves.shape))
    out = np.zeros((count, 4, WAVE))
    flux = np.zeros(count)
    interface_batch(
        np.array([first.row(wavelength_nm), second.row(wavelength_nm)]),
        np.zeros(count, np.int64),
        np.ones(count, np.int64),
        np.ascontiguousarray(waves),
        fields,
        normals,
        out,
        flux,
    )
    if not np.all(flux > 0.0):
        bad = int(np.argmin(flux > 0.0))
        raise SceneError(
            f"incident wave {bad} carries no energy towards the boundary of {first.name!r} and "
            f"{second.name!r}: the normal must point into {second.name!r} and the field must not "
            "vanish"
        )
    return _waves(out, flux)


def _waves(out: NDArray[Any], flux: NDArray[np.float64]) -> InterfaceWaves:
    kind = out[:, :, 15].astype(np.int64)
    return InterfaceWaves(
        refraction_vector=out[:, :, 0:3],
        direction=out[:, :, 3:6],
        field=out[:, :, 6:9] + 1j * out[:, :, 9:12],
        share=out[:, :, 12],
        kind=kind,
        incident_flux=flux,
    )
