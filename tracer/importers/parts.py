"""Parts of an imported lens while they are being fitted together: elements and mirrors."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from tracer.importers.prescription import GlassName, LensSurface

__all__ = ["Part", "PartFace"]


@dataclass(kw_only=True, eq=False)
class PartFace:
    """One face of a part about the z axis, lengths in the unit of the file.

    ``surfaces`` are the file's numbers of the surfaces that it is.
    """

    z: float
    curvature: float
    conic: float
    aspheric: tuple[float, ...]
    semi_diameter: float
    mechanical: float = 0.0
    hole: float = 0.0
    mirror: bool = False
    black: bool = False
    stop: bool = False
    surfaces: list[int] = field(default_factory=list)

    def same_shape(self, surface: LensSurface, z: float, tolerance: float) -> bool:
        """Whether a surface of the sequence is this very face."""
        return (
            abs(self.z - z) <= tolerance
            and math.isclose(self.curvature, surface.curvature, rel_tol=1e-9, abs_tol=1e-15)
            and self.conic == surface.conic
            and self.aspheric == surface.aspheric
        )

    def sag(self, r: float) -> float:
        """Height above the vertex; nan beyond the surface."""
        shape = LensSurface(
            number=0, curvature=self.curvature, conic=self.conic, aspheric=self.aspheric
        )
        return shape.sag(r)

    def height(self, r: float) -> float:
        """Place along the axis of the face, or of its flat land, at distance ``r``."""
        return self.z + self.sag(min(r, self.semi_diameter))


@dataclass(kw_only=True, eq=False)
class Part:
    """An element of glass or a mirror on a shell: two faces, a rim, perhaps a hole.

    ``low`` is the face with the lower z; ``trimmed`` says that the outer radius is no longer free.
    """

    kind: Literal["lens", "mirror"]
    low: PartFace
    high: PartFace
    glass: GlassName | None
    name: str = ""
    mirror_face: PartFace | None = None
    hole: float = 0.0
    limit: float = math.inf

    def is_same(self, other: Part) -> bool:
        """Whether both are one element."""
        return self.low is other.low and self.high is other.high

    @property
    def numbers(self) -> str:
        """The surfaces that it was made of, for messages."""
        numbers = sorted({*self.low.surfaces, *self.high.surfaces})
        return ", ".join(str(number) for number in numbers)

    @property
    def outer(self) -> float:
        """Radius of the rim."""
        faces = max(self.low.semi_diameter, self.high.semi_diameter)
        wanted = max(faces, self.low.mechanical, self.high.mechanical)
        if self.low.stop or self.high.stop:
            # The stop is a black land about the clear aperture
            wanted = max(wanted, 1.05 * faces)
        return max(faces, min(wanted, self.limit))

    @property
    def edge(self) -> float:
        """Thickness at the rim; negative where the faces cross."""
        return self.high.height(self.outer) - self.low.height(self.outer)

    @property
    def lowest(self) -> float:
        """Lowest place along the axis."""
        return min(self.low.z, self.low.height(self.outer))

    @property
    def highest(self) -> float:
        """Highest place along the axis."""
        return max(self.high.z, self.high.height(self.outer))

    def contains(self, r: float, z: float) -> bool:
        """Whether the point at distance ``r`` from the axis and height ``z`` lies in the part."""
        if not self.hole <= r <= self.outer:
            return False
        return self.low.height(r) <= z <= self.high.height(r)
