"""From a validated scene to plain arrays for the engine and names for the map."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.directory import (
    BoundingSphere,
    ChannelSet,
    Detector,
    Directory,
    DisplayMesh,
    Face,
    SceneObject,
    Source,
    Surface,
)
from raymap.errors import SceneError
from tracer.geometry.bodies import Body, FacePlan, LensBody, MeshBody
from tracer.geometry.kinds import ANNULUS, CYLINDER, MESH, RECTANGLE, ROW, SPHERE
from tracer.geometry.mesh import TriangleMesh
from tracer.geometry.shapes import Polygon, Rectangle, Shape
from tracer.scene.arrays import (
    ABSORBER,
    COLLIMATED,
    DIELECTRIC,
    F_KIND,
    FROM_DISC,
    FROM_POINT,
    FROM_RECTANGLE,
    LAMBERTIAN,
    LAMBERTIAN_CONE,
    M_PARTICIPATING,
    S_KIND,
    S_MODEL,
    S_TABLE,
    SOURCE_ROW,
    UNIFORM_CONE,
    CompiledScene,
    RareLight,
)
from tracer.scene.candidates import find_candidates, main_axis
from tracer.scene.checks import check_lenses
from tracer.scene.load import _nearest
from tracer.scene.media import medium_table
from tracer.scene.meshes import MeshFace, MeshShelf, SceneMeshes
from tracer.scene.model import RGB_NM, Scene, SourceModel, SurfaceModel, cone_cosine
from tracer.scene.rare_light import compile_rare_light
from tracer.scene.surfaces import SurfaceTable
from tracer.sources import deal_rays

__all__ = ["Compilation", "compile_scene", "resolve_bodies"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Compilation:
    """A scene ready to trace: arrays for the engine, names, channels and meshes for the map.

    ``meshes`` are drawn; ``solids`` are the triangles that light meets, None without mesh bodies.
    """

    scene: Scene
    arrays: CompiledScene
    directory: Directory
    channel_set: ChannelSet
    meshes: dict[int, DisplayMesh]
    solids: SceneMeshes | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Primitive:
    """One analytic face on its way into the arrays."""

    shape: Shape
    object: int
    triangle: int
    surface: int
    inside: int
    outside: int
    detector: int
    event: int


def compile_scene(scene: Scene) -> Compilation:
    """Turn a scene into arrays, directory, channels and display meshes.

    Raises
    ------
    SceneError
        names that nothing carries, impossible or overlapping bodies, no source
    """
    return _Compiler(scene).compile()


def resolve_bodies(scene: Scene) -> dict[str, Body]:
    """The bodies with cemented faces filled in, each checked on its own.

    Raises
    ------
    SceneError
        impossible shapes, a cement partner that is missing or elsewhere
    """
    lenses = {n: b for n, b in scene.bodies.items() if isinstance(b, LensBody)}
    bodies: dict[str, Body] = {}
    for name, body in scene.bodies.items():
        place = f"{scene.origin}: bodies.{name}"
        if isinstance(body, LensBody) and body.front.cemented is not None:
            partner = lenses.get(body.front.cemented)
            if partner is None or partner is body:
                raise SceneError(
                    f"{place}.front.cemented: there is no lens {body.front.cemented!r} before "
                    f"it{_nearest(body.front.cemented, lenses)}"
                )
            origin, frame = partner.frame()
            vertex = origin + partner.thickness * frame[:, 2]
            gap = float(np.linalg.norm(np.array(body.position) - vertex))
            if gap > 1e-9 or not np.allclose(frame, body.frame()[1], atol=1e-12):
                raise SceneError(
                    f"{place}.position: the cemented front lies {gap:.4g} away from the back of "
                    f"{body.front.cemented!r} or is turned; put it at {vertex.tolist()}"
                )
            shape = partner.back.model_copy(update={"cemented": body.front.cemented})
            body = body.model_copy(update={"front": shape})
        problems = body.problems()
        if problems:
            raise SceneError(f"{place}.{problems[0]}")
        bodies[name] = body
    check_lenses(bodies, scene.origin)
    return bodies


class _Compiler:
    """Numbers everything that the scene names."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.wavelengths = scene.spectrum.channels()
        self.media = medium_table(scene, self.wavelengths)
        self.bodies = resolve_bodies(scene)
        for name, body in self.bodies.items():
            if body.medium is not None:
                self.media.number(body.medium, f"bodies.{name}.medium")
        self.solids = [name for name, body in self.bodies.items() if body.medium is not None]
        self.shelf = MeshShelf(Path(scene.folder))
        self.surface_names = list(scene.surfaces)
        self.extra_surfaces: dict[str, SurfaceModel] = {}
        self.detector_names = list(scene.detectors)

    def fail(self, key: str, message: str) -> SceneError:
        return SceneError(f"{self.scene.origin}: {key}: {message}")

    def compile(self) -> Compilation:
        scene = self.scene
        if not any(source.on for source in scene.sources.values()):
            raise self.fail(
                "sources",
                "there is no source that is on; add [sources.NAME], or set on = true",
            )
        objects, primitives, meshes = self._objects()
        low, high = self._extent(primitives)
        center = (low + high) / 2.0
        radius = 1.05 * float(np.linalg.norm(high - low)) / 2.0 + 1e-6
        face_i, face_f, pool = self._faces(primitives)
        surface_table = SurfaceTable(self.media, self.wavelengths, scene.origin)
        surface_i, surface_f, tables = surface_table.compile(self._surface_models())
        source_i, source_f, pattern, boxes = self._sources()
        detector_i, detector_f = self._detectors()
        candidates = find_candidates([p.shape for p in primitives], boxes)
        rare = self._rare_light(objects, primitives)
        arrays = CompiledScene(
            face_i=face_i,
            face_f=face_f,
            pool=None if set(face_i[:, F_KIND].tolist()) <= _COMMON_FACES else pool,
            surface_i=surface_i,
            surface_f=surface_f,
            medium_i=self.media.integers,
            medium_f=self.media.numbers,
            body_i=np.array(
                [
                    (self.media.number(body.medium or ""), body.priority)
                    for body in (self.bodies[name] for name in self.solids)
                ],
                np.int64,
            ).reshape(-1, 2),
            source_i=source_i,
            source_f=source_f,
            detector_i=detector_i,
            detector_f=detector_f,
            pattern=pattern,
            first=candidates.first,
            face=candidates.face,
            distance=candidates.distance,
            settle=candidates.settle,
            settles=candidates.settles,
            tables=tables if rare or _needs_tables(surface_i, self.media.integers) else None,
            sphere=np.array([*center, radius]),
            limits=np.array(
                [
                    scene.limits.depth,
                    self.media.number(scene.world.medium),
                    any(not detector.blocking for detector in scene.detectors.values()),
                ],
                np.int64,
            ),
            rare=rare,
        )
        directory = self._directory(objects, center, radius)
        return Compilation(
            scene=scene,
            arrays=arrays,
            directory=directory,
            channel_set=self._channel_set(source_f[:, SOURCE_ROW:]),
            meshes=meshes,
            solids=self.shelf.finish(),
        )

    def _rare_light(
        self, objects: list[SceneObject], primitives: list[_Primitive]
    ) -> RareLight | None:
        """What the weighted mode does differently, with the shapes that light is aimed at."""
        faces: dict[str, list[Shape]] = {
            f"{item.name}.{face.name}": [] for item in objects for face in item.faces
        }
        for primitive in primitives:
            item = objects[primitive.object]
            for face in item.faces:
                if 0 <= primitive.triangle - face.first_primitive < face.primitive_count:
                    faces[f"{item.name}.{face.name}"].append(primitive.shape)
        planes = {}
        for name, detector in self.scene.detectors.items():
            u, v, _ = detector.axes()
            plane = Rectangle(np.array(detector.position), u, v, detector.size)
            planes[name] = (plane, detector.both_sides)
        return compile_rare_light(self.scene.trace, faces, planes, self.scene.origin)

    # -- bodies and faces ----------------------------------------------------------------------

    def _surface_number(self, name: str | None, solid: bool, place: str) -> int:
        """Index of a surface by name; the default of solids is bare, of sheets there is none."""
        if name is None:
            if not solid:
                raise self.fail(f"{place}.surface", "is missing; name one of [surfaces.…]")
            name = "bare"
        if name not in self.surface_names:
            builtin = {
                "bare": SurfaceModel(kind="dielectric"),
                "absorber": SurfaceModel(kind="absorber"),
            }
            if name not in builtin:
                raise self.fail(
                    place,
                    f"there is no surface {name!r}{_nearest(name, self.scene.surfaces)}",
                )
            self.surface_names.append(name)
            self.extra_surfaces[name] = builtin[name]
        return self.surface_names.index(name)

    def _objects(self) -> tuple[list[SceneObject], list[_Primitive], dict[int, DisplayMesh]]:
        objects: list[SceneObject] = []
        primitives: list[_Primitive] = []
        meshes: dict[int, DisplayMesh] = {}
        cemented = {
            body.front.cemented: name
            for name, body in self.bodies.items()
            if isinstance(body, LensBody) and body.front.cemented is not None
        }
        for name, body in self.bodies.items():
            if isinstance(body, MeshBody):
                mesh = self.shelf.place(name, body, len(primitives))
                meshes[len(objects)] = mesh.display()
                objects.append(self._mesh_object(name, body, mesh, len(objects), primitives))
                continue
            plans = body.plan()
            self._check_face_names(name, body, [plan.name for plan in plans])
            solid = self.solids.index(name) if name in self.solids else -1
            faces: list[Face] = []
            for plan in plans:
                surface = self._surface_number(
                    body.faces.get(plan.name, plan.surface or body.surface),
                    solid >= 0,
                    f"bodies.{name}",
                )
                partner = cemented.get(name) if plan.name == "back" else None
                outside = self.solids.index(partner) if partner is not None else -1
                faces.append(self._face(plan, faces, surface, partner))
                primitives += [
                    _Primitive(
                        shape=shape,
                        object=len(objects),
                        triangle=faces[-1].first_primitive + k,
                        surface=surface,
                        inside=solid,
                        outside=outside,
                        detector=-1,
                        event=plan.event,
                    )
                    for k, shape in enumerate(plan.shapes)
                ]
            meshes[len(objects)] = _mesh(plans)
            objects.append(
                SceneObject(
                    name=name, kind=body.kind, faces=tuple(faces), parameters=_parameters(body)
                )
            )
        for number, (name, detector) in enumerate(self.scene.detectors.items()):
            if not detector.blocking:
                continue
            u, v, _ = detector.axes()
            shape = Rectangle(np.array(detector.position), u, v, detector.size)
            surface = self._surface_number(
                detector.surface or "absorber", True, f"detectors.{name}.surface"
            )
            plan = FacePlan(name="front", shapes=(shape,))
            primitives.append(
                _Primitive(
                    shape=shape,
                    object=len(objects),
                    triangle=0,
                    surface=surface,
                    inside=-1,
                    outside=-1,
                    detector=number,
                    event=0,
                )
            )
            meshes[len(objects)] = _mesh([plan])
            objects.append(
                SceneObject(
                    name=name, kind="detector", faces=(self._face(plan, [], surface, None),)
                )
            )
        return objects, primitives, meshes

    def _mesh_object(
        self,
        name: str,
        body: MeshBody,
        mesh: TriangleMesh,
        number: int,
        primitives: list[_Primitive],
    ) -> SceneObject:
        """Names of a mesh's faces, and a place of departure for each of them."""
        self._check_face_names(name, body, list(mesh.face_names))
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        margin = 1e-9 * (1.0 + float(np.abs([low, high]).max()))
        solid = self.solids.index(name) if name in self.solids else -1
        faces = []
        first = 0
        for face_name, count in zip(mesh.face_names, mesh.face_counts.tolist(), strict=True):
            surface = self._surface_number(
                body.faces.get(face_name, body.surface), solid >= 0, f"bodies.{name}"
            )
            faces.append(
                Face(name=face_name, first_primitive=first, primitive_count=count, surface=surface)
            )
            primitives.append(
                _Primitive(
                    shape=MeshFace(low - margin, high + margin),
                    object=number,
                    triangle=first,
                    surface=surface,
                    inside=solid,
                    outside=-1,
                    detector=-1,
                    event=0,
                )
            )
            first += count
        return SceneObject(name=name, kind="mesh", faces=tuple(faces), parameters=_parameters(body))

    def _check_face_names(self, name: str, body: Body, known: list[str]) -> None:
        unknown = sorted(set(body.faces) - set(known))
        if unknown:
            raise self.fail(
                f"bodies.{name}.faces.{unknown[0]}",
                f"a {body.kind} has no such face{_nearest(unknown[0], dict.fromkeys(known, 0))}",
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

    def _extent(self, primitives: list[_Primitive]) -> tuple[Array, Array]:
        boxes = [primitive.shape.bounds() for primitive in primitives]
        boxes += [_source_box(source) for source in self.scene.sources.values()]
        for detector in self.scene.detectors.values():
            u, v, _ = detector.axes()
            boxes.append(Rectangle(np.array(detector.position), u, v, detector.size).bounds())
        return np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)

    def _faces(self, primitives: list[_Primitive]) -> tuple[Integers, Array, Array]:
        integers, rows = [], []
        pool: list[Array] = []
        for p in primitives:
            row = p.shape.row()
            if isinstance(p.shape, Polygon):
                planes = p.shape.half_planes()
                row[6], row[7] = len(pool), len(planes)
                pool += list(planes)
            rows.append(row)
            integers.append(
                (
                    p.shape.kind, p.object, p.triangle, p.surface, p.inside, p.outside, p.detector,
                    p.event, main_axis(p.shape),
                )
            )  # fmt: skip
        return (
            np.array(integers, np.int64).reshape(-1, 9),
            np.array(rows).reshape(-1, ROW),
            np.array(pool, float).reshape(-1),
        )

    # -- surfaces, sources, detectors ------------------------------------------------------------

    def _surface_models(self) -> list[tuple[str, SurfaceModel]]:
        known = self.scene.surfaces | self.extra_surfaces
        return [(name, known[name]) for name in self.surface_names]

    def _sources(self) -> tuple[Integers, Array, Integers, list[tuple[Array, Array, Array]]]:
        models = list(self.scene.sources.items())
        shapes = np.zeros((len(models), SOURCE_ROW))
        areas, directions, nests, boxes = [], [], [], []
        colors = np.zeros((len(models), len(self.wavelengths)))
        for k, (name, model) in enumerate(models):
            origin, frame = model.frame()
            s = shapes[k]
            s[0:3], s[3:6], s[6:9], s[9:12] = origin, frame[:, 2], frame[:, 0], frame[:, 1]
            if model.size is not None:
                areas.append(FROM_RECTANGLE)
                s[12], s[13] = model.size[0] / 2.0, model.size[1] / 2.0
            elif model.diameter is not None:
                areas.append(FROM_DISC)
                s[12], s[13] = model.inner_diameter / 2.0, model.diameter / 2.0
            else:
                areas.append(FROM_POINT)
            s[14] = cone_cosine(model)
            s[15:18] = frame[:, 2]
            s[18:21] = frame[:, 2] if model.kind != "point" else 0.0
            kinds = {
                "collimated": COLLIMATED, "lambertian": LAMBERTIAN_CONE, "point": UNIFORM_CONE,
            }  # fmt: skip
            directions.append(kinds[model.kind])
            colors[k] = self._source_color(name, model)
            nests.append(self._source_nest(name, model))
            beam = frame[:, 2] if model.kind == "collimated" else np.zeros(3)
            boxes.append((*_source_box(model), beam))
        n_channels = len(self.wavelengths)
        codes = [
            int(np.argmax(color)) if color.max() == 1.0 else n_channels + k
            for k, color in enumerate(colors)
        ]
        shares = np.array([(model.share or model.flux) if model.on else 0.0 for _, model in models])
        media = [
            self.media.number(self.bodies[self.solids[nest - 1]].medium or "")
            if nest
            else self.media.number(self.scene.world.medium)
            for nest in nests
        ]
        integers = np.array([areas, directions, codes, nests, media], np.int64).T.copy()
        return integers, np.hstack([shapes, colors]), deal_rays(shares), boxes

    def _source_color(self, name: str, model: SourceModel) -> Array:
        if model.spectrum == "white":
            color = np.ones(len(self.wavelengths))
        else:
            color = model.spectrum.at(self.wavelengths, np.array(RGB_NM))
        if color.min() < 0.0 or color.sum() <= 0.0:
            raise self.fail(
                f"sources.{name}.spectrum",
                "has no light at the channels of the trace, or negative light; check the table",
            )
        return np.asarray(color / color.sum())

    def _source_nest(self, name: str, model: SourceModel) -> int:
        if model.inside is None:
            return 0
        if model.inside not in self.solids:
            raise self.fail(
                f"sources.{name}.inside",
                f"there is no solid {model.inside!r}{_nearest(model.inside, self.bodies)}",
            )
        return self.solids.index(model.inside) + 1

    def _detectors(self) -> tuple[Integers, Array]:
        integers, frames = [], []
        for detector in self.scene.detectors.values():
            u, v, n = detector.axes()
            accepted = 0.0
            if detector.acceptance_deg < 90.0:
                accepted = math.cos(math.radians(detector.acceptance_deg))
            frames.append(
                [*detector.position, *u, *v, *n, *detector.size, accepted, detector.both_sides]
            )
            integers.append((*detector.cells, not detector.blocking))
        return (
            np.array(integers, np.int64).reshape(-1, 3),
            np.array(frames, float).reshape(-1, 16),
        )

    # -- names -------------------------------------------------------------------------------------

    def _directory(self, objects: list[SceneObject], center: Array, radius: float) -> Directory:
        scene = self.scene
        names = [item.name for item in objects]
        directory = Directory(
            length_unit=scene.length_unit,
            flux_unit=scene.flux_unit,
            sources=tuple(
                Source(name=name, flux=model.flux, kind=model.kind, parameters=_parameters(model))
                for name, model in scene.sources.items()
            ),
            objects=tuple(objects),
            media=self.media.entries,
            surfaces=tuple(
                Surface(name=name, kind=model.kind, parameters=_parameters(model))
                for name, model in self._surface_models()
            ),
            detectors=tuple(
                Detector(
                    name=name,
                    cells=model.cells,
                    center=model.position,
                    axis_u=tuple(model.axes()[0].tolist()),
                    axis_v=tuple(model.axes()[1].tolist()),
                    size=model.size,
                    blocking=model.blocking,
                    object=names.index(name) if model.blocking else -1,
                    parameters={
                        "acceptance_deg": model.acceptance_deg,
                        "both_sides": model.both_sides,
                    },
                )
                for name, model in scene.detectors.items()
            ),
            bounding_sphere=BoundingSphere(center=tuple(center.tolist()), radius=radius),
            scene_text=scene.text,
            title=scene.title,
        )
        return directory.model_copy(update={"scene_hash": _scene_hash(scene)})

    def _channel_set(self, colors: Array) -> ChannelSet:
        from raymap.colorimetry import channel_display_rgb, luminous_efficacy

        rgb = self.scene.spectrum.kind == "rgb"
        unit = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        display = unit if rgb else _rows(channel_display_rgb(self.wavelengths))
        luminous = (0.2126, 0.7152, 0.0722) if rgb else tuple(luminous_efficacy(self.wavelengths).tolist())  # fmt: skip # noqa: E501
        return ChannelSet(
            kind=self.scene.spectrum.kind,
            wavelengths_nm=tuple(self.wavelengths.tolist()),
            luminous=luminous,
            display_rgb=display,
            refractive_index=_rows(self.media.index),
            absorption=_rows(self.media.absorption),
            source_colors=_rows(colors),
        )


_COMMON_FACES = {ANNULUS, RECTANGLE, SPHERE, CYLINDER, MESH}


def _needs_tables(surface_i: Integers, medium_i: Integers) -> bool:
    """Whether the engine must know more than plain surfaces and clear media."""
    plain = np.isin(surface_i[:, S_KIND], (ABSORBER, DIELECTRIC, LAMBERTIAN))
    plain &= (surface_i[:, S_TABLE] < 0) & (surface_i[:, S_MODEL] != 2)
    return not bool(np.all(plain)) or bool(np.any(medium_i[:, M_PARTICIPATING]))


def _rows(array: Array) -> Any:
    return tuple(tuple(row) for row in np.asarray(array, float).tolist())


def _source_box(model: SourceModel) -> tuple[Array, Array]:
    origin, frame = model.frame()
    if model.size is not None:
        reach = np.abs(frame[:, :2]) @ (np.array(model.size) / 2.0)
    elif model.diameter is not None:
        axis = frame[:, 2]
        reach = np.sqrt(np.maximum(0.0, 1.0 - axis * axis)) * model.diameter / 2.0
    else:
        reach = np.zeros(3)
    return origin - reach - 1e-9, origin + reach + 1e-9


def _mesh(plans: list[FacePlan]) -> DisplayMesh:
    vertices, triangles, faces = [], [], []
    base = 0
    for number, plan in enumerate(plans):
        for shape in plan.shapes:
            points, corners = shape.mesh()
            vertices.append(points)
            triangles.append(corners + base)
            faces.append(np.full(len(corners), number))
            base += len(points)
    return DisplayMesh(
        vertices=np.concatenate(vertices).astype(np.float32),
        triangles=np.concatenate(triangles).astype(np.int32),
        face=np.concatenate(faces).astype(np.int32),
    )


def _parameters(model: Any) -> dict[str, Any]:
    """What the user gave, as plain values that JSON can hold."""
    given: dict[str, Any] = json.loads(model.model_dump_json(exclude_unset=True))
    given.pop("kind", None)
    return given


_HASHED = (
    "length_unit", "flux_unit", "world", "media", "surfaces", "bodies", "sources", "detectors",
)  # fmt: skip


def _scene_hash(scene: Scene) -> str:
    """Hash of geometry, media, surfaces, sources and detectors."""
    parts = scene.model_dump(
        mode="json",
        include=set(_HASHED),
    )
    text = json.dumps(parts, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]
