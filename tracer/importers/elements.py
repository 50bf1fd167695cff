"""From a sequence of surfaces to the parts that stand in space: elements, mirrors, stop, discs.

Surfaces at one place with one shape are one face, so an element that light meets twice is one part.
Where glass would run into glass (edges that cross, neighbours that overlap) the part is trimmed.
"""

from __future__ import annotations

import itertools
import warnings
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from tracer.importers.bundles import Bundles
from tracer.importers.fitting import fit_parts
from tracer.importers.parts import Part, PartFace
from tracer.importers.prescription import GlassName, ImportWarning

__all__ = ["Disc", "Elements", "build_elements"]

Array = NDArray[np.float64]

EDGE_SLACK = 0.02
"""Share by which a rim may be narrower than the clear aperture, which other glasses widen."""

AUTOMATIC_MARGIN = 1e-6
"""Share by which apertures that a program took from its rays are widened: its rays shall pass."""

TRACED_MARGIN = 1e-3
SHELL = (0.1, 0.03, 0.01, 0.003)
"""Thickness of the substrate of a mirror, in its radius: the thickest that has room."""

HOLE_MARGIN = 1.02


@dataclass(frozen=True, kw_only=True)
class Disc:
    """A flat ring that absorbs: the stop or an aperture (``inner`` is open), or an obscuration
    (``inner`` 0); ``surface`` is the file's number of what it is."""

    name: str
    z: float
    inner: float
    outer: float
    stop: bool = False
    surface: int = -1


@dataclass(kw_only=True)
class Elements:
    """What stands in space.

    Attributes
    ----------
    parts, discs : elements and mirrors; the stop, apertures, obscurations
    face_of : the part and face that each surface became, by the file's number
    limits : (n_surfaces,) radius within which light passes each surface, inf where nothing stands
    """

    parts: list[Part] = field(default_factory=list)
    discs: list[Disc] = field(default_factory=list)
    face_of: dict[int, str] = field(default_factory=dict)
    limits: Array = field(default_factory=lambda: np.empty(0))


def build_elements(bundles: Bundles) -> Elements:
    """The parts of a sequence.

    Raises
    ------
    SceneError
        naming the surface that cannot be built
    """
    return _Builder(bundles).build()


class _Builder:
    def __init__(self, bundles: Bundles) -> None:
        self.bundles = bundles
        self.sequence = bundles.sequence
        self.surfaces = self.sequence.surfaces
        self.z = self.sequence.z
        self.origin = self.sequence.prescription.origin
        self.scale = float(np.max(np.abs(self.z[1:]))) + 1e-12
        self.faces: list[PartFace] = []
        self.face_at: dict[int, PartFace] = {}
        self.medium: list[GlassName | None] = self._media()
        self.sign = self._signs()

    def fail(self, k: int, message: str) -> SceneError:
        return SceneError(f"{self.origin}: surface {self.surfaces[k].number}: {message}")

    def warn(self, message: str) -> None:
        warnings.warn(f"{self.origin}: {message}", ImportWarning, stacklevel=2)

    def _media(self) -> list[GlassName | None]:
        """The glass behind each surface; a mirror keeps the one before it."""
        media: list[GlassName | None] = []
        current = None
        for surface in self.surfaces:
            current = current if surface.mirror else surface.glass
            media.append(current)
        return media

    def _signs(self) -> list[int]:
        """+1 where light arrives along z, -1 after an odd number of mirrors."""
        signs, sign = [], 1
        for surface in self.surfaces:
            signs.append(sign)
            sign = -sign if surface.mirror else sign
        return signs

    def _semi_diameter(self, k: int) -> float:
        surface = self.surfaces[k]
        reach = float(self.bundles.reach[k])
        if k == self.sequence.prescription.stop:
            return self.bundles.stop_radius * (1.0 + AUTOMATIC_MARGIN)
        if surface.semi_diameter is None:
            if reach <= 0.0:
                raise self.fail(k, "has no semi-diameter, and no light reaches it; give it one")
            return reach * (1.0 + TRACED_MARGIN)
        if surface.automatic:
            return max(surface.semi_diameter, reach) * (1.0 + AUTOMATIC_MARGIN)
        return surface.semi_diameter

    def _face(self, k: int) -> PartFace:
        """The face that surface ``k`` is, shared with earlier surfaces of its place and shape."""
        if k in self.face_at:
            return self.face_at[k]
        surface = self.surfaces[k]
        semi = self._semi_diameter(k)
        if surface.mechanical and surface.mechanical < (1.0 - EDGE_SLACK) * semi:
            self.warn(
                f"surface {surface.number}: its edge, of radius {surface.mechanical:g}, lies "
                f"within its clear aperture of {semi:.4g}, and is left out"
            )
        for face in self.faces:
            if face.same_shape(surface, float(self.z[k]), 1e-9 * self.scale):
                break
        else:
            face = PartFace(
                z=float(self.z[k]),
                curvature=surface.curvature,
                conic=surface.conic,
                aspheric=surface.aspheric,
                semi_diameter=semi,
            )
            self.faces.append(face)
        face.semi_diameter = max(face.semi_diameter, semi)
        face.mechanical = max(face.mechanical, surface.mechanical or 0.0)
        face.hole = max(face.hole, surface.hole)
        face.mirror |= surface.mirror
        face.stop |= k == self.sequence.prescription.stop
        face.surfaces.append(surface.number)
        self.face_at[k] = face
        return face

    # -- the parts -------------------------------------------------------------------------------

    def build(self) -> Elements:
        self._refuse_gaps_against_the_light()
        parts = self._parts()
        self._pierce(parts)
        for message in fit_parts(parts):
            self.warn(message)
        discs = self._discs(parts)
        face_of: dict[int, str] = {}
        for part in parts:
            for face, name in ((part.low, "front"), (part.high, "back")):
                for number in face.surfaces:
                    face_of.setdefault(number, f"{part.name}.{name}")
        return Elements(parts=parts, discs=discs, face_of=face_of, limits=self._limits(discs))

    def _limits(self, discs: list[Disc]) -> Array:
        """Radii of clear apertures, after everything was fitted together."""
        limits = np.full(len(self.surfaces), np.inf)
        for k, face in self.face_at.items():
            limits[k] = face.semi_diameter
        rings = {disc.surface: disc.inner for disc in discs if disc.inner}
        for k, surface in enumerate(self.surfaces):
            limits[k] = min(limits[k], rings.get(surface.number, np.inf))
        return limits

    def _refuse_gaps_against_the_light(self) -> None:
        """Refuse surfaces that light would have to go back to: sequences do, light does not."""
        last = len(self.surfaces) - 1
        stands = [k for k in range(1, last) if not self._is_dummy(k) or self._is_ring(k)]
        for before, k in itertools.pairwise(stands):
            gap = (self.z[k] - self.z[before]) * self._leaving_sign(before)
            if gap < -1e-9 * self.scale and self.medium[before] is None:
                raise self.fail(
                    k,
                    f"lies {abs(gap):.5g} before surface {self.surfaces[before].number}, which "
                    "light meets first: a virtual place, where nothing can stand; put it where "
                    "light passes it",
                )

    def _parts(self) -> list[Part]:
        parts: list[Part] = []
        last = len(self.surfaces) - 1
        if self.medium[0] is not None:
            raise self.fail(
                0,
                f"the object lies in {self.medium[0].name}, which is not understood; objects in "
                "air are: write a scene with the lens, a body of that medium and a source in it",
            )
        for k in range(1, last):
            surface = self.surfaces[k]
            if self.medium[k] is not None and not self._is_dummy(k):
                part = self._element(k, last)
                if not any(part.is_same(other) for other in parts):
                    part.name = f"L{1 + sum(p.kind == 'lens' for p in parts)}"
                    parts.append(part)
            elif surface.mirror and self.medium[k] is None:
                face = self._face(k)
                if any(face in (p.low, p.high) for p in parts):
                    raise self.fail(
                        k,
                        "is a mirror on a part of a face that light also passes, which cannot be "
                        "built; move it a little in the design program",
                    )
                if not any(p.mirror_face is face for p in parts):
                    parts.append(self._mirror(k, face, parts))
        return parts

    def _is_dummy(self, k: int) -> bool:
        """Whether nothing happens at a surface."""
        return self.medium[k] == self.medium[k - 1] and not self.surfaces[k].mirror

    def _element(self, k: int, last: int) -> Part:
        """The element of glass behind surface ``k``."""
        end = k + 1
        while end < last and self._is_dummy(end):
            if self.surfaces[end].stop:
                raise self.fail(end, "the stop lies inside glass, where no ring can stand")
            end += 1
        first, second = self._face(k), self._face(end)
        if end == last:
            # The image lies in glass: let the element reach a little beyond it
            second.z += 0.05 * (second.z - first.z)
        if abs(second.z - first.z) < 1e-12 * self.scale:
            raise self.fail(k, "its element has no thickness")
        if (second.z > first.z) != (self._leaving_sign(k) > 0):
            raise self.fail(k, f"its thickness {second.z - first.z:g} runs against the light")
        low, high = (first, second) if second.z > first.z else (second, first)
        glass = self.medium[k]
        assert glass is not None
        return Part(kind="lens", low=low, high=high, glass=glass)

    def _leaving_sign(self, k: int) -> int:
        return -self.sign[k] if self.surfaces[k].mirror else self.sign[k]

    def _mirror(self, k: int, face: PartFace, parts: list[Part]) -> Part:
        """A mirror in air: a shell with its face towards the light."""
        thickness = SHELL[0] * face.semi_diameter
        other = PartFace(
            z=face.z + self.sign[k] * thickness,
            curvature=face.curvature,
            conic=face.conic,
            aspheric=face.aspheric,
            semi_diameter=face.semi_diameter,
            black=True,
        )
        low, high = (face, other) if self.sign[k] > 0 else (other, face)
        name = f"M{1 + sum(p.kind == 'mirror' for p in parts)}"
        return Part(kind="mirror", low=low, high=high, glass=None, name=name, mirror_face=face)

    # -- holes -----------------------------------------------------------------------------------

    def _pierce(self, parts: list[Part]) -> None:
        """Give parts that later light must pass through the hole that it needs."""
        for part in parts:
            hole = max(part.low.hole, part.high.hole)
            needed = self._needed_hole(part)
            if needed > hole:
                inside = [
                    other.outer
                    for other in parts
                    if other is not part
                    and other.outer < part.outer
                    and other.lowest < part.highest
                    and other.highest > part.lowest
                ]
                hole = HOLE_MARGIN * max(needed, *inside, 0.0)
                self.warn(
                    f"{part.name} (surfaces {part.numbers}) gets a hole of radius {hole:.4g}: "
                    "light passes through its middle later, and the file gives no hole"
                )
            if hole > 0.0:
                if any(part.low.aspheric) or any(part.high.aspheric):
                    raise SceneError(
                        f"{self.origin}: surfaces {part.numbers}: light passes through a hole in "
                        "an asphere, which cannot be traced"
                    )
                part.hole = hole

    def _needed_hole(self, part: Part) -> float:
        """Radius within which light that does not belong to a part crosses it; 0 if none does."""
        needed = 0.0
        if not any(surface.mirror for surface in self.surfaces):
            return needed
        for lit in self.bundles.lit:
            points = self.bundles.trace(lit.origin, lit.edge).points
            for k in range(1, len(self.surfaces) - 1):
                ours = {self.surfaces[k].number, self.surfaces[k + 1].number}
                if ours & {*part.low.surfaces, *part.high.surfaces}:
                    continue
                ends = sorted((float(self.z[k]), float(self.z[k + 1])))
                for z in (part.low.z, part.high.z):
                    if not ends[0] < z < ends[1]:
                        continue
                    radii = _crossing_radii(points[k], points[k + 1], z)
                    # Light that also goes by outside is obscured by the part, as in the real lens
                    if len(radii) and radii.max() < part.outer:
                        needed = max(needed, float(radii.max()))
        return needed

    # -- stop and obscurations -------------------------------------------------------------------

    def _discs(self, parts: list[Part]) -> list[Disc]:
        discs = []
        stop = self.sequence.prescription.stop
        if stop not in self.face_at and stop < len(self.surfaces) - 1:
            discs.append(self._ring(stop, parts, self.bundles.stop_radius, "stop"))
        for k in range(1, len(self.surfaces) - 1):
            if self.surfaces[k].clips and k != stop and k not in self.face_at:
                discs += self._aperture(k, parts)
        for k, surface in enumerate(self.surfaces):
            if surface.obscuration > 0.0 and 0 < k < len(self.surfaces) - 1:
                discs.append(self._obscuration(k))
        return discs

    def _is_ring(self, k: int) -> bool:
        """Whether a ring in air stands for a surface where nothing else happens."""
        here = k == self.sequence.prescription.stop or self.surfaces[k].clips
        return here and self.medium[k] is None

    def _aperture(self, k: int, parts: list[Part]) -> list[Disc]:
        """The aperture of a surface where nothing else happens, where it has room."""
        number, inner = self.surfaces[k].number, self.surfaces[k].semi_diameter or 0.0
        z = float(self.z[k])
        if any(part.contains(inner * (1.0 + 1e-9), z) for part in parts):
            self.warn(f"surface {number}: its aperture lies in an element and is left out")
            return []
        return [self._ring(k, parts, inner, f"aperture_{number}")]

    def _ring(self, k: int, parts: list[Part], inner: float, name: str) -> Disc:
        """A surface of the sequence as a ring, as wide as there is room between its neighbours."""
        number = self.surfaces[k].number
        if self.surfaces[k].curvature:
            self.warn(f"surface {number}: the {name} is curved; its ring is flat")
        z = float(self.z[k])
        outer = 2.0 * max([inner, *(part.outer for part in parts)])
        for r in np.linspace(inner, outer, 4097):
            if any(part.contains(float(r), z) for part in parts):
                outer = float(r) - (outer - inner) / 4096.0
                break
        if outer <= inner:
            raise self.fail(k, f"the {name} of radius {inner:.4g} lies in an element")
        return Disc(name=name, z=z, inner=inner, outer=outer, stop=name == "stop", surface=number)

    def _obscuration(self, k: int) -> Disc:
        """A black disc before or behind a surface, on its side in air."""
        surface = self.surfaces[k]
        radius = surface.obscuration
        heights = [surface.sag(radius * i / 32.0) for i in range(33)]
        gap = 1e-4 * radius
        towards = self.sign[k]
        behind = (self.medium[k] is None) != surface.mirror
        if behind == (towards > 0):
            z = float(self.z[k]) + max(heights) + gap
        else:
            z = float(self.z[k]) + min(heights) - gap
        return Disc(
            name=f"obscuration_{surface.number}",
            z=z,
            inner=0.0,
            outer=radius,
            surface=surface.number,
        )


def _crossing_radii(
    a: np.ndarray[tuple[int, int], np.dtype[np.float64]],
    b: np.ndarray[tuple[int, int], np.dtype[np.float64]],
    z: float,
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Distances from the axis at which segments a -> b cross the plane at ``z``."""
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (z - a[:, 2]) / (b[:, 2] - a[:, 2])
        at = a + share[:, None] * (b - a)
        radii = np.hypot(at[:, 0], at[:, 1])
        return np.asarray(radii[(share > 0.0) & (share < 1.0) & np.isfinite(radii)])
