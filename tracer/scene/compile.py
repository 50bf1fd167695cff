"""From a validated scene to plain arrays for the engine and names for the map."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.jit.collecting import no_collecting
from raymap.laws.law import Law
from raymap.laws.stored import stored_laws
from raymap.model.directory import (
    BoundingSphere,
    ChannelSet,
    Directory,
    DisplayMesh,
    Source,
    Surface,
)
from raymap.model.errors import SceneError
from raymap.model.limits import MAX_INDEX, MAX_NAME
from raymap.model.plaintext import plain_text
from tracer.compiled import (
    ABSORBER,
    DIELECTRIC,
    F_DETECTOR,
    F_INSIDE,
    F_KIND,
    F_SURFACE,
    LAMBERTIAN,
    M_PARTICIPATING,
    S_KIND,
    S_MODEL,
    S_SCATTER,
    CompiledScene,
    VarianceReduction,
)
from tracer.description.named_files import named_file, noting_files
from tracer.detectors.model import DetectorModel
from tracer.geometry.kinds import ANNULUS, CYLINDER, MESH, RECTANGLE, SPHERE
from tracer.geometry.shape_columns import ShapeColumns
from tracer.scene.arrangement.candidates import Candidates, StartBins
from tracer.scene.arrangement.coincident_faces import find_coincident_faces
from tracer.scene.arrangement.coincident_triangles import warn_of_coincident_triangles
from tracer.scene.arrangement.open_surfaces import warn_of_hidden_surfaces
from tracer.scene.crystals import carried_waves
from tracer.scene.detectors import DetectorTable
from tracer.scene.faces import FaceTable, given_parameters
from tracer.scene.inputs import file_hash, inputs_of, taking_part
from tracer.scene.media import medium_table
from tracer.scene.meshes import SceneMeshes
from tracer.scene.model import Scene
from tracer.scene.resolve import resolve_bodies
from tracer.scene.source_faces import lift_off_faces
from tracer.scene.sources import CompiledSources, SourceTable
from tracer.scene.surfaces import compile_surfaces
from tracer.scene.variance_reduction import compile_variance_reduction
from tracer.surfaces.scatter_check import check_laws, check_scatter

__all__ = ["Compilation", "compile_scene", "resolve_bodies"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Compilation:
    """A scene ready to trace: arrays for the engine, names, channels and meshes for the map.

    ``meshes`` are drawn; ``solids`` are the triangles that light meets, None without mesh bodies;
    ``start_bins`` makes the lists of faces that a ray can meet next.
    """

    scene: Scene
    arrays: CompiledScene
    directory: Directory
    channel_set: ChannelSet
    meshes: dict[int, DisplayMesh]
    start_bins: StartBins
    solids: SceneMeshes | None = None

    def ordered(self, met: Integers) -> Compilation:
        """The scene with faces in the order in which rays met them (see `StartBins`)."""
        found = self.start_bins.candidates(met)
        return replace(self, arrays=self.arrays._replace(**_lists(found, self.arrays.plain)))


def compile_scene(scene: Scene) -> Compilation:
    """Turn a scene into arrays, directory, channels and display meshes.

    Raises
    ------
    SceneError
        names that nothing carries, impossible or overlapping bodies, no source
    """
    with no_collecting(), noting_files() as noted:
        compiled = _Compiler(scene).compile()
    inputs = inputs_of(scene, noted)
    return replace(compiled, directory=compiled.directory.model_copy(update={"inputs": inputs}))


class _Compiler:
    """Numbers everything that the scene names."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.wavelengths = scene.spectrum.channels()
        self.media = medium_table(scene, self.wavelengths)
        self.faces = FaceTable(scene)
        self.bodies = self.faces.bodies
        self._check_counts()
        for name, body in self.bodies.items():
            if body.medium is not None:
                self.media.number(body.medium, f"bodies.{name}.medium")
        self.detectors = DetectorTable(scene, self.faces)

    def fail(self, key: str, message: str) -> SceneError:
        return SceneError(f"{self.scene.origin}: {key}: {message}")

    def _check_counts(self) -> None:
        """Refuse what a map cannot number before anything is worked out for it."""
        scene = self.scene
        blocking = sum(
            isinstance(detector, DetectorModel) and detector.blocking
            for detector in scene.detectors.values()
        )
        for key, count, what in (
            ("bodies", len(self.bodies) + blocking, "bodies and blocking detectors"),
            ("sources", len(scene.sources), "sources"),
            ("detectors", len(scene.detectors), "detectors"),
            ("media", len(scene.media), "media"),
            ("surfaces", len(scene.surfaces), "surfaces"),
        ):
            if count > MAX_INDEX:
                raise self.fail(
                    key, f"there are {count} {what}; a ray map numbers at most {MAX_INDEX}"
                )
        for key in ("bodies", "sources", "detectors", "media", "surfaces"):
            for name in getattr(scene, key):
                if not 0 < len(plain_text(name)) <= MAX_NAME:
                    raise self.fail(key, f"names have 1 to {MAX_NAME} characters, not {len(name)}")

    def compile(self) -> Compilation:
        scene, faces = self.scene, self.faces
        if scene.contacts and not scene.crystalline:
            raise self.fail(
                "contacts",
                "is for scenes with crystals; faces of other bodies that touch are found and "
                "need no mention: drop it",
            )
        if not any(source.on for source in scene.sources.values()):
            raise self.fail(
                "sources",
                "there is no source that is on; add [sources.NAME], or set on = true",
            )
        faces.build()
        world = self.media.number(scene.world.medium)
        stacks = {
            name: (k + 1, self.media.number(self.bodies[name].medium or ""))
            for k, name in enumerate(faces.solids)
        }
        sources = SourceTable(scene, self.wavelengths, stacks, world).compile()
        detectors = self.detectors.compile()
        shapes = ShapeColumns.of_shapes([primitive.shape for primitive in faces.primitives])
        center, radius = self._extent(shapes, sources)
        sources = lift_off_faces(sources, shapes, 1e-9 * radius)
        face_i, face_f, pool = faces.rows(shapes)
        surface_i, surface_f, tables, laws = compile_surfaces(
            faces.surface_models(), self.media, self.wavelengths, scene.origin
        )
        start_bins = StartBins(shapes, sources.boxes)
        reduction = self._variance_reduction()
        plain = _plain_faces(face_i, surface_i, self.media.integers)
        if reduction is not None or detectors.virtual or detectors.views is not None:
            plain[:] = 0
        coincident = find_coincident_faces(
            shapes,
            [p.object for p in faces.primitives],
            [p.inside >= 0 for p in faces.primitives],
            radius,
        )
        if faces.placed:
            owners = [faces.objects[p.object].name for p in faces.primitives]
            warn_of_coincident_triangles(
                faces.placed, shapes, owners, faces.solids, radius, scene.origin
            )
        warn_of_hidden_surfaces(
            coincident,
            faces.primitives,
            [item.name for item in faces.objects],
            [model for _, model in faces.surface_models()],
            radius,
            scene.origin,
        )
        if coincident is not None:
            plain[np.diff(coincident.first) > 0] = 0
        channels = self._channel_set(sources.colors, laws)
        carried = carried_waves(scene, faces, self.media, coincident, laws, channels)
        if carried is not None:
            # Laws of surfaces say what natural light does
            channels = channels.model_copy(update={"laws": {}})
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
                    for body in (self.bodies[name] for name in faces.solids)
                ],
                np.int64,
            ).reshape(-1, 2),
            source_i=sources.integers,
            source_f=sources.numbers,
            detector_i=detectors.integers,
            detector_f=detectors.numbers,
            pattern=sources.pattern,
            **_lists(start_bins.candidates(), plain),
            plain=plain,
            tables=tables if _needs_tables(surface_i, self.media.integers) else None,
            sphere=np.array([*center, radius, *detectors.box(1e-9 * radius)]),
            limits=np.array(
                [scene.limits.depth, world, detectors.virtual, carried is not None], np.int64
            ),
            reduction=reduction,
            coincident=coincident,
            light_pool=sources.pool,
            light_rays=sources.rays,
            views=detectors.views,
            carried=carried,
        )
        surfaces = [name for name, _ in faces.surface_models()]
        check_scatter(arrays, surfaces, self._channel_names(), scene.origin)
        check_laws(arrays, faces.surface_models(), scene.origin)
        return Compilation(
            scene=scene,
            arrays=arrays,
            directory=self._directory(center, radius, sources.fluxes),
            channel_set=channels,
            meshes=faces.meshes,
            start_bins=start_bins,
            solids=faces.mesh_registry.finish(),
        )

    def _channel_names(self) -> list[str]:
        if self.scene.spectrum.kind == "rgb":
            return ["R", "G", "B"]
        return [f"{wavelength:g} nm" for wavelength in self.wavelengths]

    def _variance_reduction(self) -> VarianceReduction | None:
        """What the weighted mode does differently, with the shapes that light is aimed at."""
        if self.scene.trace.mode == "analog":
            return None
        planes = {
            name: (self.detectors.plane(model), model.both_sides)
            for name, model in self.scene.detectors.items()
            if isinstance(model, DetectorModel) and model.kind in ("plane", "camera")
        }
        return compile_variance_reduction(
            self.scene.trace, self.faces.shapes(), planes, self.scene.origin
        )

    def _extent(self, shapes: ShapeColumns, sources: CompiledSources) -> tuple[Array, float]:
        """Center and radius of the bounding sphere."""
        boxes = [(shapes.low.min(axis=0), shapes.high.max(axis=0))] if len(shapes) else []
        boxes += [(low, high) for low, high, _ in sources.boxes]
        boxes += self.detectors.boxes()
        low = np.min([box[0] for box in boxes], axis=0)
        high = np.max([box[1] for box in boxes], axis=0)
        return (low + high) / 2.0, 1.05 * float(np.linalg.norm(high - low)) / 2.0 + 1e-6

    # -- names -------------------------------------------------------------------------------------

    def _directory(self, center: Array, radius: float, fluxes: Array) -> Directory:
        scene = self.scene
        directory = Directory(
            length_unit=scene.length_unit,
            flux_unit=scene.flux_unit,
            sources=tuple(
                Source(name=name, flux=flux, kind=model.kind, parameters=given_parameters(model))
                for (name, model), flux in zip(scene.sources.items(), fluxes.tolist(), strict=True)
            ),
            objects=tuple(self.faces.objects),
            media=self.media.entries,
            surfaces=tuple(
                Surface(name=name, kind=model.kind, parameters=given_parameters(model))
                for name, model in self.faces.surface_models()
            ),
            detectors=tuple(self.detectors.entries),
            bounding_sphere=BoundingSphere(center=tuple(center.tolist()), radius=radius),
            scene_text=scene.text,
            parameters=taking_part(scene),
            title=scene.title,
        )
        return directory.model_copy(update={"scene_hash": _scene_hash(scene)})

    def _channel_set(self, colors: Array, laws: list[Law | None]) -> ChannelSet:
        from raymap.optics.colorimetry import RGB_LUMINANCE, channel_display_rgb, luminous_efficacy

        rgb = self.scene.spectrum.kind == "rgb"
        unit = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        display = unit if rgb else _rows(channel_display_rgb(self.wavelengths, gamut=False))
        luminous = RGB_LUMINANCE if rgb else tuple(luminous_efficacy(self.wavelengths).tolist())
        return ChannelSet(
            kind=self.scene.spectrum.kind,
            wavelengths_nm=tuple(self.wavelengths.tolist()),
            luminous=luminous,
            display_rgb=display,
            refractive_index=_rows(self.media.index),
            absorption=_rows(self.media.absorption),
            source_colors=_rows(colors),
            laws=stored_laws(laws, self.media.laws),
        )


def _lists(candidates: Candidates, plain: NDArray[np.uint8]) -> dict[str, Any]:
    """The lists of faces as columns of the compiled scene."""
    return {
        "list_of": candidates.list_of,
        "first": candidates.first,
        "face": candidates.face,
        "distance": candidates.distance,
        "decided": candidates.decided,
        "decides": candidates.decides,
        "target": candidates.bound_for(plain),
    }


_COMMON_FACES = {ANNULUS, RECTANGLE, SPHERE, CYLINDER, MESH}


def _needs_tables(surface_i: Integers, medium_i: Integers) -> bool:
    """Whether the engine must know more than plain surfaces and clear media."""
    plain = np.isin(surface_i[:, S_KIND], (ABSORBER, DIELECTRIC, LAMBERTIAN))
    plain &= (surface_i[:, S_SCATTER] < 0) & (surface_i[:, S_MODEL] != 2)
    return not bool(np.all(plain)) or bool(np.any(medium_i[:, M_PARTICIPATING]))


def _plain_faces(face_i: Integers, surface_i: Integers, medium_i: Integers) -> Any:
    """Faces with nothing but bare or even reflection, in a scene of clear media."""
    plain = np.isin(face_i[:, F_KIND], (ANNULUS, RECTANGLE, SPHERE)) & (face_i[:, F_DETECTOR] < 0)
    surface = surface_i[face_i[:, F_SURFACE]]
    plain &= (surface[:, S_KIND] == DIELECTRIC) & (surface[:, S_SCATTER] < 0)
    plain &= np.isin(surface[:, S_MODEL], (0, 1)) & (face_i[:, F_INSIDE] >= 0)
    plain &= not bool(np.any(medium_i[:, M_PARTICIPATING]))
    return plain.astype(np.uint8)


def _rows(array: Array) -> Any:
    return tuple(tuple(row) for row in np.asarray(array, float).tolist())


_HASHED = (
    "length_unit", "flux_unit", "world", "media", "bodies", "sources", "detectors",
)  # fmt: skip


def _scene_hash(scene: Scene) -> str:
    """Hash of geometry, media, surfaces, sources and detectors, with the files that they name."""
    parts = scene.model_dump(mode="json", include=set(_HASHED))
    parts["surfaces"] = {name: item.fingerprint() for name, item in scene.surfaces.items()}
    parts["files"] = {
        file: file_hash(named_file(scene.folder, file))[:32]
        for table in (scene.bodies, scene.sources)
        for item in table.values()
        if (file := getattr(item, "file", None)) is not None
    }
    text = json.dumps(parts, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]
