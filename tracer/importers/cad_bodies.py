"""CAD solids as bodies of a scene: ``[cad_files.NAME]``."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from raymap.model.errors import SceneError
from raymap.model.units import length_scale
from raymap.model.wildcards import Wildcard
from tracer.bodies.body import Body, FacePlan
from tracer.bodies.mesh import MeshBody
from tracer.description.fields import Node, Placed, Positive
from tracer.description.named_files import named_file
from tracer.importers.cad_format import CAD_FORMATS, read_cad
from tracer.importers.cad_formats.step_read import clean_name
from tracer.importers.cad_formats.step_shapes import Placement, shapes_of_face
from tracer.importers.cad_solid import CadSolid
from tracer.scene.files import FileTable

if TYPE_CHECKING:
    from tracer.geometry.mesh import TriangleMesh

__all__ = ["CAD_FILES", "CadBody", "CadFileModel", "CadMeshBody", "merge_cad_file"]


_SPECULAR_CHORD = 1e-4
"""Chord of curved faces that reflect or refract, where none is given [diagonal of the solid]."""


class CadPart(Node):
    """What is said of single bodies of a CAD file, by name pattern."""

    medium: str | None = None
    surface: str | None = None
    priority: int | None = None
    faces: dict[str, str] = {}


class CadFileModel(Placed):
    """``[cad_files.NAME]``: the solids of a STEP file, under names that start with ``NAME.``.

    ``use`` and ``leave_out`` choose solids by name; ``medium``, ``surface``, ``priority`` and
    ``faces`` hold for all of them, ``bodies`` for some. Curved faces that the tracer has no closed
    form for become triangles within ``chord`` of them [scene units] (by default a thousandth of the
    solid, a ten-thousandth where they reflect or refract) that turn by ``angle_deg`` at most.
    """

    file: str
    use: tuple[str, ...] = ("*",)
    leave_out: tuple[str, ...] = ()
    medium: str | None = None
    surface: str | None = None
    priority: int = 0
    faces: dict[str, str] = {}
    bodies: dict[str, CadPart] = {}
    chord: Positive | None = None
    angle_deg: Annotated[float, Field(gt=0, le=90)] = 15.0
    triangles: bool = False


class _FromCad(Node):
    """Where a body comes from; ``digest`` stands for the content of the file."""

    part: str
    digest: str
    color: str = ""
    face_colors: dict[str, str] = {}
    path: str = Field(exclude=True)
    mm: float = Field(exclude=True)


class CadBody(_FromCad, Body):
    """A solid all of whose faces are planes, cylinders, cones and spheres: traced exactly."""

    kind: Literal["cad"] = "cad"
    file: str

    def plan(self) -> list[FacePlan]:
        origin, frame = self.frame()
        return _plans(_solid(self.path, self.part), Placement(origin, frame, self.mm)) or []


class CadMeshBody(_FromCad, MeshBody):
    """A solid with other faces: triangles with the normals of the exact surfaces."""

    kind: Literal["cad"] = "cad"  # type: ignore[assignment]
    chord_mm: float
    specular: tuple[str, ...] = Field(default=(), exclude=True)
    specular_chord_mm: float | None = None

    def reading_key(self) -> tuple[object, ...]:
        finer = self.specular_chord_mm, self.specular
        return (
            self.path, self.part, self.chord_mm, self.angle_deg, self.mm, self.medium is None, finer
        )  # fmt: skip

    def read(self, folder: Path, name: str) -> TriangleMesh:
        from tracer.importers.cad_formats.step_mesh import mesh_of_solid

        return mesh_of_solid(
            _solid(self.path, self.part),
            chord_mm=self.chord_mm,
            angle_deg=self.angle_deg,
            scale=self.mm,
            closed=self.medium is not None,
            specular=self.specular,
            specular_chord_mm=self.specular_chord_mm,
        )


def _solid(path: str, part: str) -> CadSolid:
    for solid in read_cad(path):
        if solid.name == part:
            return solid
    raise SceneError(f"{Path(path).name}: no longer holds {part!r}; it was changed while in use")


def _plans(solid: CadSolid, placed: Placement) -> list[FacePlan] | None:
    """The faces in closed form; None where one of them has none."""
    plans = []
    for face in solid.faces:
        shapes = shapes_of_face(face, placed)
        if shapes is None:
            return None
        plans.append(FacePlan(name=face.name, shapes=shapes))
    return plans


def merge_cad_file(
    tree: dict[str, Any], name: str, model: CadFileModel, folder: Path, origin: str
) -> None:
    """Add the solids of a CAD file to the bodies of a scene.

    Raises
    ------
    SceneError
        where the file cannot be taken, a pattern matches no solid, or a name stands twice
    """
    path = named_file(folder, model.file)
    where = f"{origin}: cad_files.{name}"
    solids = read_cad(path)
    names = [solid.name for solid in solids]
    chosen = _matching(model.use, names, f"{where}.use")
    chosen -= _matching(model.leave_out, names, f"{where}.leave_out")
    for pattern, part in model.bodies.items():
        matched = _matching([pattern], names, f"{where}.bodies")
        _check_faces(part.faces, [s for s in solids if s.name in matched], f"{where}.bodies")
    _check_faces(model.faces, [s for s in solids if s.name in chosen], where)
    digest = _digest(str(path), path.stat().st_mtime_ns)
    present = tree.setdefault("bodies", {})
    diffuse = _diffuse_surfaces(tree)
    for solid in solids:
        full = f"{clean_name(name)}.{solid.name}"
        if solid.name not in chosen:
            continue
        if full in present:
            raise SceneError(f"{where}: there is a body {full!r} in the scene already; rename it")
        unit = length_scale("mm", tree.get("length_unit", "mm"))
        present[full] = _body(solid, model, str(path.resolve()), digest, unit, diffuse)


def _body(
    solid: CadSolid,
    model: CadFileModel,
    path: str,
    digest: str,
    per_mm: float,
    diffuse: frozenset[str],
) -> CadBody | CadMeshBody:
    """The body of a solid, in closed form where that is possible."""
    settings: dict[str, Any] = {
        key: getattr(model, key)
        for key in ("medium", "surface", "priority")
        if key in model.model_fields_set
    }
    known = {face.name for face in solid.faces}
    faces = _spread(model.faces, known)
    for pattern, part in model.bodies.items():
        if Wildcard(pattern, escapes=False).matches(solid.name):
            given = part.model_dump(exclude_unset=True, exclude={"faces"})
            settings |= {key: value for key, value in given.items() if value is not None}
            faces |= _spread(part.faces, known)
    colors = {face.name: face.color for face in solid.faces if face.color}
    common: dict[str, Any] = {
        **{key: value for key, value in settings.items() if value is not None},
        **{
            key: getattr(model, key)
            for key in ("position", "axis", "rotation")
            if key in model.model_fields_set
        },
        **({"faces": faces} if faces else {}),
        **({"color": solid.color} if solid.color else {}),
        **({"face_colors": colors} if colors else {}),
        "file": model.file,
        "part": solid.name,
        "digest": digest,
        "path": path,
        "mm": per_mm,
    }
    if not model.triangles and _plans(solid, Placement(np.zeros(3), np.eye(3), per_mm)):
        return CadBody(**common)
    chord = model.chord / per_mm if model.chord else 1e-3 * solid.size
    return CadMeshBody(
        **common,
        scale=1.0,
        chord_mm=chord,
        angle_deg=model.angle_deg,
        specular=_specular(solid, faces, settings.get("surface"), diffuse),
        specular_chord_mm=None if model.chord else _SPECULAR_CHORD * solid.size,
    )


def _specular(
    solid: CadSolid, faces: dict[str, str], surface: str | None, diffuse: frozenset[str]
) -> tuple[str, ...]:
    """Faces whose surface reflects or refracts: all but those that absorb or scatter alone."""
    return tuple(
        face.name
        for face in solid.faces
        if (faces.get(face.name) or surface or "bare") not in diffuse
    )


def _diffuse_surfaces(tree: dict[str, Any]) -> frozenset[str]:
    """Names of the scene's surfaces on which it does not matter how a triangle leans."""
    surfaces = tree.get("surfaces")
    named = surfaces.items() if isinstance(surfaces, dict) else ()
    kinds = ("absorber", "lambertian", "retroreflector")
    found = {
        name for name, given in named if isinstance(given, dict) and given.get("kind") in kinds
    }
    return frozenset(found | {"absorber"})


def _spread(faces: dict[str, str], known: set[str]) -> dict[str, str]:
    """Surfaces of faces by pattern as surfaces of faces by name."""
    wanted = [(Wildcard(pattern, escapes=False), surface) for pattern, surface in faces.items()]
    return {
        face: surface
        for pattern, surface in wanted
        for face in sorted(known)
        if pattern.matches(face)
    }


def _matching(patterns: Iterable[str], names: list[str], where: str) -> set[str]:
    found: set[str] = set()
    for pattern in patterns:
        wanted = Wildcard(pattern, escapes=False)
        matched = {name for name in names if wanted.matches(name)}
        if not matched:
            near = difflib.get_close_matches(pattern, names, n=3, cutoff=0.4) or names[:8]
            raise SceneError(
                f"{where}: the file has no solid {pattern!r}; it has {', '.join(near)} (raymap "
                "faces lists all)"
            )
        found |= matched
    return found


def _check_faces(faces: dict[str, str], solids: list[CadSolid], where: str) -> None:
    known = [face.name for solid in solids for face in solid.faces]
    for pattern in faces:
        wanted = Wildcard(pattern, escapes=False)
        if not any(wanted.matches(name) for name in known):
            near = difflib.get_close_matches(pattern, known, n=3, cutoff=0.4) or known[:8]
            raise SceneError(
                f"{where}.faces.{pattern}: no solid has such a face; there are {', '.join(near)} "
                "(raymap faces lists all)"
            )


@lru_cache(maxsize=32)
def _digest(path: str, modified: int) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:32]


CAD_FILES = FileTable(
    name="cad_files",
    title="solids of CAD files",
    model=CadFileModel,
    merge=merge_cad_file,
    body_suffixes=tuple(CAD_FORMATS),
)
