"""Lens files as tables of a scene: bodies, media, sources for the fields, a detector at the image.

``raymap check lens.zmx`` opens such a file as a scene of its own; ``[lens_files.NAME]`` puts its
bodies into another scene, under names that start with ``NAME.``.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from raymap.model.units import length_scale
from tracer.description.fields import Placed
from tracer.importers.bundles import Bundles, LitField
from tracer.importers.elements import Disc, Elements, build_elements
from tracer.importers.image import Image, find_image
from tracer.importers.lens_format import read_prescription
from tracer.importers.lens_glass import medium_of_glass
from tracer.importers.narrowed import beam_of, cone_of
from tracer.importers.parts import Part, PartFace
from tracer.importers.prescription import GlassName, ImportWarning, Prescription
from tracer.importers.sequence import Sequence
from tracer.importers.solves import solved
from tracer.media.model import medium_model
from tracer.scene.media import refractive_index

__all__ = ["ImportedLens", "import_lens"]

Array = NDArray[np.float64]

IMAGE_CELLS = 256
IMAGE_SHELL = 0.1
"""Thickness of the shell behind a curved image, in its radius."""

BLACK = "black"
SUBSTRATE = "substrate"


def import_lens(
    path: str | Path,
    *,
    glasses: Mapping[str, str] | None = None,
    media: Mapping[str, Any] | None = None,
    length_unit: str | None = None,
    prefix: str = "",
    placed: Placed | None = None,
) -> ImportedLens:
    """A lens file, ready to be written into a scene.

    Parameters
    ----------
    glasses : what names of the file mean, where its catalogues are not enough
    media : tables of the media of the scene, by name
    length_unit : of the scene; that of the file by default
    prefix : put before the name of every body, source and detector
    placed : where the first vertex stands, and how the axis lies

    Raises
    ------
    SceneError
        naming the surface and what to do
    """
    prescription = read_prescription(path)
    return ImportedLens(
        prescription=prescription,
        given=dict(glasses or {}),
        known=dict(media or {}),
        unit=length_unit or prescription.unit,
        prefix=prefix,
        placed=placed or Placed(),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class ImportedLens:
    """A prescription, its rays, its parts, and the tables that they become."""

    prescription: Prescription
    given: dict[str, str]
    known: dict[str, Any]
    unit: str
    prefix: str
    placed: Placed

    # -- glasses and rays ------------------------------------------------------------------------

    @cached_property
    def _glass(self) -> dict[GlassName, tuple[str, dict[str, Any]]]:
        found: dict[GlassName, tuple[str, dict[str, Any]]] = {}
        for surface in self.prescription.surfaces:
            if surface.glass is not None and surface.glass not in found:
                found[surface.glass] = medium_of_glass(
                    surface.glass,
                    makers=self.prescription.catalogues,
                    given=dict.fromkeys(self.known, "") | self.given,
                    where=f"{self.prescription.origin}: surface {surface.number}",
                )
        return found

    @cached_property
    def sequence(self) -> Sequence:
        """The surfaces with the indices of their glasses, and the thicknesses that follow."""
        return solved(Sequence(prescription=self.prescription, indices=self._indices()))

    def _indices(self) -> Array:
        """(n_surfaces, n_wavelengths) indices of what follows each surface."""
        wavelengths = np.array(self.prescription.wavelengths_nm)
        rows = []
        current = np.ones(len(wavelengths))
        for surface in self.prescription.surfaces:
            if surface.glass is not None:
                name, table = self._glass[surface.glass]
                if name not in self.known and not table:
                    raise SceneError(
                        f"{self.prescription.origin}: glass {surface.glass.name!r} is said to be "
                        f"{name!r}, but no catalogue has it and the scene has no such medium"
                    )
                model = medium_model(table or self.known[name])
                current = refractive_index(model, wavelengths, self.prescription.origin)
            elif not surface.mirror:
                current = np.ones(len(wavelengths))
            rows.append(current)
        return np.array(rows)

    @cached_property
    def bundles(self) -> Bundles:
        """The light of its fields."""
        return Bundles(sequence=self.sequence)

    @cached_property
    def elements(self) -> Elements:
        """Its parts."""
        return build_elements(self.bundles)

    # -- placing ---------------------------------------------------------------------------------

    @property
    def scale(self) -> float:
        """Scene units in a unit of the file."""
        return length_scale(self.prescription.unit, self.unit)

    def _point(self, x: float, y: float, z: float) -> list[float]:
        origin, frame = self.placed.frame()
        return [float(c) for c in origin + frame @ (self.scale * np.array([x, y, z]))]

    def _direction(self, d: Any) -> list[float]:
        _, frame = self.placed.frame()
        return [float(c) for c in frame @ np.asarray(d, float)]

    def _turn(self) -> dict[str, Any]:
        if self.placed.rotation is not None:
            return {"rotation": list(self.placed.rotation)}
        return {"axis": list(self.placed.axis)} if self.placed.axis is not None else {}

    # -- tables ----------------------------------------------------------------------------------

    def media(self) -> dict[str, Any]:
        """Tables of the media."""
        tables = {
            name: table for name, table in self._glass.values() if table and name not in self.known
        }
        if any(part.kind == "mirror" for part in self.elements.parts):
            tables[SUBSTRATE] = {"index": 1.5}
        return tables

    def surfaces(self) -> dict[str, Any]:
        """Tables of the surfaces that the bodies name."""
        tables: dict[str, Any] = {BLACK: {"kind": "absorber"}}
        if any(surface.mirror for surface in self.prescription.surfaces):
            tables["mirror"] = {"kind": "mirror", "reflectance": 1.0}
        return tables

    def bodies(self) -> dict[str, Any]:
        """Tables of the bodies, in the order in which light first meets them."""
        tables = {}
        self._say_what_is_dark()
        cemented = {id(part.high): part.name for part in self.elements.parts}
        for part in sorted(self.elements.parts, key=lambda part: part.low.z):
            tables[self.prefix + part.name] = self._lens(part, cemented.get(id(part.low)))
        for disc in self.elements.discs:
            tables[self.prefix + disc.name] = self._ring(disc)
        return tables

    def _say_what_is_dark(self) -> None:
        for number, field in self.bundles.dark:
            self._warn(
                f"field {number} ({field.x:g}, {field.y:g}): no light gets through the stop, "
                "the apertures and its vignetting; the field is left out"
            )

    def _warn(self, message: str) -> None:
        warnings.warn(f"{self.prescription.origin}: {message}", ImportWarning, stacklevel=2)

    def _lens(self, part: Part, before: str | None) -> dict[str, Any]:
        table: dict[str, Any] = {
            "kind": "lens",
            "position": self._point(0.0, 0.0, part.low.z),
            **self._turn(),
            "medium": self._glass[part.glass][0] if part.glass else SUBSTRATE,
            "thickness": self.scale * (part.high.z - part.low.z),
            "front": {"cemented": self.prefix + before} if before else self._face(part.low),
            "back": self._face(part.high),
            "rim": BLACK,
        }
        if part.outer > max(part.low.semi_diameter, part.high.semi_diameter):
            table["diameter"] = 2.0 * self.scale * part.outer
        if part.hole:
            table["hole"] = 2.0 * self.scale * part.hole
        return table

    def _face(self, face: PartFace) -> dict[str, Any]:
        table: dict[str, Any] = {
            "radius": self.scale / face.curvature if face.curvature else math.inf,
            "semi_diameter": self.scale * face.semi_diameter,
        }
        if face.conic:
            table["conic"] = face.conic
        if any(face.aspheric):
            table["aspheric"] = [a / self.scale ** (3 + 2 * k) for k, a in enumerate(face.aspheric)]
        if face.mirror or face.black:
            table["surface"] = "mirror" if face.mirror else BLACK
        return table

    def _ring(self, disc: Disc) -> dict[str, Any]:
        table = {
            "kind": "ring" if disc.inner else "disc",
            "position": self._point(0.0, 0.0, disc.z),
            **self._turn(),
            "inner": self.scale * disc.inner,
            "outer": self.scale * disc.outer,
            "surface": BLACK,
        }
        return table | ({"stop": True} if disc.stop else {})

    def sources(self) -> dict[str, Any]:
        """A source that fills the pupil on the axis, and one for each other field."""
        tables: dict[str, Any] = {}
        axis = self.bundles.light_of(self.bundles.axis)
        if axis:
            on_axis = [lit for lit in self.bundles.lit if lit.origin == self.bundles.axis]
            field = on_axis[0] if on_axis else axis
            self._light(tables, "axis", field)
        for lit in self.bundles.lit:
            if lit.origin != self.bundles.axis:
                self._light(tables, f"field_{lit.number}", lit)
        if not tables:
            raise SceneError(f"{self.prescription.origin}: no light of any field gets through")
        return tables

    def _light(self, tables: dict[str, Any], name: str, lit: LitField) -> None:
        """Put the source of a field, with the weight of the field, into the tables."""
        weight = lit.field.weight
        table = self._source(lit, weight or 1.0)
        if lit.field.vignetted:
            whole = self.bundles.light_of(lit.origin)
            table = self._narrowed(lit, self._source(whole, weight or 1.0) if whole else table)
        tables[self.prefix + name] = table
        if not weight:
            self._warn(f"field {lit.number} has the weight 0; its source is switched off")
            table["on"] = False

    def _source(self, lit: LitField, weight: float) -> dict[str, Any]:
        origin = lit.origin
        on_axis = origin == self.bundles.axis
        points, along = self.bundles.launch(origin, np.vstack([lit.centre, lit.edge]))
        table: dict[str, Any] = {"flux": weight, **self._spectrum()}
        if origin.height is not None:
            cosines = along[1:] @ along[0]
            angle = math.degrees(math.acos(float(np.clip(cosines.min(), -1.0, 1.0))))
            return {
                "kind": "point",
                "position": self._point(*points[0]),
                "axis": self._direction(along[0]),
                "cone_deg": angle,
                **table,
            }
        d = along[0]
        across = points[1:] - points[0]
        across = across - (across @ d)[:, None] * d
        radius = float(np.linalg.norm(across, axis=1).max()) * (1.0 if on_axis else 1.001)
        if on_axis:
            radius = self.bundles.marginal[0]
        lowest = min([part.lowest for part in self.elements.parts] + [0.0])
        tilt = math.sqrt(max(0.0, 1.0 - d[2] ** 2))
        distance = (-lowest + radius * tilt + 0.05 * radius) / d[2]
        return {
            "kind": "collimated",
            "diameter": 2.0 * self.scale * radius,
            "direction": self._direction(d),
            "aim": self._point(*points[0]),
            "distance": float(self.scale * distance),
            **table,
        }

    def _narrowed(self, lit: LitField, whole: dict[str, Any]) -> dict[str, Any]:
        """Of a source that fills the whole pupil what goes through a vignetted one."""
        points, along = self.bundles.launch(lit.origin, np.vstack([lit.centre, lit.edge]))
        spectrum = {key: whole[key] for key in self._spectrum()}
        d = np.array(self._direction(along[0]))
        if lit.origin.height is not None:
            edge = np.array([self._direction(way) for way in along[1:]])
            cone = cone_of(d, edge, lit.angles)
            filled = math.sin(math.radians(0.5 * whole["cone_deg"])) ** 2
            return {
                "kind": "elliptical",
                "position": whole["position"],
                "axis": [float(c) for c in cone.middle],
                "cone_deg": [2.0 * math.degrees(math.asin(min(h, 1.0))) for h in cone.half],
                "turn_deg": cone.turn_deg,
                "flux": whole["flux"] * cone.half[0] * cone.half[1] / filled,
                **spectrum,
            }
        places = np.array([self._point(*point) for point in points])
        beam = beam_of(places[0], d, places[1:], lit.angles)
        moved = float(np.linalg.norm(beam.middle - np.array(whole["aim"])))
        return {
            "kind": "elliptical",
            "size": [2.0 * half for half in beam.half],
            "turn_deg": beam.turn_deg,
            "direction": whole["direction"],
            "aim": [float(c) for c in beam.middle],
            # Wherever the ellipse reaches beside the disc, it starts before the lens
            "distance": whole["distance"] + 2.0 * (max(beam.half) + moved),
            "flux": whole["flux"] * 4.0 * beam.half[0] * beam.half[1] / whole["diameter"] ** 2,
            **spectrum,
        }

    def spectrum(self) -> dict[str, Any]:
        """The wavelengths of the design, rising."""
        return {
            "kind": "spectral",
            "wavelengths_nm": sorted(set(self.prescription.wavelengths_nm)),
        }

    def _spectrum(self) -> dict[str, Any]:
        weights: dict[float, float] = {}
        for wavelength, weight in zip(
            self.prescription.wavelengths_nm, self.prescription.weights, strict=True
        ):
            weights[wavelength] = weights.get(wavelength, 0.0) + max(weight, 0.0)
        if sum(weights.values()) == 0.0:
            weights = dict.fromkeys(weights, 1.0)
        lit = sorted(wavelength for wavelength, weight in weights.items() if weight > 0.0)
        powers = [weights[wavelength] for wavelength in lit]
        return {"spectrum": {"lines": {"wavelength_nm": lit, "power": powers}}}

    # -- the image -------------------------------------------------------------------------------

    @cached_property
    def image(self) -> Image | None:
        """Where the light of the image is caught; None where it does not get there."""
        return find_image(self.bundles, self.elements)

    def image_parts(self) -> dict[str, dict[str, Any]]:
        """Tables ``detectors`` of the image, and ``bodies`` of a curved one."""
        image = self.image
        if image is None:
            return {"detectors": {}, "bodies": {}}
        name = self.prefix + "image"
        if image.curved:
            return {
                "detectors": {
                    name: {
                        "kind": "surface",
                        "face": f"{name}_surface.{image.face}",
                        "cells": [IMAGE_CELLS, IMAGE_CELLS],
                    }
                },
                "bodies": {f"{name}_surface": self._image_body(image)},
            }
        size = 2.0 * self.scale * image.half
        detector = {
            "position": self._point(0.0, 0.0, image.z),
            "looks": self._direction([0.0, 0.0, -image.sign]),
            "up": self._direction([0.0, 1.0, 0.0]),
            "size": [size, size],
            "cells": [IMAGE_CELLS, IMAGE_CELLS],
            "blocking": image.blocking,
        }
        return {"detectors": {name: detector}, "bodies": {}}

    def _image_body(self, image: Image) -> dict[str, Any]:
        """A shell behind a curved image: black, or of air where light must pass it."""
        surface = self.prescription.surfaces[-1]
        face = PartFace(
            z=image.z,
            curvature=surface.curvature,
            conic=surface.conic,
            aspheric=surface.aspheric,
            semi_diameter=image.half,
            black=image.blocking,
        )
        thickness = IMAGE_SHELL * image.half
        return {
            "kind": "lens",
            "position": self._point(0.0, 0.0, min(image.z, image.z + image.sign * thickness)),
            **self._turn(),
            "medium": "air",
            "thickness": self.scale * thickness,
            "front": self._face(face),
            "back": self._face(face),
            "rim": BLACK if image.blocking else "bare",
        }

    def scene_tables(self) -> dict[str, Any]:
        """A whole scene: the lens in the light of its fields, and a detector at its image."""
        image = self.image_parts()
        return {
            "title": self.prescription.title or self.prescription.origin,
            "length_unit": self.unit,
            "spectrum": self.spectrum(),
            "media": self.media(),
            "surfaces": self.surfaces(),
            "bodies": self.bodies() | image["bodies"],
            "sources": self.sources(),
            "detectors": image["detectors"],
        }

    def design(self) -> dict[str, Any]:
        """First-order numbers of the design in its order of surfaces [scene units], and which face
        of which body each surface became."""
        scale, primary = self.scale, self.prescription.primary
        focal = self.sequence.focal_length(primary)
        height, slope = self.bundles.marginal
        pupil = self.bundles.entrance_pupil
        return {
            "wavelength_nm": self.prescription.wavelengths_nm[primary],
            "efl": scale * focal if math.isfinite(focal) else None,
            "f_number": abs(focal) / (2.0 * height) if math.isfinite(focal) and not slope else None,
            "entrance_diameter": 2.0 * scale * height if not slope else None,
            "entrance_pupil": scale * pupil if math.isfinite(pupil) else None,
            "object_na": math.sin(math.atan(slope)) if slope else None,
            "faces": {
                str(number): self.prefix + face
                for number, face in sorted(self.elements.face_of.items())
            },
        }
