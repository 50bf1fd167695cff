"""The bodies of a scene as the renderer takes them: crystals with flat faces and meshes.

Whatever else the language of scenes knows of bodies is refused by name.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from tracer.bodies.body import Body
from tracer.bodies.box import BoxBody
from tracer.bodies.mesh import MeshBody
from tracer.bodies.prism import PrismBody
from tracer.bodies.rhomb import RhombBody
from tracer.description.fields import Node
from tracer.description.named_files import named_file
from tracer.media.keys.key import At
from tracer.media.model import MediumModel
from tracer.optics.crystals.media import Crystal, isotropic
from tracer.render.bodies import CrystalBody, convex_body, mesh_body
from tracer.scene.crystals import crystal_of
from tracer.scene.media import absorption_coefficient, refractive_index
from tracer.scene.model import Scene

__all__ = ["bodies_of", "world_of"]

Array = NDArray[np.float64]

_BODIES = "box, prism, rhomb and mesh"
_PLACED = {"kind", "position", "axis", "rotation"}
_OF_BODIES = _PLACED | {
    "medium", "surface", "faces", "size", "outline", "length", "edge", "file", "scale", "flip",
}  # fmt: skip


def bodies_of(scene: Scene) -> tuple[CrystalBody, ...]:
    """The bodies of a scene with their crystals."""
    if scene.length_unit != "mm":
        raise _refused(scene, "length_unit", "pictures of crystals are in mm")
    return tuple(_body(scene, name, body) for name, body in scene.bodies.items())


def world_of(scene: Scene) -> Crystal:
    """The medium between the bodies."""
    return _medium(scene, scene.world.medium, None)


def _refused(scene: Scene, key: str, message: str) -> SceneError:
    return SceneError(f"{scene.origin}: {key}: {message}")


def _refuse_ignored(scene: Scene, where: str, model: Node, obeyed: set[str]) -> None:
    """Refuse a key that is set to something else than its default and would have no effect."""
    for name in sorted(model.model_fields_set - obeyed):
        field = type(model).model_fields.get(name)
        if field is None or getattr(model, name) != field.get_default(call_default_factory=True):
            raise _refused(scene, f"{where}.{name}", "has no effect in a picture of crystals")


def _medium(scene: Scene, name: str, axis: Array | None) -> Crystal:
    """A crystal, or an isotropic medium, by name; ``axis`` where the body gives an optic axis."""
    if name in ("air", "vacuum") and name not in scene.media:
        return isotropic(1.0, name=name)
    if name not in scene.media:
        known = ", ".join([*scene.media, "air", "vacuum"])
        raise _refused(scene, "media", f"there is no medium {name!r}; media: {known}")
    model, place = scene.media[name], f"{scene.origin}: media.{name}"
    if model.key("crystal") is not None:
        return crystal_of(scene, name, axis)
    if model.scattering is not None:
        raise SceneError(f"{place}.scattering: nothing scatters in pictures of crystals")

    def index(wavelength_nm: float) -> float:
        return float(refractive_index(model, np.array([wavelength_nm]), place)[0])

    return isotropic(index, name=name, kappa=_extinction(model, place))


def _extinction(model: MediumModel, where: str) -> Callable[[float], float]:
    """Kappa of an absorption coefficient mu [1/mm]: mu lambda / 4 pi."""

    def kappa(wavelength_nm: float) -> float:
        at = At(wavelengths_nm=np.array([wavelength_nm]), length_unit="mm", place=where)
        mu = float(absorption_coefficient(model, at)[0])
        return mu * wavelength_nm * 1e-6 / (4.0 * np.pi)

    return kappa


def _body(scene: Scene, name: str, body: Body) -> CrystalBody:
    where = f"bodies.{name}"
    if body.medium is None:
        raise _refused(scene, f"{where}.medium", "every body is a solid in a picture of crystals")
    for surface in {body.surface, *body.faces.values()} - {None}:
        model = scene.surfaces.get(surface or "")
        if model is None or model.kind != "dielectric" or model.model_fields_set - {"kind"}:
            raise _refused(
                scene,
                f"{where}.surface",
                f"{surface!r} is not a bare dielectric, as pictures of crystals need",
            )
    if not isinstance(body, RhombBody | BoxBody | PrismBody | MeshBody):
        raise _refused(scene, f"{where}.kind", f"pictures take bodies of kind {_BODIES}")
    _refuse_ignored(scene, where, body, _OF_BODIES)
    medium = _medium(scene, body.medium, body.crystal_axis())
    if isinstance(body, MeshBody):
        from tracer.geometry.mesh_files import load_mesh

        mesh = load_mesh(
            named_file(scene.folder, body.file), name=name, scale=body.scale, faces="one",
            solid=True, flip=body.flip,
        )  # fmt: skip
        origin, frame = body.frame()
        return mesh_body(name, medium, mesh.vertices @ frame.T + origin, mesh.triangles)
    return convex_body(name, medium, _planes(body))


def _planes(body: BoxBody | PrismBody | RhombBody) -> Array:
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
