"""Beams that fill the front of a lens evenly."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.optics.frames import transverse_axes
from tracer.lens import Lens, LensError
from tracer.optics.polarization_rays import PolarizedRays

__all__ = ["aperture_points", "parallel_beam", "point_beam", "sunflower"]

Real = NDArray[np.float64]


def sunflower(n: int) -> Real:
    """(n, 2) points that cover the unit disc evenly (Vogel's spiral)."""
    if n < 1:
        raise LensError(f"rays is {n}: a beam needs at least one ray")
    number = np.arange(n) + 0.5
    radius = np.sqrt(number / n)
    angle = number * (math.pi * (3.0 - math.sqrt(5.0)))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def aperture_points(lens: Lens, n: int) -> Real:
    """(n, 3) points in the plane of the front cap's edge, even over its clear aperture."""
    disc = sunflower(n) * lens.semi_aperture_front
    x, y, z, place = lens.frame
    edge = place + lens.shape.edge_front * z
    return np.asarray(edge + disc[:, :1] * x + disc[:, 1:] * y)


def parallel_beam(
    lens: Lens,
    n: int,
    *,
    wavelength_nm: float,
    field_deg: float = 0.0,
    vibration: ArrayLike = (1.0, 0.0, 0.0),
) -> PolarizedRays:
    """A beam from infinity, tilted from the axis towards the lens's x, of flux 1 in all."""
    x, _, z, _ = lens.frame
    angle = math.radians(field_deg)
    d = math.sin(angle) * x + math.cos(angle) * z
    across, _ = transverse_axes(d, vibration)
    far = 2.0 * (lens.semi_aperture_front + lens.thickness)
    return PolarizedRays.linear(
        aperture_points(lens, n) - far * d, d, across, wavelength_nm=wavelength_nm, flux=1.0 / n
    )


def point_beam(
    lens: Lens,
    point: ArrayLike,
    n: int,
    *,
    wavelength_nm: float,
    vibration: ArrayLike = (1.0, 0.0, 0.0),
) -> PolarizedRays:
    """Rays from a point to the clear aperture, even over the aperture, of flux 1 in all."""
    start = np.asarray(point, np.float64)
    d = aperture_points(lens, n) - start
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    across, _ = transverse_axes(d, vibration)
    return PolarizedRays.linear(start, d, across, wavelength_nm=wavelength_nm, flux=1.0 / n)
