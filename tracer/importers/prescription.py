"""A lens as design programs describe it: surfaces in the order in which light meets them.

Readers of single formats fill a `Prescription`; everything after them knows only this. Lengths are
in ``unit``; curvatures and thicknesses keep the sign convention of the design programs (a radius is
positive where the centre lies further along z; thicknesses turn negative after a mirror).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from raymap.model.errors import SceneError

__all__ = [
    "Aperture",
    "FieldPoint",
    "GlassName",
    "ImportWarning",
    "LensSurface",
    "Prescription",
    "ThicknessSolve",
]

ApertureKind = Literal["entrance_diameter", "f_number", "working_f_number", "object_na", "stop"]
FieldKind = Literal["angle", "object_height", "paraxial_image_height", "real_image_height"]


class ImportWarning(UserWarning):
    """Something in a file of another program was taken with a change."""


@dataclass(frozen=True, kw_only=True)
class GlassName:
    """A glass as a file names it.

    Attributes
    ----------
    name : as written
    maker : a catalogue that the name itself carries, "" where it does not
    model : index at the d line and Abbe number of a glass that only they describe
    table : (wavelength nm, index) pairs of a glass that the file itself describes
    said : index and Abbe number that the file gives beside the name of a catalogue's glass
    """

    name: str
    maker: str = ""
    model: tuple[float, float] | None = None
    table: tuple[tuple[float, float], ...] = ()
    said: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class LensSurface:
    """One surface of the sequence.

    Attributes
    ----------
    number : its number in the file
    curvature, conic, aspheric : shape; coefficients of r^4, r^6 …
    thickness : to the next surface along z, inf for an object at infinity
    glass : what follows, None for air; ``mirror`` reflects instead
    semi_diameter : of the clear aperture, None where the file leaves it to the rays
    automatic : the program took ``semi_diameter`` from its rays
    mechanical : radius to the rim, None where it is that of the clear aperture
    hole, obscuration : radius of a hole through the part, of a disc that blocks the middle
    clips : it stops light beyond ``semi_diameter`` also where nothing else happens there
    """

    number: int
    curvature: float = 0.0
    conic: float = 0.0
    aspheric: tuple[float, ...] = ()
    thickness: float = 0.0
    glass: GlassName | None = None
    mirror: bool = False
    semi_diameter: float | None = None
    automatic: bool = True
    mechanical: float | None = None
    hole: float = 0.0
    obscuration: float = 0.0
    clips: bool = False
    stop: bool = False
    label: str = ""

    def sag(self, r: float) -> float:
        """Height above the vertex at distance ``r`` from the axis; nan beyond the surface."""
        inside = 1.0 - (1.0 + self.conic) * (self.curvature * r) ** 2
        if inside < 0.0:
            return math.nan
        powers = sum(a * r ** (4 + 2 * k) for k, a in enumerate(self.aspheric))
        return self.curvature * r * r / (1.0 + math.sqrt(inside)) + powers


@dataclass(frozen=True, kw_only=True)
class Aperture:
    """How much light the file lets in."""

    kind: ApertureKind
    value: float = 0.0


@dataclass(frozen=True, kw_only=True)
class FieldPoint:
    """One field: its place in the terms of the file, weight, and how much is vignetted.

    ``vignetting`` is the share of the pupil's radius lost at (+x, -x, +y, -y): light fills the
    ellipse between these ends, turned about the middle of the whole pupil by ``turn_deg``.
    """

    x: float
    y: float
    weight: float = 1.0
    vignetting: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    turn_deg: float = 0.0

    @property
    def vignetted(self) -> bool:
        """Whether light fills another pupil than the stop gives it."""
        return any(self.vignetting)


@dataclass(frozen=True, kw_only=True)
class ThicknessSolve:
    """A thickness that puts a ray of the axis at a height on the next surface.

    Attributes
    ----------
    surface : index of the surface whose thickness it is
    height : of the ray on the next one
    zone : share of the pupil's radius at which the real ray starts; 0 for the paraxial one
    offset : what is added, a defocus
    """

    surface: int
    height: float = 0.0
    zone: float = 0.0
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Prescription:
    """A whole lens file.

    Attributes
    ----------
    origin : name of the file, for messages
    unit : of all lengths
    surfaces : object first, image last
    aperture, field_kind, fields : what light the design is for
    telecentric : chief rays start parallel to the axis
    wavelengths_nm, weights, primary : of the design
    catalogues : catalogues in the order in which the file looks glasses up
    solves : thicknesses that follow from rays
    """

    origin: str
    title: str = ""
    unit: Literal["mm", "cm", "m", "in"] = "mm"
    surfaces: tuple[LensSurface, ...]
    aperture: Aperture
    field_kind: FieldKind = "angle"
    fields: tuple[FieldPoint, ...] = (FieldPoint(x=0.0, y=0.0),)
    telecentric: bool = False
    wavelengths_nm: tuple[float, ...] = (587.5618,)
    weights: tuple[float, ...] = (1.0,)
    primary: int = 0
    catalogues: tuple[str, ...] = field(default=())
    solves: tuple[ThicknessSolve, ...] = ()

    def __post_init__(self) -> None:
        if self.stop == 0:
            raise SceneError(
                f"{self.origin}: surface 0: the object is marked as the stop; mark the surface "
                "that limits the beam"
            )

    @property
    def stop(self) -> int:
        """Index of the aperture stop in ``surfaces``; the first surface where none is named."""
        for index, surface in enumerate(self.surfaces):
            if surface.stop:
                return index
        return 1
