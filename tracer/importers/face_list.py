"""Bodies and faces of a file with kind and area, so that a scene or a criterion can name them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import SceneError
from raymap.model.fileformat import known_suffixes
from tracer.bodies.body import Body
from tracer.bodies.lens import LensBody
from tracer.geometry.shapes import (
    Annulus,
    Conic,
    Cylinder,
    Frustum,
    Polygon,
    Rectangle,
    Shape,
    SphereCap,
)

if TYPE_CHECKING:
    from tracer.importers.cad_bodies import CadBody, CadMeshBody
    from tracer.importers.cad_solid import CadSolid

__all__ = ["list_faces"]

Row = dict[str, Any]


def list_faces(path: str | Path) -> dict[str, Any]:
    """What a STEP file, mesh file, lens file or scene file holds.

    Returns
    -------
    ``file``, ``length_unit`` (None for meshes, which carry none) and ``bodies``: for each ``name``,
    ``kind``, ``color`` and ``volume`` where they are known, and ``faces`` with ``name``, ``kind``,
    ``area`` [length_unit²], ``triangles`` of meshes, ``color`` where it is known.

    Raises
    ------
    SceneError
        for a file that cannot be read
    """
    from tracer.geometry.mesh_format import MESH_FORMATS
    from tracer.importers.cad_format import CAD_FORMATS
    from tracer.scene.files import scene_suffixes

    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in CAD_FORMATS:
        unit, bodies = "mm", _of_cad(path)
    elif suffix in MESH_FORMATS:
        unit, bodies = "", [_of_mesh_file(path)]
    elif suffix == ".toml" or suffix in scene_suffixes():
        unit, bodies = _of_scene(path)
    else:
        raise SceneError(
            f"{path.name}: {suffix or 'a file without suffix'} is not understood; faces are listed "
            f"of {known_suffixes(CAD_FORMATS.kinds())}, {known_suffixes(MESH_FORMATS.kinds())}, "
            f"{', '.join(scene_suffixes())} and .toml"
        )
    return {"file": path.name, "length_unit": unit or None, "bodies": bodies}


def _of_cad(path: Path) -> list[Row]:
    from tracer.importers.cad_format import read_cad

    return [
        {
            "name": solid.name,
            "kind": "solid",
            "volume": solid.volume,
            "color": solid.color or None,
            "faces": _solid_faces(solid, 1.0),
        }
        for solid in read_cad(path)
    ]


def _solid_faces(solid: CadSolid, scale: float) -> list[Row]:
    return [
        {
            "name": face.name,
            "kind": face.kind,
            "area": face.area * scale**2,
            "color": face.color or None,
        }
        for face in solid.faces
    ]


def _cad_faces(body: CadBody | CadMeshBody) -> list[Row]:
    """The faces of a CAD body as the CAD program has them, not as triangles."""
    from tracer.importers.cad_format import read_cad

    (solid,) = (solid for solid in read_cad(body.path) if solid.name == body.part)
    return _solid_faces(solid, body.mm)


def _of_mesh_file(path: Path) -> Row:
    from tracer.geometry.mesh_files import load_mesh

    mesh = load_mesh(path, solid=False)
    return {"name": mesh.name, "kind": "mesh", "faces": _mesh_faces(mesh)}


def _mesh_faces(mesh: Any) -> list[Row]:
    areas = np.bincount(mesh.face, weights=mesh.areas, minlength=len(mesh.face_names))
    return [
        {"name": name, "kind": "mesh", "area": area, "triangles": count}
        for name, area, count in zip(
            mesh.face_names, areas.tolist(), mesh.face_counts.tolist(), strict=True
        )
    ]


def _of_scene(path: Path) -> tuple[str, list[Row]]:
    from tracer.bodies.mesh import MeshBody
    from tracer.importers.cad_bodies import CadBody, CadMeshBody
    from tracer.scene.compile import resolve_bodies
    from tracer.scene.load import load_scene

    scene = load_scene(path)
    resolved = resolve_bodies(scene)
    rows: list[Row] = []
    for name, body in resolved.items():
        if isinstance(body, CadBody | CadMeshBody):
            faces = _cad_faces(body)
        elif isinstance(body, MeshBody):
            faces = _mesh_faces(body.read(Path(scene.folder), name))
        else:
            faces = [
                {
                    "name": plan.name,
                    "kind": " + ".join(dict.fromkeys(_kind(shape) for shape in plan.shapes)),
                    "area": sum(_area(shape) for shape in plan.shapes),
                }
                for plan in body.plan()
            ]
            if isinstance(body, LensBody) and body.front.cemented is not None:
                faces.insert(0, _cemented(resolved, body.front.cemented))
        color = getattr(body, "color", "") or None
        rows.append({"name": name, "kind": body.kind, "color": color, "faces": faces})
    return scene.length_unit, rows


def _cemented(bodies: dict[str, Body], partner: str) -> Row:
    """The front of a cemented lens: another name of the partner's back."""
    plan = next(plan for plan in bodies[partner].plan() if plan.name == "back")
    shape = plan.shapes[0]
    return {
        "name": "front",
        "kind": _kind(shape),
        "area": _area(shape),
        "same_as": f"{partner}.back",
    }


_WORDS: dict[type[Any], str] = {
    Annulus: "plane",
    Rectangle: "plane",
    Polygon: "plane",
    SphereCap: "sphere",
    Cylinder: "cylinder",
    Frustum: "cone",
}


def _kind(shape: Shape) -> str:
    if isinstance(shape, Conic):
        return "asphere" if any(shape.aspheric) else "conic"
    return _WORDS.get(type(shape), type(shape).__name__.lower())


def _area(shape: Shape) -> float:
    """Area of a face in closed form; of one without, that of its drawing."""
    for kind, area in _AREAS.items():
        if isinstance(shape, kind):
            return float(area(shape))
    vertices, triangles = shape.mesh()
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _conic_area(shape: Conic) -> float:
    """2 pi times the integral of r sqrt(1 + sag'²), by Gauss's rule."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    half = 0.5 * (shape.semi_diameter - shape.inner)
    r: NDArray[np.float64] = shape.inner + half * (nodes + 1.0)
    c = shape.curvature
    slope = c * r / np.sqrt(1.0 - (1.0 + shape.conic) * (c * r) ** 2)
    for k, coefficient in enumerate(shape.aspheric):
        slope = slope + (4 + 2 * k) * coefficient * r ** (3 + 2 * k)
    return float(2.0 * math.pi * half * np.sum(weights * r * np.sqrt(1.0 + slope**2)))


def _frustum_area(shape: Frustum) -> float:
    middle = shape.radius + shape.slope * 0.5 * (shape.low + shape.high)
    slant = (shape.high - shape.low) * math.hypot(1.0, shape.slope)
    return 2.0 * math.pi * abs(middle) * slant


_AREAS: dict[type[Any], Callable[[Any], float]] = {
    Annulus: lambda s: math.pi * (s.outer**2 - max(s.inner, 0.0) ** 2),
    Rectangle: lambda s: s.size[0] * s.size[1],
    SphereCap: lambda s: 2.0 * math.pi * s.radius * min(s.sag, 2.0 * s.radius),
    Cylinder: lambda s: 2.0 * math.pi * s.radius * (s.high - s.low),
    Frustum: _frustum_area,
    Conic: _conic_area,
}
