"""Rays through the surfaces of a prescription in their order, exact and paraxial.

What a design program computes from its rays (pupils, chief rays, clear apertures) is computed here
again, so that a file that leaves them out can still be built.

References
----------
W. T. Welford, Aberrations of Optical Systems (1986), sections 3 (paraxial) and 4 (finite rays).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tracer.importers.prescription import LensSurface, Prescription

__all__ = ["Sequence", "ThroughRays"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class ThroughRays:
    """Rays at every surface.

    Attributes
    ----------
    points : (n_surfaces, n_rays, 3) in the unit of the file; nan where a ray does not get through;
        row 0 is where the rays started
    directions : (n_surfaces, n_rays, 3) behind each surface
    """

    points: Array
    directions: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Sequence:
    """A prescription with the indices of its glasses.

    Attributes
    ----------
    prescription : its surfaces
    indices : (n_surfaces, n_wavelengths) of what follows each surface, positive also after mirrors
    """

    prescription: Prescription
    indices: Array

    @property
    def surfaces(self) -> tuple[LensSurface, ...]:
        return self.prescription.surfaces

    @cached_property
    def z(self) -> Array:
        """(n_surfaces,) vertices along the axis, the first surface at 0."""
        places = np.zeros(len(self.surfaces))
        for k in range(2, len(places)):
            places[k] = places[k - 1] + self.surfaces[k - 1].thickness
        places[0] = -self.surfaces[0].thickness
        return places

    @property
    def finite(self) -> bool:
        """Whether the object is at a finite distance."""
        return bool(np.isfinite(self.z[0]))

    # -- paraxial --------------------------------------------------------------------------------

    def paraxial(
        self, y: float, slope: float, channel: int, *, last: int | None = None
    ) -> tuple[Array, Array]:
        """Heights at the surfaces, and n u behind them, of a ray at height ``y`` on surface 1.

        ``slope`` is that of the ray before surface 1. After a mirror n counts negative.
        """
        n = self.indices[:, channel]
        sign = 1.0
        heights, optical = np.zeros(len(self.surfaces)), np.zeros(len(self.surfaces))
        before = n[0]
        optical[0], heights[0] = before * slope, y
        nu = before * slope
        for k in range(1, len(self.surfaces) if last is None else last + 1):
            surface = self.surfaces[k]
            if k > 1:
                y += nu / before * (self.z[k] - self.z[k - 1])
            if surface.mirror:
                sign = -sign
                after = -before
            else:
                after = sign * n[k]
            nu -= y * surface.curvature * (after - before)
            heights[k], optical[k], before = y, nu, after
        return heights, optical

    def focal_length(self, channel: int) -> float:
        """Effective focal length; inf where the lens has no power."""
        _, optical = self.paraxial(1.0, 0.0, channel, last=len(self.surfaces) - 2)
        nu = optical[-2]
        return float(-1.0 / nu) if nu != 0.0 else float("inf")

    def stop_matrix(self, channel: int) -> tuple[float, float]:
        """(A, B): height at the stop = A y + B u of a ray at height y, slope u on surface 1."""
        stop = self.prescription.stop
        a, _ = self.paraxial(1.0, 0.0, channel, last=stop)
        b, _ = self.paraxial(0.0, 1.0, channel, last=stop)
        return float(a[stop]), float(b[stop])

    # -- exact -----------------------------------------------------------------------------------

    def trace(
        self, origins: ArrayLike, directions: ArrayLike, channel: int, *, last: int | None = None
    ) -> ThroughRays:
        """Trace rays from anywhere before surface 1 to the image.

        Parameters
        ----------
        origins, directions : (n, 3); directions of length 1
        channel : index of the wavelength
        last : index of the surface to end at, the image by default
        """
        p = np.array(origins, float).reshape(-1, 3)
        d = np.array(directions, float).reshape(-1, 3)
        points, along = [p.copy()], [d.copy()]
        before = self.indices[0, channel]
        with np.errstate(invalid="ignore", divide="ignore"):
            for k in range(1, len(self.surfaces) if last is None else last + 1):
                surface = self.surfaces[k]
                vertex = np.array([0.0, 0.0, self.z[k]])
                p, normal = _meet(surface, p - vertex, d)
                after = before if surface.mirror else self.indices[k, channel]
                if surface.mirror:
                    d = d - 2.0 * np.sum(d * normal, axis=1)[:, None] * normal
                elif after != before:
                    d = _refract(d, normal, before / after)
                p = p + vertex
                points.append(p.copy())
                along.append(d.copy())
                before = after
        return ThroughRays(points=np.array(points), directions=np.array(along))


def _meet(surface: LensSurface, p: Array, d: Array) -> tuple[Array, Array]:
    """Points on a surface with its vertex at the origin, and unit normals there."""
    # Go to the tangent plane, then to the root of the conic that lies next to it
    p = p - (p[:, 2] / d[:, 2])[:, None] * d
    c, k = surface.curvature, surface.conic
    a = c * (1.0 + k * d[:, 2] ** 2)
    b = c * (np.sum(p * d, axis=1) + k * p[:, 2] * d[:, 2]) - d[:, 2]
    e = c * (np.sum(p * p, axis=1) + k * p[:, 2] ** 2) - 2.0 * p[:, 2]
    t = e / (-b + np.sign(d[:, 2]) * np.sqrt(b * b - a * e))
    p = p + t[:, None] * d
    # Newton's steps to the asphere
    for _ in range(30 if any(surface.aspheric) else 0):
        sag, slope = _sag(surface, np.hypot(p[:, 0], p[:, 1]))
        gradient = np.column_stack([-slope[:, None] * p[:, :2], np.ones(len(p))])
        step = (sag - p[:, 2]) / np.sum(gradient * d, axis=1)
        p = p + step[:, None] * d
        if not np.any(np.abs(step) > 1e-15 * (1.0 + np.abs(p[:, 2]))):
            break
    _, slope = _sag(surface, np.hypot(p[:, 0], p[:, 1]))
    normal = np.column_stack([-slope[:, None] * p[:, :2], np.ones(len(p))])
    return p, normal / np.linalg.norm(normal, axis=1)[:, None]


def _sag(surface: LensSurface, r: Array) -> tuple[Array, Array]:
    """Sag at radii ``r``, and its derivative by r, over r."""
    c = surface.curvature
    root = np.sqrt(1.0 - (1.0 + surface.conic) * (c * r) ** 2)
    sag, slope = c * r * r / (1.0 + root), c / root
    for i, coefficient in enumerate(surface.aspheric):
        power = 4 + 2 * i
        sag = sag + coefficient * r**power
        slope = slope + power * coefficient * r ** (power - 2)
    return sag, slope


def _refract(d: Array, normal: Array, eta: float) -> Array:
    """Snell's law; nan where the light is totally reflected."""
    cosine = np.sum(d * normal, axis=1)
    root = np.sqrt(1.0 - eta * eta * (1.0 - cosine * cosine))
    return np.asarray(eta * d + (np.sign(cosine) * root - eta * cosine)[:, None] * normal)
