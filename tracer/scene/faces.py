"""Bodies of a scene as numbered faces: objects for the map, primitives for the engine."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import DisplayMesh, Face, SceneObject
from raymap.model.errors import SceneError
from raymap.model.names import nearest_names
from tracer.bodies.body import Body, FacePlan
from tracer.bodies.lens import LensBody
from tracer.bodies.mesh import MeshBody
from tracer.description.asking import asking
from tracer.detectors.model import DetectorModel
from tracer.geometry.mesh import TriangleMesh
from tracer.geometry.other_shapes import OtherShape, check_shape
from tracer.geometry.shape_columns import ShapeColumns
from tracer.geometry.shapes import SEGMENTS, Polygon, Rectangle, Shape
from tracer.scene.meshes import MeshFace, MeshRegistry
from tracer.scene.model import Scene
from tracer.scene.resolve import resolve_bodies
from tracer.surfaces.absorber import Absorber
from tracer.surfaces.dielectric import Dielectric
from tracer.surfaces.registry import SURFACES
from tracer.surfaces.surface import Surface

__all__ = ["FaceTable", "Primitive", "given_parameters"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_DRAWN_FINELY = 1_000
"""So many bodies are drawn with round circles."""

_FEWEST = 12
"""Corners of a circle at least."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Primitive:
    """One analytic face on its way into the arrays."""

    shape: Shape
    object: int
    triangle: int
    surface: int
    inside: int = -1
    outside: int = -1
    detector: int = -1
    event: int = 0


_BUILT_IN: dict[str, Surface] = {"bare": Dielectric(), "absorber": Absorber()}
"""Surfaces that need no table."""


class FaceTable:
    """Numbers bodies, faces and surfaces.

    Attributes
    ----------
    bodies : by name, cemented faces filled in
    solids : names of the bodies with a medium and their numbers, in order
    surface_numbers : of all surfaces by name, those of the scene first
    objects, primitives, meshes, placed : filled by `build`; ``placed`` are triangles by body
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.bodies = resolve_bodies(scene)
        solid = (name for name, body in self.bodies.items() if body.medium is not None)
        self.solids = {name: number for number, name in enumerate(solid)}
        self.mesh_registry = MeshRegistry(Path(scene.folder))
        self.surface_numbers = {name: number for number, name in enumerate(scene.surfaces)}
        self.extra_surfaces: dict[str, Surface] = {}
        self.objects: list[SceneObject] = []
        self.primitives: list[Primitive] = []
        self.meshes: dict[int, DisplayMesh] = {}
        self.placed: dict[str, TriangleMesh] = {}
        self.segments = _segments(len(self.bodies))

    def fail(self, key: str, message: str) -> SceneError:
        return SceneError(f"{self.scene.origin}: {key}: {message}")

    def surface_models(self) -> list[tuple[str, Surface]]:
        """All surfaces that faces have, by number."""
        known = self.scene.surfaces | self.extra_surfaces
        return [(name, known[name]) for name in self.surface_numbers]

    def _surface_number(self, name: str | None, solid: bool, place: str) -> int:
        """Index of a surface by name; the default of solids is bare, others have none."""
        if name is None:
            if not solid:
                raise self.fail(
                    f"{place}.surface", 'is missing; name one of [surfaces.…], or say "absorber"'
                )
            name = "bare"
        if name not in self.surface_numbers:
            if name not in _BUILT_IN:
                raise self.fail(place, self._unknown_surface(name))
            self.surface_numbers[name] = len(self.surface_numbers)
            self.extra_surfaces[name] = _BUILT_IN[name]
        return self.surface_numbers[name]

    def _unknown_surface(self, name: str) -> str:
        """What is wrong with the name of a surface, and how to mend it."""
        known = dict.fromkeys([*self.scene.surfaces, *_BUILT_IN], 0)
        if name in SURFACES:
            return (
                f"there is no surface {name!r}; it is a kind: add [surfaces.{name}] with "
                f'kind = "{name}" and its numbers, then name that'
            )
        meant = nearest_names(name, known)
        return f"there is no surface {name!r}{meant} (or add [surfaces.{name}])"

    def build(self) -> None:
        """Number all faces: bodies first, then blocking detectors.

        Raises
        ------
        SceneError
        """
        cemented = {
            body.front.cemented: name
            for name, body in self.bodies.items()
            if isinstance(body, LensBody) and body.front.cemented is not None
        }
        for name, body in self.bodies.items():
            if isinstance(body, MeshBody):
                self._add_mesh(name, body)
            else:
                self._add_body(name, body, cemented.get(name))
        for number, (name, detector) in enumerate(self.scene.detectors.items()):
            if isinstance(detector, DetectorModel) and detector.blocking:
                u, v, _ = detector.axes()
                shape = Rectangle(np.array(detector.position), u, v, detector.size)
                self._add_detector(name, number, shape, detector.surface or "absorber")

    def _add_body(self, name: str, body: Body, back_partner: str | None) -> None:
        with asking(body, f"{self.scene.origin}: bodies.{name}"):
            plans = list(body.plan())
            if not plans or not all(isinstance(plan, FacePlan) for plan in plans):
                raise TypeError("plan() is no list of FacePlan")
        for plan in plans:
            for shape in plan.shapes:
                if isinstance(shape, OtherShape):
                    check_shape(shape, f"{self.scene.origin}: bodies.{name}.{plan.name}")
        self._check_face_names(name, body, [plan.name for plan in plans])
        solid = self.solids.get(name, -1)
        faces: list[Face] = []
        for plan in plans:
            surface = self._surface_number(
                body.faces.get(plan.name, plan.surface or body.surface),
                solid >= 0,
                f"bodies.{name}",
            )
            partner = back_partner if plan.name == "back" else None
            outside = self.solids[partner] if partner is not None else -1
            faces.append(self._face(plan, faces, surface, partner))
            self.primitives += [
                Primitive(
                    shape=shape,
                    object=len(self.objects),
                    triangle=faces[-1].first_primitive + k,
                    surface=surface,
                    inside=solid,
                    outside=outside,
                    event=plan.event,
                )
                for k, shape in enumerate(plan.shapes)
            ]
        self._add_object(
            name, body.kind, faces, _mesh(plans, self.segments), given_parameters(body)
        )

    def _add_detector(self, name: str, number: int, shape: Rectangle, surface_name: str) -> None:
        surface = self._surface_number(surface_name, True, f"detectors.{name}.surface")
        plan = FacePlan(name="front", shapes=(shape,))
        self.primitives.append(
            Primitive(
                shape=shape,
                object=len(self.objects),
                triangle=0,
                surface=surface,
                detector=number,
            )
        )
        self._add_object(
            name,
            "detector",
            [self._face(plan, [], surface, None)],
            _mesh([plan], self.segments),
            {},
        )

    def _add_mesh(self, name: str, body: MeshBody) -> None:
        """Names of a mesh's faces, and a start bin for each of them."""
        mesh = self.mesh_registry.place(name, body, len(self.primitives))
        self.placed[name] = mesh
        self._check_face_names(name, body, list(mesh.face_names))
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        margin = 1e-9 * (1.0 + float(np.abs([low, high]).max()))
        solid = self.solids.get(name, -1)
        faces: list[Face] = []
        first = 0
        for face_name, count in zip(mesh.face_names, mesh.face_counts.tolist(), strict=True):
            surface = self._surface_number(
                body.faces.get(face_name, body.surface), solid >= 0, f"bodies.{name}"
            )
            faces.append(
                Face(name=face_name, first_primitive=first, primitive_count=count, surface=surface)
            )
            self.primitives.append(
                Primitive(
                    shape=MeshFace(low - margin, high + margin),
                    object=len(self.objects),
                    triangle=first,
                    surface=surface,
                    inside=solid,
                )
            )
            first += count
        self._add_object(name, "mesh", faces, mesh.display(), given_parameters(body))

    def _add_object(
        self, name: str, kind: str, faces: list[Face], mesh: DisplayMesh, parameters: dict[str, Any]
    ) -> None:
        self.meshes[len(self.objects)] = mesh
        self.objects.append(
            SceneObject(name=name, kind=kind, faces=tuple(faces), parameters=parameters)
        )

    def shapes(self) -> dict[str, list[Shape]]:
        """Shapes of every face by its full name."""
        found: dict[str, list[Shape]] = {
            f"{item.name}.{face.name}": [] for item in self.objects for face in item.faces
        }
        for primitive in self.primitives:
            item = self.objects[primitive.object]
            for face in item.faces:
                if 0 <= primitive.triangle - face.first_primitive < face.primitive_count:
                    found[f"{item.name}.{face.name}"].append(primitive.shape)
        return found

    def _check_face_names(self, name: str, body: Body, known: list[str]) -> None:
        unknown = sorted(set(body.faces) - set(known))
        if unknown:
            raise self.fail(
                f"bodies.{name}.faces.{unknown[0]}",
                f"a {body.kind} has no such face{nearest_names(unknown[0], known)}",
            )

    def _face(self, plan: FacePlan, before: list[Face], surface: int, partner: str | None) -> Face:
        first = before[-1].first_primitive + before[-1].primitive_count if before else 0
        return Face(
            name=plan.name,
            first_primitive=first,
            primitive_count=len(plan.shapes),
            surface=surface,
            aliases=(f"{partner}.front",) if partner else (),
            quadrics=tuple(shape.quadric() for shape in plan.shapes),
        )

    def rows(self, shapes: ShapeColumns) -> tuple[Integers, Array, Array]:
        """``face_i``, ``face_f`` and ``pool`` of `CompiledScene`."""
        integers = []
        rows = shapes.row.copy()
        pool: list[Array] = []
        for k, p in enumerate(self.primitives):
            if isinstance(p.shape, Polygon):
                planes = p.shape.half_planes()
                rows[k, 6:8] = len(pool), len(planes)
                pool += list(planes)
            elif isinstance(p.shape, OtherShape):
                own = np.asarray(p.shape.own(), np.float64)
                rows[k, 9:11] = 4 * len(pool), len(own)
                pool += list(np.pad(own, (0, -len(own) % 4)).reshape(-1, 4))
            integers.append(
                (
                    p.shape.kind, p.object, p.triangle, p.surface, p.inside, p.outside, p.detector,
                    p.event, shapes.axis[k],
                )
            )  # fmt: skip
        return (
            np.array(integers, np.int64).reshape(-1, 9),
            rows,
            np.array(pool, float).reshape(-1),
        )


def _segments(bodies: int) -> int:
    """Corners that a circle is drawn with: fewer where there are very many bodies."""
    return max(_FEWEST, min(SEGMENTS, SEGMENTS * _DRAWN_FINELY // max(1, bodies)))


def _mesh(plans: list[FacePlan], segments: int) -> DisplayMesh:
    meshes = [shape.mesh(segments) for plan in plans for shape in plan.shapes]
    numbers = [number for number, plan in enumerate(plans) for _ in plan.shapes]
    bases = np.cumsum([0, *(len(points) for points, _ in meshes[:-1])])
    counts = [len(corners) for _, corners in meshes]
    triangles = np.concatenate([corners for _, corners in meshes])
    return DisplayMesh(
        vertices=np.concatenate([points for points, _ in meshes]).astype(np.float32),
        triangles=(triangles + np.repeat(bases, counts)[:, None]).astype(np.int32),
        face=np.repeat(np.array(numbers, np.int32), counts),
    )


def given_parameters(model: Any) -> dict[str, Any]:
    """What the user gave, as plain values that JSON can hold."""
    given: dict[str, Any] = json.loads(model.model_dump_json(exclude_unset=True))
    given.pop("kind", None)
    return given
