"""Detectors of a scene by number: rows for the engine, entries for the map."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Detector
from raymap.model.errors import SceneError
from raymap.model.names import nearest_names
from tracer.compiled import (
    CAMERA,
    D_COLUMNS,
    D_KIND,
    D_VIRTUAL,
    FAR_FIELD,
    NO_VIEW,
    TRIANGLE_MAP,
    VIEW_BY_KIND,
    VIEW_ROW,
    Views,
)
from tracer.description.asking import asking
from tracer.detectors.detector import ViewDetector
from tracer.detectors.linking import detector_number
from tracer.detectors.model import DetectorModel
from tracer.detectors.surface_maps import map_face
from tracer.geometry.mesh import TriangleMesh
from tracer.geometry.shapes import Rectangle
from tracer.scene.faces import FaceTable
from tracer.scene.model import Scene

__all__ = ["CompiledDetectors", "DetectorTable"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_SIDES = {"outside": 1.0, "inside": -1.0, "both": 1.0}


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledDetectors:
    """Detectors for the engine: as in `CompiledScene`; pinholes by detector number."""

    integers: Integers
    numbers: Array
    views: Views | None
    virtual: bool

    def box(self, margin: float) -> Array:
        """(6,) lowest and highest corner of the box around all virtual planes, enlarged."""
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for row in self.numbers[self.integers[:, D_VIRTUAL] != 0]:
            reach = 0.5 * (row[12] * np.abs(row[3:6]) + row[13] * np.abs(row[6:9]))
            low, high = np.minimum(low, row[0:3] - reach), np.maximum(high, row[0:3] + reach)
        return np.concatenate((low - margin, high + margin))


class DetectorTable:
    """Compiles the detectors of a scene; on-surface ones take their faces from the face table."""

    def __init__(self, scene: Scene, faces: FaceTable) -> None:
        self.scene = scene
        self.faces = faces
        self.models = list(scene.detectors.items())
        self.entries: list[Detector] = []

    def fail(self, key: str, message: str) -> SceneError:
        return SceneError(f"{self.scene.origin}: detectors.{key}: {message}")

    def boxes(self) -> list[tuple[Array, Array]]:
        """Boxes of the detectors that have a place of their own."""
        found = []
        for _, model in self.models:
            if isinstance(model, ViewDetector):
                box = model.box()
                found += [] if box is None else [box]
            elif isinstance(model, DetectorModel) and model.kind in ("plane", "camera", "pinhole"):
                found.append(self.plane(model).bounds())
        return found

    @staticmethod
    def plane(model: DetectorModel) -> Rectangle:
        """The rectangle of a plane, or the one around the lens of a camera."""
        _, v, n = model.axes()
        size = model.size if model.kind == "plane" else (model.aperture, model.aperture)
        return Rectangle(np.array(model.position), np.cross(v, n), v, size)

    def compile(self) -> CompiledDetectors:
        """All detectors; fills ``entries`` for the directory, and marks the faces of maps.

        Raises
        ------
        SceneError
            for faces that are not there or cannot be mapped
        """
        n = len(self.models)
        integers = np.zeros((n, D_COLUMNS), np.int64)
        numbers = np.zeros((n, 16))
        views = Views(kind=np.zeros(n, np.int64), numbers=np.zeros((n, VIEW_ROW)))
        for k, (name, model) in enumerate(self.models):
            row, view = numbers[k], views.numbers[k]
            if isinstance(model, ViewDetector):
                self.entries.append(self._view(name, model, k, views))
                integers[k, :2] = self.entries[-1].cells
                integers[k, D_KIND] = detector_number(type(model))
                continue
            assert isinstance(model, DetectorModel)
            u, v, axis = model.axes()
            row[0:3], row[3:6], row[6:9], row[9:12] = model.position, u, v, axis
            row[12:14] = model.size
            if model.acceptance_deg < 90.0:
                row[14] = math.cos(math.radians(model.acceptance_deg))
            row[15] = model.both_sides or model.side == "both"
            view[0:12] = row[0:12]
            if model.kind == "surface":
                entry = self._surface(name, model, k, views)
            else:
                entry = self._entry(name, model, k, views)
            self.entries.append(entry)
            integers[k, :3] = (*entry.cells, model.virtual_plane)
        return CompiledDetectors(
            integers=integers,
            numbers=numbers,
            views=views if np.any(views.kind != NO_VIEW) else None,
            virtual=bool(np.any(integers[:, 2])),
        )

    def _view(self, name: str, model: ViewDetector, k: int, views: Views) -> Detector:
        """A detector of a kind of another distribution."""
        if model.cells is None:
            raise self.fail(f"{name}.cells", "is missing")
        if model.register is None:
            raise self.fail(name, f"its kind, of {type(model).__module__}, says no `register`")
        with asking(model, f"{self.scene.origin}: detectors.{name}"):
            return self._asked(name, model, model.cells, k, views)

    def _asked(
        self, name: str, model: ViewDetector, cells: tuple[int, int], k: int, views: Views
    ) -> Detector:
        u, v, axis = model.axes()
        views.kind[k] = VIEW_BY_KIND
        view = views.numbers[k]
        view[0:3], view[3:6], view[6:9], view[9:12] = model.center(), u, v, axis
        own = np.asarray(model.own(), np.float64)
        view[12 : 12 + len(own)] = own
        return Detector(
            name=name,
            kind=model.stored,
            cells=cells,
            center=model.center(),
            axis_u=tuple(u.tolist()),
            axis_v=tuple(v.tolist()),
            size=model.extent(),
            uv_meaning="projection",
            parameters={"kind": model.kind} | model.parameters(),
        )

    def _entry(self, name: str, model: DetectorModel, k: int, views: Views) -> Detector:
        """A detector that is no map of a face."""
        assert model.cells is not None
        view = views.numbers[k]
        u, v, axis = (tuple(vector.tolist()) for vector in model.axes())
        size, meaning, parameters = model.size, "crossing", _acceptance(model)
        kind = model.kind
        if model.kind == "far_field":
            views.kind[k] = FAR_FIELD
            view[12:14] = np.radians(model.gamma_deg)
            size = (360.0, model.gamma_deg[1] - model.gamma_deg[0])
            meaning = "projection"
            parameters = {
                "gamma_deg": list(model.gamma_deg),
                "angles": model.angles,
                "axis": list(axis),
                "size_unit": "deg",
            }
        elif model.kind in ("camera", "pinhole"):
            kind, meaning = "camera", "projection"
            half = model.half_fields()
            size = (2.0 * half[0], 2.0 * half[1])
            parameters = {
                "lens": "thin" if model.kind == "camera" else "pinhole",
                "half_field": list(half),
                "looks": list(axis),
                "size_unit": "tangent",
            }
            if model.kind == "camera":
                views.kind[k] = CAMERA
                view[12:16] = model.aperture / 2.0, 1.0 / model.focus, *half
                parameters["aperture_diameter"] = model.aperture
                if math.isfinite(model.focus):
                    parameters["focus_distance"] = model.focus
        names = [item.name for item in self.faces.objects]
        return Detector(
            name=name,
            kind=kind,  # type: ignore[arg-type]
            cells=model.cells,
            center=model.position,
            axis_u=u,
            axis_v=v,
            size=size,
            blocking=model.blocking,
            uv_meaning=meaning,  # type: ignore[arg-type]
            object=names.index(name) if model.blocking else -1,
            parameters=parameters,
        )

    # -- maps of faces -------------------------------------------------------------------------

    def _surface(self, name: str, model: DetectorModel, k: int, views: Views) -> Detector:
        """A map of a face; the face's primitives register in it."""
        number, face = self._face(name, model.face)
        item = self.faces.objects[number]
        mine = [
            index
            for index, primitive in enumerate(self.faces.primitives)
            if primitive.object == number
            and (
                face is None
                or face.first_primitive
                <= primitive.triangle
                < face.first_primitive + face.primitive_count
            )
        ]
        if any(self.faces.primitives[index].detector >= 0 for index in mine):
            raise self.fail(f"{name}.face", f"{model.face!r} has a detector already")
        if item.name in self.faces.placed:
            mesh = self.faces.placed[item.name]
            entry = self._triangles(name, model, k, views, mesh, face)
        else:
            entry = self._mapped(name, model, k, views, [self.faces.primitives[i] for i in mine])
        for index in mine:
            self.faces.primitives[index] = replace(self.faces.primitives[index], detector=k)
        return entry.model_copy(update={"object": number})

    def _face(self, name: str, wanted: str) -> tuple[int, Any]:
        """Object number and face of "body.face"; None for all faces of a body."""
        bodies = {item.name: k for k, item in enumerate(self.faces.objects)}
        if wanted in bodies:
            item = self.faces.objects[bodies[wanted]]
            if item.name in self.faces.placed:
                return bodies[wanted], None
            if len(item.faces) == 1:
                return bodies[wanted], item.faces[0]
        known = {
            label: (k, face)
            for k, item in enumerate(self.faces.objects)
            for face in item.faces
            for label in (f"{item.name}.{face.name}", *face.aliases)
        }
        if wanted not in known:
            raise self.fail(
                f"{name}.face", f"there is no face {wanted!r}{nearest_names(wanted, known)}"
            )
        return known[wanted]

    def _mapped(
        self, name: str, model: DetectorModel, k: int, views: Views, primitives: list[Any]
    ) -> Detector:
        if len(primitives) != 1:
            raise self.fail(
                f"{name}.face",
                f"{model.face!r} consists of {len(primitives)} pieces; only a face of one piece "
                "has a map",
            )
        if model.cells is None:
            raise self.fail(f"{name}.cells", f"is missing: the map of {model.face!r} needs it")
        found = map_face(primitives[0].shape, model.cells)
        views.kind[k] = found.kind
        row = views.numbers[k]
        row[0:3], row[3:6], row[6:9], row[9:12] = found.center, found.u, found.v, found.n
        row[12:15] = found.first, found.second, _SIDES[model.side]
        areas = found.areas
        sizes: dict[str, Any] = {"area_law": areas}
        if not isinstance(areas, dict):
            sizes = {"cell_area": areas if isinstance(areas, float) else _short(areas)}
        return Detector(
            name=name,
            kind="surface",
            cells=model.cells,
            center=tuple(found.center.tolist()),
            axis_u=tuple(found.u.tolist()),
            axis_v=tuple(found.v.tolist()),
            size=found.size,
            uv_meaning="projection",
            parameters={
                "face": model.face,
                "side": model.side,
                "mapping": found.mapping,
            }
            | sizes,
        )

    def _triangles(
        self,
        name: str,
        model: DetectorModel,
        k: int,
        views: Views,
        mesh: TriangleMesh,
        face: Any,
    ) -> Detector:
        if model.cells is not None:
            raise self.fail(
                f"{name}.cells",
                "a mesh has one cell per triangle; drop cells",
            )
        first = 0 if face is None else face.first_primitive
        count = len(mesh.triangles) if face is None else face.primitive_count
        columns = math.ceil(math.sqrt(count))
        rows = math.ceil(count / columns)
        views.kind[k] = TRIANGLE_MAP
        views.numbers[k, 12] = first
        views.numbers[k, 14] = _SIDES[model.side]
        areas = np.zeros(rows * columns)
        areas[:count] = mesh.areas[first : first + count]
        return Detector(
            name=name,
            kind="surface",
            cells=(columns, rows),
            center=tuple(mesh.vertices.mean(axis=0).tolist()),
            size=(float(columns), float(rows)),
            uv_meaning="projection",
            parameters={
                "face": model.face,
                "side": model.side,
                "mapping": "triangles",
                "first_primitive": first,
                "primitive_count": count,
                "size_unit": "cells",
                "cell_area": _short(areas),
            },
        )


def _acceptance(model: DetectorModel) -> dict[str, Any]:
    return {"acceptance_deg": model.acceptance_deg, "both_sides": model.both_sides}


def _short(values: Array) -> list[float]:
    """Eight digits are enough for an area, and keep the directory small."""
    return [float(f"{value:.8g}") for value in values.ravel()]
