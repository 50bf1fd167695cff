"""Scenes of the common language that hold crystals, for the tracer of crystals.

A medium with ``crystal`` makes a scene of crystals. Such scenes hold bodies with flat faces and
meshes, parallel and conical beams, plane detectors, in an isotropic world; whatever else the
language knows is refused by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from raymap.encoding.encoder import PortionEncoder
from raymap.model.directory import ChannelSet, Directory, DisplayMesh
from raymap.model.errors import SceneError
from raymap.model.portion import Portion
from raymap.model.schema import PORTION_RAYS
from tracer.bodies.body import Body
from tracer.bodies.box import BoxBody
from tracer.bodies.mesh import MeshBody
from tracer.bodies.prism import PrismBody
from tracer.crystals.bodies import CrystalBody, convex_body, mesh_body
from tracer.crystals.load import MediumModel as CrystalModel
from tracer.crystals.load import medium_of
from tracer.crystals.media import Crystal, isotropic
from tracer.crystals.recorder import (
    ConeSource,
    CrystalScene,
    CrystalTracer,
    PlaneDetector,
    channels_of,
    hashed_directory,
)
from tracer.crystals.rhomb_body import RhombBody
from tracer.crystals.rows import ISOTROPIC, KIND
from tracer.description.fields import Node
from tracer.description.named_files import named_file, noting_files
from tracer.detectors.model import DetectorModel
from tracer.media.keys.key import At
from tracer.media.model import MediumModel
from tracer.run.results import depth_limit
from tracer.scene.inputs import inputs_of, taking_part
from tracer.scene.media import absorption_coefficient, refractive_index
from tracer.scene.model import Scene
from tracer.scene.supported import refuse_weighting
from tracer.sources.model import SourceModel

if TYPE_CHECKING:
    from tracer.sources.source import Source

__all__ = [
    "CrystalEngine",
    "CrystalTrace",
    "bodies_of",
    "compile_crystals",
    "crystal_scene_of",
    "world_of",
]

Array = NDArray[np.float64]

_BODIES = "box, prism, rhomb and mesh"
_PLACED = {"kind", "position", "axis", "rotation"}
_OF_BODIES = _PLACED | {
    "medium", "surface", "faces", "size", "outline", "length", "edge", "file", "scale", "flip",
}  # fmt: skip
_OF_SOURCES = _PLACED | {
    "on", "flux", "flux_unit", "direction", "aim", "distance", "diameter", "cone_deg",
    "polarisation",
}  # fmt: skip
_OF_DETECTORS = {"kind", "position", "looks", "up", "size", "cells", "blocking"}
_MOST_KAPPA = 0.05
"""Up to here what a face reflects differs by less than 1e-3 from that of the real tensor."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CrystalTrace:
    """A scene of crystals ready to record; attributes as of `tracer.run.trace.Trace`."""

    scene: Scene
    crystals: CrystalScene
    directory: Directory
    channel_set: ChannelSet
    meshes: dict[int, DisplayMesh]

    max_branches: ClassVar[int] = 1
    most_rays: ClassVar[int] = PORTION_RAYS

    @property
    def limit(self) -> tuple[str, str]:
        return depth_limit(self.scene.limits.depth)

    @property
    def parameters(self) -> Mapping[str, Any]:
        return {}

    def __reduce__(self) -> tuple[Any, ...]:
        # Media hold functions; a worker compiles the scene again
        return compile_crystals, (self.scene,)

    def prepared(self, encoder: PortionEncoder | None, threads: int) -> CrystalTrace:
        self.engine(1)  # refuses bodies that cannot stand together
        return self

    def engine(self, seed: int) -> CrystalEngine:
        return CrystalEngine(self, seed)

    def pinholes(self) -> None:
        return None


class CrystalEngine:
    """Traces portions of a scene of crystals; safe to call from many threads."""

    def __init__(self, trace: CrystalTrace, seed: int) -> None:
        self.tracer = CrystalTracer(trace.crystals, trace.directory, seed)

    def trace(self, first_ray: int, n_rays: int, *, reuse: bool = False) -> Portion:
        """Trace the rays ``first_ray`` to ``first_ray + n_rays``; ``reuse`` changes nothing."""
        return replace(self.tracer.portion(first_ray, n_rays), implied_normals=True)

    def trace_counted(self, first_ray: int, n_rays: int) -> tuple[Portion, int]:
        """As `trace`, with the number of its records."""
        portion = self.trace(first_ray, n_rays)
        return portion, portion.n_records


def compile_crystals(scene: Scene) -> CrystalTrace:
    """Turn a scene with crystals into tables, directory and display meshes.

    Raises
    ------
    SceneError
        naming the key that a scene of crystals cannot have
    """
    refuse_weighting(scene, "the tracer of crystals")
    for key in sorted(scene.trace.model_fields_set - {"mode"}):
        raise _refused(scene, f"trace.{key}", "has no effect on crystals, whose light is polarised")
    crystals = crystal_scene_of(scene)
    directory, meshes = hashed_directory(crystals, flux_unit=scene.flux_unit)
    return CrystalTrace(
        scene=scene,
        crystals=crystals,
        directory=directory,
        channel_set=channels_of(crystals, directory),
        meshes=meshes,
    )


def crystal_scene_of(scene: Scene) -> CrystalScene:
    """The scene as the tracer of crystals describes it."""
    if scene.spectrum.kind != "spectral":
        raise _refused(
            scene, "spectrum", 'give wavelengths for crystals: kind = "spectral", wavelengths_nm'
        )
    sources = {name: source for name, source in scene.sources.items() if source.on}
    if not sources:
        raise _refused(
            scene,
            "sources",
            "there is no source that is on: add [sources.NAME]; raymap render draws the scene "
            "without, by [room] and [camera]",
        )
    world = world_of(scene)
    for wavelength in scene.spectrum.channels().tolist():
        if world.row(wavelength)[KIND] != ISOTROPIC:
            raise _refused(
                scene,
                "world.medium",
                f"{scene.world.medium!r} is a crystal; light must come from an isotropic medium: "
                "put the crystal into a body",
            )
    with noting_files() as noted:
        bodies = bodies_of(scene)
    return CrystalScene(
        name=scene.title or "crystals",
        bodies=bodies,
        sources=tuple(_cone_source(scene, name, source) for name, source in sources.items()),
        detectors=tuple(_plane(scene, name) for name in scene.detectors),
        wavelengths_nm=tuple(float(w) for w in scene.spectrum.channels()),
        world=world,
        contacts=scene.contacts,
        depth=scene.limits.depth,
        text=scene.text,
        inputs=inputs_of(scene, noted),
        parameters=taking_part(scene),
    )


def bodies_of(scene: Scene) -> tuple[CrystalBody, ...]:
    """The bodies of a scene with their crystals."""
    if scene.length_unit != "mm":
        raise _refused(scene, "length_unit", "scenes with crystals are in mm")
    return tuple(_body(scene, name, body) for name, body in scene.bodies.items())


def world_of(scene: Scene) -> Crystal:
    """The medium between the bodies."""
    return _medium(scene, scene.world.medium, None)


def _refused(scene: Scene, key: str, message: str) -> SceneError:
    return SceneError(f"{scene.origin}: {key}: {message}")


def _refuse_ignored(scene: Scene, place: str, model: Node, obeyed: set[str]) -> None:
    """Refuse a key that is set to something else than its default and would have no effect."""
    for name in sorted(model.model_fields_set - obeyed):
        field = type(model).model_fields.get(name)
        if field is None or getattr(model, name) != field.get_default(call_default_factory=True):
            raise _refused(scene, f"{place}.{name}", "has no effect in a scene with crystals")


def _medium(scene: Scene, name: str, axis: Array | None) -> Crystal:
    """A crystal, or an isotropic medium, by name; ``axis`` where the body gives an optic axis."""
    if name in ("air", "vacuum") and name not in scene.media:
        return isotropic(1.0, name=name)
    if name not in scene.media:
        known = ", ".join([*scene.media, "air", "vacuum"])
        raise _refused(scene, "media", f"there is no medium {name!r}; media: {known}")
    model, place = scene.media[name], f"{scene.origin}: media.{name}"
    if model.key("crystal") is not None:
        try:
            crystal = medium_of(name, CrystalModel.model_validate(model.key("crystal")), axis)
            _refuse_dark(scene, name, crystal)
            return crystal
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(["crystal", *(str(part) for part in first["loc"])])
            raise SceneError(f"{place}.{key}: {first['msg']}") from None
        except SceneError as error:
            raise SceneError(f"{scene.origin}: {error}") from None
    if model.scattering is not None:
        raise SceneError(f"{place}.scattering: nothing scatters in a scene with crystals")

    def index(wavelength_nm: float) -> float:
        return float(refractive_index(model, np.array([wavelength_nm]), place)[0])

    return isotropic(index, name=name, kappa=_extinction(model, place))


def _refuse_dark(scene: Scene, name: str, crystal: Crystal) -> None:
    """Refuse absorption that changes what a face reflects."""
    for wavelength in scene.spectrum.channels().tolist():
        kappa = float(crystal.principal_kappa(wavelength).max())
        if kappa > _MOST_KAPPA:
            raise SceneError(
                f"media.{name}.crystal.absorption: kappa is {kappa:g} at {wavelength:g} nm; so "
                "dark a crystal reflects by its complex tensor, scenes take at most "
                f"{_MOST_KAPPA:g}; "
                "tracer.crystals.absorbing has plates and faces of dark crystals in isotropic media"
            )


def _extinction(model: MediumModel, place: str) -> Any:
    """Kappa of an absorption coefficient mu [1/mm]: mu lambda / 4 pi."""
    if len(model.given) == 1:
        return 0.0

    def kappa(wavelength_nm: float) -> float:
        at = At(wavelengths_nm=np.array([wavelength_nm]), length_unit="mm", place=place)
        mu = float(absorption_coefficient(model, at)[0])
        return mu * wavelength_nm * 1e-6 / (4.0 * np.pi)

    return kappa


def _body(scene: Scene, name: str, body: Body) -> CrystalBody:
    place = f"bodies.{name}"
    if body.medium is None:
        raise _refused(scene, f"{place}.medium", "every body is a solid in a scene with crystals")
    for surface in {body.surface, *body.faces.values()} - {None}:
        model = scene.surfaces.get(surface or "")
        if model is None or model.kind != "dielectric" or model.model_fields_set - {"kind"}:
            raise _refused(
                scene, f"{place}.surface", f"{surface!r} is not a bare dielectric, as crystals need"
            )
    if not isinstance(body, RhombBody | BoxBody | PrismBody | MeshBody):
        raise _refused(scene, f"{place}.kind", f"crystals are traced in bodies of kind {_BODIES}")
    _refuse_ignored(scene, place, body, _OF_BODIES)
    if isinstance(body, RhombBody):
        planes, axis = body.hull()
        return convex_body(name, _medium(scene, body.medium, axis), planes)
    medium = _medium(scene, body.medium, None)
    if isinstance(body, MeshBody):
        from tracer.geometry.mesh_files import load_mesh

        mesh = load_mesh(
            named_file(scene.folder, body.file), name=name, scale=body.scale, faces="one",
            solid=True, flip=body.flip,
        )  # fmt: skip
        origin, frame = body.frame()
        return mesh_body(name, medium, mesh.vertices @ frame.T + origin, mesh.triangles)
    return convex_body(name, medium, _planes(body))


def _planes(body: BoxBody | PrismBody) -> Array:
    """Outward normals and offsets of a body with one flat shape per face."""
    corners = [np.asarray(plan.shapes[0].mesh()[0], np.float64) for plan in body.plan()]
    middle = np.concatenate(corners).mean(axis=0)
    rows = []
    for points in corners:
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        normal /= np.linalg.norm(normal)
        if normal @ (points[0] - middle) < 0.0:
            normal = -normal
        rows.append([*normal, normal @ points.mean(axis=0)])
    return np.array(rows)


def _cone_source(scene: Scene, name: str, source: Source) -> ConeSource:
    place = f"sources.{name}"
    if not isinstance(source, SourceModel) or source.kind not in ("collimated", "point"):
        raise _refused(scene, f"{place}.kind", "light for crystals is collimated or point")
    if source.size is not None or source.inner_diameter > 0.0:
        raise _refused(scene, f"{place}.size", "light for crystals comes from a disc: diameter")
    if source.spectrum != "white":
        raise _refused(scene, f"{place}.spectrum", "crystals take light of equal channels: white")
    if source.inside or source.share is not None:
        raise _refused(scene, place, "inside and share have no meaning for crystals")
    if source.flux_unit not in (None, scene.flux_unit):
        raise _refused(scene, f"{place}.flux_unit", f"crystals take {scene.flux_unit} here")
    _refuse_ignored(scene, place, source, _OF_SOURCES)
    cone = source.cone_deg or 0.0
    if source.kind == "point" and not 0.0 < cone < 90.0:
        raise _refused(scene, f"{place}.cone_deg", "a point source needs a cone below 90 degrees")
    origin, frame = source.frame()
    return ConeSource(
        name=name,
        centre=_triple(origin),
        direction=_triple(frame[:, 2]),
        radius=0.5 * (source.diameter or 0.0),
        cone_deg=cone,
        polarisation=source.polarisation,
        flux=1.0 if source.flux is None else source.flux,
    )


def _plane(scene: Scene, name: str) -> PlaneDetector:
    model, place = scene.detectors[name], f"detectors.{name}"
    if not isinstance(model, DetectorModel) or model.kind != "plane":
        raise _refused(scene, f"{place}.kind", "crystals are seen by plane detectors")
    if model.both_sides or model.acceptance_deg < 90.0 or model.surface is not None:
        raise _refused(
            scene, place, "both_sides, acceptance_deg and surface have no meaning for crystals"
        )
    _refuse_ignored(scene, place, model, _OF_DETECTORS)
    u, v, _ = model.axes()
    assert model.cells is not None
    return PlaneDetector(
        name=name,
        centre=model.position,
        axis_u=_triple(u),
        axis_v=_triple(v),
        size=model.size,
        cells=model.cells,
        blocking=model.blocking,
    )


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector)
    return x, y, z
