"""The cone K: directions from a point whose whole tree in a lens never meets the rim.

For a point on the axis K is a set of angles, found by a scan and a bisection of every boundary; it
need not be one interval. For any point K is a mask over the entrance aperture, with the largest
round cone about the direction to the front vertex that lies inside.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.optics.frames import transverse_axes
from tracer.lens import Lens, LensError, trace_lens
from tracer.lens.shape import RIM
from tracer.optics.polarization_rays import PolarizedRays

__all__ = ["AxialCone", "MaskedCone", "axial_cone", "inside_cone", "masked_cone"]

Real = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STEPS = 60
"""Halvings of a boundary: 60 of them reach the last bit of any angle."""


@dataclass(frozen=True, kw_only=True)
class AxialCone:
    """K of a point on the axis.

    Attributes
    ----------
    intervals : angles from the axis [rad] that belong to K, rising, each (from, to)
    depth : of the trees
    """

    intervals: tuple[tuple[float, float], ...]
    depth: int

    @property
    def half_angle(self) -> float:
        """Half-angle of the cone around the axis [rad], 0 if the axis itself is not in K."""
        if self.intervals and self.intervals[0][0] == 0.0:
            return self.intervals[0][1]
        return 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class MaskedCone:
    """K of any point, over the entrance aperture.

    Attributes
    ----------
    x, y : (n,) coordinates in the plane of the front cap's edge [mm], lens axes
    mask : (n, n) whether the direction to (x[j], y[i]) belongs to K
    half_angle : of the largest round cone inside K about the direction to the front vertex [rad]
    depth : of the trees
    """

    x: Real
    y: Real
    mask: Mask
    half_angle: float
    depth: int


def inside_cone(
    lens: Lens, point: ArrayLike, direction: ArrayLike, *, depth: int, wavelength_nm: float
) -> Mask:
    """(n,) whether directions (n, 3) from a point belong to K."""
    d = np.atleast_2d(np.asarray(direction, np.float64))
    x, _ = transverse_axes(d)
    rays = PolarizedRays.from_field(point, d, x, wavelength_nm=wavelength_nm)
    tree = trace_lens(lens, rays, depth=depth, mode="scalar")
    return np.asarray(~tree.missed & ~np.any(tree.face == RIM, axis=1))


def axial_cone(
    lens: Lens, distance: float, *, depth: int, wavelength_nm: float, scan: int = 2000
) -> AxialCone:
    """K of a point on the axis, ``distance`` in front of the front vertex [mm].

    ``scan`` angles are tried between 0 and 90°: parts of K narrower than their spacing are missed.
    """
    x, _, z, place = lens.frame
    point = place - distance * z
    if not distance > 0.0 or not math.isfinite(distance):
        raise LensError(f"distance is {distance:g}: the point stands in front of the lens")

    def belongs(angle: Real) -> Mask:
        d = np.sin(angle)[:, np.newaxis] * x + np.cos(angle)[:, np.newaxis] * z
        return inside_cone(lens, point, d, depth=depth, wavelength_nm=wavelength_nm)

    angles = np.linspace(0.0, 0.5 * math.pi, scan, endpoint=False)
    inside = belongs(angles)
    change = np.flatnonzero(inside[1:] != inside[:-1])
    edges = _bisect(belongs, angles[change], angles[change + 1])
    bounds = ([0.0] if inside[0] else []) + edges.tolist() + ([angles[-1]] if inside[-1] else [])
    pairs = tuple(zip(bounds[0::2], bounds[1::2], strict=True))
    return AxialCone(intervals=pairs, depth=depth)


def masked_cone(
    lens: Lens, point: ArrayLike, *, depth: int, wavelength_nm: float, n: int = 101,
    azimuths: int = 180,
) -> MaskedCone:  # fmt: skip
    """K of any point in front of the lens, on a grid of n x n directions over the aperture."""
    start = np.asarray(point, np.float64)
    ax, ay, az, place = lens.frame
    if not float((start - place) @ az) < 0.0:
        raise LensError("point must stand in front of the lens")
    side = np.linspace(-1.0, 1.0, n) * lens.semi_aperture_front
    gx, gy = np.meshgrid(side, side)
    edge = place + lens.shape.edge_front * az
    target = edge + gx[..., np.newaxis] * ax + gy[..., np.newaxis] * ay
    d = (target - start).reshape(-1, 3)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    mask = inside_cone(lens, start, d, depth=depth, wavelength_nm=wavelength_nm).reshape(n, n)

    # The round cone reaches to the nearest boundary over all azimuths
    chief = (place - start) / np.linalg.norm(place - start)
    u, v = transverse_axes(chief, ax)
    turn = np.linspace(0.0, 2.0 * math.pi, azimuths, endpoint=False)
    radial = np.cos(turn)[:, np.newaxis] * u + np.sin(turn)[:, np.newaxis] * v

    def belongs(angle: Real) -> Mask:
        tilted = np.cos(angle)[:, np.newaxis] * chief + np.sin(angle)[:, np.newaxis] * radial
        return inside_cone(lens, start, tilted, depth=depth, wavelength_nm=wavelength_nm)

    low, high = np.zeros(azimuths), np.zeros(azimuths)
    alive = belongs(low)
    for angle in np.linspace(0.0, 0.5 * math.pi, 400, endpoint=False)[1:]:
        still = alive & belongs(np.full(azimuths, angle))
        high = np.where(alive & ~still, angle, high)
        low = np.where(still, angle, low)
        alive = still
        if not alive.any():
            break
    half = float(_bisect(belongs, low, high).min()) if high.all() else 0.0
    return MaskedCone(x=side, y=side, mask=mask, half_angle=half, depth=depth)


def _bisect(belongs: Callable[[Real], Mask], low: Real, high: Real) -> Real:
    """Angles where membership changes between each low and high; exact to rounding."""
    if len(low) == 0:
        return np.zeros(0)
    a, b = low.copy(), high.copy()
    first = belongs(a)
    for _ in range(_STEPS):
        middle = 0.5 * (a + b)
        same = belongs(middle) == first
        a = np.where(same, middle, a)
        b = np.where(same, b, middle)
    return a
