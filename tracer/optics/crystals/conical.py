"""Internal conical refraction: light whose wave normal is a binormal of a biaxial crystal.

On the binormal the two waves have the same index, every transverse D travels, and the rays of all
of them form a cone that holds the binormal.

References
----------
W. R. Hamilton, Trans. R. Irish Acad. 17, 1 (1837); H. Lloyd, ibid. 145; C. V. Raman, Curr. Sci.
11, 44 (1942); M. Born, E. Wolf, Principles of Optics, 7th ed., 15.3.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.model.errors import SceneError
from raymap.optics.frames import transverse_axes
from tracer.optics.crystals.media import Crystal

__all__ = ["ConicalRays", "cone_opening", "conical_rays", "ring_of_plate"]

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ConicalRays:
    """Rays of one wave on a binormal.

    Attributes
    ----------
    refraction_vector : (3,), n_y times the binormal
    direction : (n, 3), unit ray directions, evenly spread around the ring
    field : (n, 3), E of each, unit length
    weight : (n,), share of the flux inside the crystal, adds up to 1
    """

    refraction_vector: Real
    direction: Real
    field: Real
    weight: Real


def cone_opening(medium: Crystal, wavelength_nm: float) -> float:
    """Full opening chi of the cone [rad], tan(chi) = n_y^2 sqrt((x - y)(y - z)), x = 1/n_x^2 …"""
    x, y, z = (1.0 / np.sort(medium.principal_indices(wavelength_nm))) ** 2
    return math.atan(math.sqrt((x - y) * (y - z)) / y)


def conical_rays(
    medium: Crystal,
    binormal: ArrayLike,
    wavelength_nm: float,
    *,
    count: int = 256,
    polarisation: ArrayLike | None = None,
) -> ConicalRays:
    """The cone of rays of a wave along a binormal.

    Parameters
    ----------
    binormal : (3,) one of ``medium.binormals(wavelength_nm)`` or its opposite
    count : rays around the ring, at least 64
    polarisation : (3,) direction of a linearly polarised D; None = natural light

    Raises
    ------
    SceneError
        if the direction is not a binormal
    """
    if count < 64:
        raise SceneError(f"conical refraction: count is {count}; a ring needs 64 rays or more")
    k = np.asarray(binormal, np.float64)
    k = k / np.linalg.norm(k)
    if all(abs(abs(float(k @ b)) - 1.0) > 1e-12 for b in medium.binormals(wavelength_nm)):
        raise SceneError(f"conical refraction: the direction is not a binormal of {medium.name!r}")
    n_y = float(np.sort(medium.principal_indices(wavelength_nm))[1])

    # Turn D through half a circle; its ray goes once around the ring
    x, u = transverse_axes(k, [1.0, 0.0, 0.0] if abs(k[0]) < 0.7 else [0.0, 1.0, 0.0])
    v = -x
    azimuth = np.pi * (np.arange(count) + 0.5) / count
    d = np.cos(azimuth)[:, None] * u + np.sin(azimuth)[:, None] * v
    field = d @ np.linalg.inv(medium.tensor(wavelength_nm))
    field /= np.linalg.norm(field, axis=1, keepdims=True)
    flow = np.cross(field, np.cross(k, field))
    direction = flow / np.linalg.norm(flow, axis=1, keepdims=True)

    # Natural light feeds all of them alike, linear light by the square of its component
    weight = np.full(count, 1.0 / count)
    if polarisation is not None:
        given = np.asarray(polarisation, np.float64)
        given = given - (given @ k) * k
        if not np.linalg.norm(given) > 0.0:
            raise SceneError("conical refraction: polarisation must not lie along the binormal")
        weight = 2.0 * (d @ (given / np.linalg.norm(given))) ** 2 / count
    return ConicalRays(refraction_vector=n_y * k, direction=direction, field=field, weight=weight)


def ring_of_plate(
    medium: Crystal, binormal: ArrayLike, thickness: float, wavelength_nm: float
) -> tuple[Real, float]:
    """Centre (3,) and radius of the ring behind a plate cut across a binormal.

    A pencil enters at the origin along the normal. The centre lies towards the axis of the largest
    index, at one radius from the pencil, in the plane of the exit face.
    """
    k = np.asarray(binormal, np.float64)
    order = np.argsort(medium.principal_indices(wavelength_nm))
    slow = np.asarray(medium.orientation)[:, order[2]]
    towards = slow * np.sign(slow @ k) - abs(slow @ k) * k
    radius = 0.5 * thickness * math.tan(cone_opening(medium, wavelength_nm))
    centre: Real = thickness * k + radius * towards / np.linalg.norm(towards)
    return centre, radius
