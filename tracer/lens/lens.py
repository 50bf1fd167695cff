"""A lens as one object: a checked body, a glass, a place in the world."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raymap.optics.frames import frame_of
from tracer.lens.errors import LensError
from tracer.lens.glass import AIR, Glass
from tracer.lens.shape import LensShape, lens_shape
from tracer.optics.dispersion import constant

__all__ = ["Lens"]

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A lens of spherical or plane caps with an opaque rim, in one surrounding medium.

    Attributes
    ----------
    radius_front, radius_back : radii of curvature [mm], positive where the centre lies further
        along the axis than the vertex, inf for a plane
    thickness : between the vertices [mm]
    semi_aperture_front, semi_aperture_back : clear radii of the caps [mm]; the back one is the
        front one's if not given. Different ones make a conical rim
    glass : a `Glass`, or a number: a constant refractive index
    outside : the medium around, a `Glass` or a number
    origin : (3,) the front vertex in the world [mm]
    axis : (3,) from the front to the back vertex; normalised

    Raises
    ------
    LensError
        names the field that makes the lens impossible
    """

    radius_front: float
    radius_back: float
    thickness: float
    semi_aperture_front: float
    semi_aperture_back: float | None = None
    glass: Glass | float
    outside: Glass | float = AIR
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    name: str = "lens"
    shape: LensShape = field(init=False, repr=False, compare=False)
    frame: Real = field(init=False, repr=False, compare=False)
    """(4, 3): the axes x, y, z of the lens as rows, then its origin."""

    def __post_init__(self) -> None:
        back = self.semi_aperture_back
        if back is None:
            object.__setattr__(self, "semi_aperture_back", self.semi_aperture_front)
        for which in ("glass", "outside"):
            object.__setattr__(self, which, _as_glass(getattr(self, which), which))
        shape = lens_shape(
            radius_front=self.radius_front,
            radius_back=self.radius_back,
            thickness=self.thickness,
            semi_aperture_front=self.semi_aperture_front,
            semi_aperture_back=self.semi_aperture_front if back is None else back,
        )
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "frame", _frame(self.origin, self.axis))

    def optics(
        self, wavelength_nm: ArrayLike, index_wavelength_nm: float | None = None
    ) -> tuple[Real, Real, Real]:
        """Index outside, index of the glass and its absorption [1/mm] at wavelengths [nm].

        ``index_wavelength_nm`` takes both indices at one wavelength in place of the light's own
        (no dispersion).
        """
        wavelengths = np.asarray(wavelength_nm, np.float64)
        for_index = wavelengths
        if index_wavelength_nm is not None:
            for_index = np.full_like(wavelengths, index_wavelength_nm)
        glass, outside = _as_glass(self.glass, "glass"), _as_glass(self.outside, "outside")
        return outside.index(for_index), glass.index(for_index), glass.absorption(wavelengths)

    def focal_length(self, wavelength_nm: float) -> float:
        """Paraxial focal length in the surrounding medium [mm]; infinite without power."""
        outside, glass, _ = self.optics(wavelength_nm)
        n = float(glass) / float(outside)
        c1, c2 = self.shape.curvature_front, self.shape.curvature_back
        power = (n - 1.0) * (c1 - c2 + (n - 1.0) * self.thickness * c1 * c2 / n)
        return 1.0 / power if power != 0.0 else float("inf")

    def back_focal_length(self, wavelength_nm: float) -> float:
        """Distance from the back vertex to the paraxial focus [mm]."""
        outside, glass, _ = self.optics(wavelength_nm)
        n = float(glass) / float(outside)
        f = self.focal_length(wavelength_nm)
        return f * (1.0 - (n - 1.0) * self.thickness * self.shape.curvature_front / n)


def _as_glass(value: Glass | float, field_name: str) -> Glass:
    if isinstance(value, Glass):
        return value
    if not (np.isfinite(value) and value > 0.0):
        raise LensError(f"{field_name} is {value:g}: a refractive index is a positive number")
    return Glass(dispersion=constant(float(value), name=f"{field_name} n = {value:g}"))


def _frame(origin: ArrayLike, axis: ArrayLike) -> Real:
    place, z = np.asarray(origin, np.float64), np.asarray(axis, np.float64)
    if place.shape != (3,) or not np.all(np.isfinite(place)):
        raise LensError(f"origin is {origin!r}: expected three finite numbers")
    length = float(np.linalg.norm(z)) if z.shape == (3,) else float("nan")
    if not (np.isfinite(length) and length > 0.0):
        raise LensError(f"axis is {axis!r}: expected three numbers that are not all zero")
    # A lens along +z keeps the axes of the world
    return np.concatenate((frame_of(z), [place]))
