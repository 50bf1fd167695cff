"""Record a scene of crystals into a ray map: ordinary and extraordinary paths, queryable."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import (
    BoundingSphere,
    ChannelSet,
    Detector,
    Directory,
    DisplayMesh,
    Face,
    InputFile,
    Medium,
    SceneObject,
    Source,
    Surface,
)
from raymap.model.errors import SceneError
from raymap.model.portion import Descriptors, Portion
from raymap.optics.colorimetry import channel_display_rgb, luminous_efficacy
from raymap.optics.frames import transverse_axes
from tracer.crystals.bodies import CrystalBody, compile_bodies
from tracer.crystals.hulls import face_names, hull_mesh
from tracer.crystals.media import Crystal, isotropic
from tracer.crystals.rows import ISOTROPIC, KIND

__all__ = [
    "CrystalScene",
    "CrystalTracer",
    "ConeSource",
    "PlaneDetector",
    "channels_of",
    "hashed_directory",
]

Real = NDArray[np.float64]
Vector = tuple[float, float, float]


def _unit(vector: Vector, where: str) -> Real:
    v = np.asarray(vector, np.float64)
    size = float(np.linalg.norm(v))
    if v.shape != (3,) or not (size > 0.0 and math.isfinite(size)):
        raise SceneError(f"{where} must be three numbers, not all zero")
    unit: Real = v / size
    return unit


@dataclass(frozen=True, kw_only=True)
class ConeSource:
    """A disc that emits a cone of light.

    Attributes
    ----------
    centre, direction : of the disc and the axis of the cone
    radius : of the disc [mm]
    cone_deg : half angle of the cone, 0 = collimated; even over its solid angle
    polarisation : direction of linear polarisation, None = natural light
    flux : in W
    """

    name: str
    centre: Vector
    direction: Vector
    radius: float = 0.0
    cone_deg: float = 0.0
    polarisation: Vector | None = None
    flux: float = 1.0

    def row(self) -> Real:
        """Numbers for the kernel."""
        axis = _unit(self.direction, f"source {self.name!r}: direction")
        if self.radius < 0.0 or not 0.0 <= self.cone_deg < 90.0 or self.flux < 0.0:
            raise SceneError(
                f"source {self.name!r}: radius and flux must not be negative, cone_deg in 0 .. 90"
            )
        polar = np.zeros(3)
        if self.polarisation is not None:
            polar = _unit(self.polarisation, f"source {self.name!r}: polarisation")
            if abs(float(polar @ axis)) > 1.0 - 1e-9:
                raise SceneError(f"source {self.name!r}: polarisation lies along the direction")
        _, across = transverse_axes(axis)
        cone = math.cos(math.radians(self.cone_deg))
        return np.concatenate([self.centre, axis, [self.radius, cone], polar, across])


@dataclass(frozen=True, kw_only=True)
class PlaneDetector:
    """A rectangle that counts light coming against its normal u x v.

    Attributes
    ----------
    size : along u and v [mm]
    cells : along u and v
    blocking : it absorbs what meets it from either side
    """

    name: str
    centre: Vector
    axis_u: Vector = (1.0, 0.0, 0.0)
    axis_v: Vector = (0.0, 1.0, 0.0)
    size: tuple[float, float] = (10.0, 10.0)
    cells: tuple[int, int] = (64, 64)
    blocking: bool = True

    def row(self) -> Real:
        """Numbers for the kernel."""
        u = _unit(self.axis_u, f"detector {self.name!r}: axis_u")
        v = _unit(self.axis_v, f"detector {self.name!r}: axis_v")
        if abs(float(u @ v)) > 1e-9:
            raise SceneError(f"detector {self.name!r}: axis_u and axis_v are not orthogonal")
        if min(self.size) <= 0.0 or min(self.cells) < 1:
            raise SceneError(f"detector {self.name!r}: size and cells must be positive")
        return np.concatenate([self.centre, u, v, np.cross(u, v), self.size])


@dataclass(frozen=True, kw_only=True)
class CrystalScene:
    """Crystals, sources and detectors in an isotropic world."""

    bodies: tuple[CrystalBody, ...]
    sources: tuple[ConeSource, ...]
    detectors: tuple[PlaneDetector, ...] = ()
    wavelengths_nm: tuple[float, ...] = (589.3,)
    world: Crystal = field(default_factory=lambda: isotropic(1.0, name="air"))
    contacts: tuple[tuple[str, str], ...] = ()
    depth: int = 30
    name: str = "crystals"
    text: str = ""
    inputs: tuple[InputFile, ...] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.sources:
            raise SceneError("scene: at least one source is needed")
        for detector in self.detectors:
            detector.row()  # refuses impossible shapes by name
        if self.depth < 1:
            raise SceneError("scene: depth must be at least 1")
        if not self.wavelengths_nm or min(self.wavelengths_nm) <= 0.0:
            raise SceneError("scene: wavelengths must be positive")

    @property
    def sphere(self) -> tuple[Real, float]:
        """Centre and radius of a sphere around everything."""
        points = [body.vertices for body in self.bodies]
        points += [np.array([source.centre]) + source.radius for source in self.sources]
        points += [np.array([source.centre]) - source.radius for source in self.sources]
        for detector in self.detectors:
            half = 0.5 * float(np.hypot(*detector.size))
            points += [np.array([detector.centre]) + half, np.array([detector.centre]) - half]
        everything = np.concatenate(points)
        centre = 0.5 * (everything.min(axis=0) + everything.max(axis=0))
        radius = float(np.linalg.norm(everything - centre, axis=1).max())
        return centre, 1.05 * radius + 1e-6

    def directory(self) -> tuple[Directory, dict[int, DisplayMesh]]:
        """Names and shapes for the map, and meshes to draw."""
        solids = {body.medium.name for body in self.bodies} - {self.world.name}
        media = [self.world.name, *sorted(solids)]
        objects, meshes = [], {}
        for number, body in enumerate(self.bodies):
            names = face_names(body)
            faces = tuple(
                Face(name=name, first_primitive=k, primitive_count=1, surface=0)
                for k, name in enumerate(names)
            ) or (Face(name="surface", primitive_count=len(body.triangles), surface=0),)
            objects.append(SceneObject(name=body.name, kind="crystal", faces=faces))
            meshes[number] = hull_mesh(body)
        detectors = []
        for detector in self.detectors:
            if detector.blocking:
                face = Face(name="front", surface=1)
                objects.append(SceneObject(name=detector.name, kind="detector", faces=(face,)))
                meshes[len(objects) - 1] = _rectangle(detector)
            detectors.append(
                Detector(
                    name=detector.name,
                    cells=detector.cells,
                    center=detector.centre,
                    axis_u=detector.axis_u,
                    axis_v=detector.axis_v,
                    size=detector.size,
                    blocking=detector.blocking,
                    object=len(objects) - 1 if detector.blocking else -1,
                )
            )
        centre, radius = self.sphere
        x, y, z = (float(c) for c in centre)
        directory = Directory(
            sources=tuple(
                Source(name=source.name, flux=source.flux, kind="disc") for source in self.sources
            ),
            objects=tuple(objects),
            media=tuple(
                Medium(name=name, kind="crystal" if k else "") for k, name in enumerate(media)
            ),
            surfaces=(
                Surface(name="crystal", kind="fresnel"),
                Surface(name="black", kind="absorber"),
            ),
            detectors=tuple(detectors),
            bounding_sphere=BoundingSphere(center=(x, y, z), radius=radius),
            title=self.name,
            scene_text=self.text,
            inputs=self.inputs,
            parameters=dict(self.parameters),
        )
        return directory, meshes


def _rectangle(detector: PlaneDetector) -> DisplayMesh:
    u = 0.5 * detector.size[0] * _unit(detector.axis_u, "axis_u")
    v = 0.5 * detector.size[1] * _unit(detector.axis_v, "axis_v")
    corners = np.asarray(detector.centre) + np.array([-u - v, u - v, u + v, -u + v])
    return DisplayMesh(
        vertices=corners.astype(np.float32),
        triangles=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        face=np.zeros(2, np.int32),
    )


class CrystalTracer:
    """Compiled tables of a scene; `portion` may run on many threads."""

    def __init__(self, scene: CrystalScene, directory: Directory, seed: int) -> None:
        wavelengths = np.asarray(scene.wavelengths_nm, np.float64)
        media = [
            [body.medium.row(float(w)) for body in scene.bodies] + [scene.world.row(float(w))]
            for w in wavelengths
        ]
        if any(rows[-1][KIND] != ISOTROPIC for rows in media):
            raise SceneError(f"scene: the world {scene.world.name!r} must be isotropic")
        names = [medium.name for medium in directory.media]
        centre, radius = scene.sphere
        self.scene, self.directory, self.seed = scene, directory, seed
        self.tables = (
            compile_bodies(scene.bodies, scene.contacts),
            np.array(media),
            np.array([names.index(body.medium.name) for body in scene.bodies] or [0], np.int64),
            2e6 * np.pi / wavelengths,
            np.array([source.row() for source in scene.sources]),
            np.array([detector.row() for detector in scene.detectors]).reshape(-1, 14),
            np.array([detector.blocking for detector in scene.detectors], np.bool_),
            np.array([detector.cells for detector in scene.detectors], np.int64).reshape(-1, 2),
            np.array([detector.object for detector in directory.detectors], np.int64),
            np.array([*centre, radius]),
        )

    def portion(self, first_ray: int, n_rays: int) -> Portion:
        from tracer.crystals.paths import CompiledCrystals, trace_paths

        depth = self.scene.depth
        per_ray = 8
        while True:
            records = n_rays * per_ray + depth + 2
            seen = (len(self.scene.detectors) + 1) * records
            counts = np.zeros(n_rays, np.int32)
            reals, words = np.zeros((records, 6)), np.zeros((records, 6), np.int64)
            meetings = np.zeros((seen, 7), np.int64)
            r, m = trace_paths(
                CompiledCrystals(*self.tables),
                self.seed,
                first_ray,
                n_rays,
                depth,
                counts,
                reals,
                words,
                meetings,
            )
            if r >= 0:
                break
            per_ray *= 2
        words, meetings = words[:r], meetings[:m]
        n_sources = len(self.scene.sources)
        source = (first_ray + np.arange(n_rays)) % n_sources
        return Portion(
            emitted=np.bincount(source, minlength=n_sources).astype(np.int64),
            source=source.astype(np.int16),
            records_per_ray=counts,
            position=reals[:r, :3].astype(np.float32),
            normal=np.floor(reals[:r, 3:] * 32767.0 + 0.5).astype(np.int16),
            object=words[:, 0].astype(np.int16),
            triangle=words[:, 1].astype(np.int32),
            event=words[:, 2].astype(np.int32),
            medium=words[:, 3].astype(np.int16),
            color_code=words[:, 4].astype(np.int32),
            color_table=np.zeros((0, len(self.scene.wavelengths_nm)), np.uint16),
            descriptor_count=words[:, 5].astype(np.uint16),
            descriptors=Descriptors(
                detector=meetings[:, 0].astype(np.int16),
                cell=meetings[:, 1:3].astype(np.uint16),
                cosine=np.round(meetings[:, 3] * (32767.0 / 1e9)).astype(np.int16),
                uv=meetings[:, 4:6].astype(np.uint16),
                registered=meetings[:, 3] > 0,
            ),
            first_ray=first_ray,
        )


def channels_of(scene: CrystalScene, directory: Directory) -> ChannelSet:
    wavelengths = scene.wavelengths_nm
    by_name = {body.medium.name: body.medium for body in scene.bodies} | {
        scene.world.name: scene.world
    }
    indices = [
        tuple(float(np.mean(by_name[m.name].principal_indices(w))) for w in wavelengths)
        for m in directory.media
    ]
    share = 1.0 / len(wavelengths)
    return ChannelSet(
        kind="spectral",
        wavelengths_nm=wavelengths,
        luminous=tuple(float(v) for v in np.atleast_1d(luminous_efficacy(np.array(wavelengths)))),
        display_rgb=tuple(
            (float(r), float(g), float(b))
            for r, g, b in channel_display_rgb(np.array(wavelengths), gamut=False)
        ),
        refractive_index=tuple(indices),
        absorption=tuple((0.0,) * len(wavelengths) for _ in directory.media),
        source_colors=tuple((share,) * len(wavelengths) for _ in scene.sources),
    )


def hashed_directory(
    scene: CrystalScene, *, flux_unit: str = "W"
) -> tuple[Directory, dict[int, DisplayMesh]]:
    """Directory with the fingerprint of the scene, and meshes to draw."""
    directory, meshes = scene.directory()
    digest = hashlib.sha256(
        directory.model_dump_json(exclude={"scene_text", "inputs", "parameters"}).encode()
    )
    for body in scene.bodies:
        digest.update(body.planes.tobytes() + body.vertices.tobytes())
        digest.update(body.medium.row(589.3).tobytes())
    digest.update(repr(scene.sources).encode())
    update = {"scene_hash": digest.hexdigest()[:32], "flux_unit": flux_unit}
    return directory.model_copy(update=update), meshes
