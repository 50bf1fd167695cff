"""Load meshes from STL, OBJ, PLY and glTF files."""

from __future__ import annotations

import json
import logging
import warnings
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import MissingExtra, RayMapError, SceneError
from raymap.model.givenfile import check_given, given_bytes, not_readable
from tracer.description.named_files import named_file
from tracer.geometry.mesh import (
    MeshWarning,
    TriangleMesh,
    faces_by_angle,
    make_mesh,
    smooth_normals,
)
from tracer.geometry.mesh_scene import count_crossing_edges
from tracer.geometry.polygon_files import with_triangles

__all__ = ["FaceRule", "load_mesh"]

FaceRule = Literal["one", "group", "color", "angle"]

SUFFIXES = (".stl", ".obj", ".ply", ".off", ".gltf", ".glb")
"""Archives and XML (3MF, COLLADA, ZAE, …), which trimesh would unpack too, are left out."""

_LARGEST_BYTES = 2 * 2**30
"""Of a file that a mesh file names."""

CROSSINGS_UP_TO = 300_000
"""Larger meshes are not searched for self-intersections when they are loaded."""


def load_mesh(
    path: str | Path,
    *,
    name: str | None = None,
    scale: float = 1.0,
    faces: FaceRule = "group",
    angle_deg: float = 30.0,
    smooth_deg: float | None = None,
    solid: bool = True,
    flip: bool = False,
) -> TriangleMesh:
    """Read a mesh file and name its faces.

    Parameters
    ----------
    path : STL, OBJ, PLY, glTF or GLB file
    name : of the body; the file's name by default
    scale : length of the file's unit in scene units (mesh files carry no unit)
    faces : "one" face for all triangles; one per "group" (object, node or material of the file);
        one per "color" of the triangles; or faces that end at edges sharper than ``angle_deg``
    smooth_deg : interpolate normals across edges flatter than this; None keeps flat triangles
    solid : the mesh must be closed
    flip : turn all triangles over

    Raises
    ------
    SceneError
        if the file cannot be read, or the mesh cannot be traced
    MissingExtra
        without the package trimesh
    """
    file = Path(path)
    body = name or file.stem
    if not np.isfinite(scale) or scale <= 0.0:
        raise SceneError(f"mesh {body!r}: the scale must be positive, got {scale:g}")
    vertices, triangles, groups, colors = _read(file, body)
    labels: list[str] | None = None
    if faces == "group":
        labels = groups
    elif faces == "color":
        if colors is None:
            raise SceneError(
                f"mesh {body!r}: {file.name} has no colours of triangles; name faces by "
                '"group" or "angle"'
            )
        labels = ["#{:02x}{:02x}{:02x}".format(*row[:3]) for row in colors.tolist()]
    mesh = make_mesh(vertices * scale, triangles, name=body, labels=labels, solid=solid, flip=flip)
    if faces == "angle":
        mesh = faces_by_angle(mesh, angle_deg)
    if smooth_deg is not None:
        mesh = smooth_normals(mesh, smooth_deg)
    if solid and len(mesh.triangles) <= CROSSINGS_UP_TO:
        crossing = count_crossing_edges(mesh)
        if crossing:
            warnings.warn(
                f"mesh {body!r}: {crossing} edges run through triangles elsewhere: it intersects "
                "itself, and light between may find itself in the wrong medium; join its parts in "
                "the program that wrote it",
                MeshWarning,
                stacklevel=2,
            )
    return mesh


_TRIANGLES_FLOOR, _TRIANGLES_PER_BYTE = 2**22, 16
"""Triangles of any mesh file, and as many times its bytes."""


_ZEROS = 2**20
"""Rows of a table of a glTF file that has no bytes."""

_PARTS_FLOOR, _BYTES_PER_PART = 4096, 256
"""Nodes, primitives and groups of any mesh file, and bytes that pay for one more: trimesh takes
milliseconds for each."""


class _Beside:
    """Files that a mesh file names (buffers, materials): named by the scene through it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def get(self, name: str) -> bytes:
        """The bytes of a file beside the mesh file."""
        place = named_file(self.folder, name.strip())
        return given_bytes(place, "file", SceneError, largest=_LARGEST_BYTES)

    __getitem__ = get

    def keys(self) -> list[str]:
        """No names: nothing is looked for that the mesh file does not name."""
        return []


class _Named(BytesIO):
    """Bytes with the name of a file, by which trimesh calls parts without a name."""

    def __init__(self, data: bytes, name: str) -> None:
        super().__init__(data)
        self.name = name


def _read(
    file: Path, body: str
) -> tuple[NDArray[np.float64], NDArray[np.int64], list[str], NDArray[np.uint8] | None]:
    """Vertices, triangles, and for each triangle its group and colour."""
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtra(
            f"mesh {body!r}: reading {file.name} needs the package trimesh; "
            "pip install 'raymap[mesh]'"
        ) from error
    try:
        check_given(file, "mesh file", SceneError)
    except SceneError as error:
        raise SceneError(f"mesh {body!r}: {error}") from None
    if file.suffix.lower() in (".step", ".stp"):
        raise SceneError(
            f"mesh {body!r}: {file.name} holds solids, not triangles; name it in [cad_files]"
        )
    if file.suffix.lower() not in SUFFIXES:
        raise SceneError(
            f"mesh {body!r}: {file.name} is of a kind that is not read; files may end in "
            f"{', '.join(SUFFIXES)}"
        )
    if file.suffix.lower() in (".glb", ".gltf"):
        _check_gltf(file, body)
    # What trimesh logs of files that it cannot read stands in our error
    logging.getLogger("trimesh").addHandler(logging.NullHandler())
    options: dict[str, Any] = {"process": False, "resolver": _Beside(file.parent)}
    if file.suffix.lower() == ".obj":
        options |= {"split_objects": True, "split_groups": True}
        _check_parts(file, body, _obj_parts(file))
    elif file.suffix.lower() in (".glb", ".gltf"):
        # Nothing looks at textures, whose pixels may be many
        options["skip_materials"] = True
    try:
        given = file.read_bytes()
        changed = with_triangles(given, file.suffix, f"mesh {body!r}: {file.name}")
        if changed is given:
            scene = trimesh.load_scene(file, **options)
        else:
            suffix = file.suffix.lower().removeprefix(".")
            stream = _Named(changed, file.name)
            scene = trimesh.load_scene(stream, file_type=suffix, **options)
    except RayMapError as error:
        # Of a file that this one names
        raise SceneError(f"mesh {body!r}: {file.name}: {error}") from None
    except OSError as error:
        raise SceneError(f"mesh {body!r}: {not_readable(file, 'mesh file', error)}") from None
    except Exception as error:  # a reader of foreign files may raise anything
        raise SceneError(
            f"mesh {body!r}: {file.name} cannot be read as a mesh ({error}); "
            "STL, OBJ, PLY, glTF and GLB are understood"
        ) from error
    vertices, triangles, groups, colors = [], [], [], []
    nodes = list(scene.graph.nodes_geometry)
    # trimesh calls by the name of the file what has none of its own
    made_up = {file.name, "geometry_0", ""}
    made_up |= {file.stem} if file.suffix.lower() in (".stl", ".ply") else set()
    first = 0
    _check_count(scene, nodes, file, body)
    for node in nodes:
        transform, geometry_name = scene.graph[node]
        geometry = scene.geometry[geometry_name]
        if not hasattr(geometry, "faces"):
            continue
        placed = geometry.copy()
        placed.apply_transform(transform)
        vertices.append(np.asarray(placed.vertices, np.float64))
        triangles.append(np.asarray(placed.faces, np.int64) + first)
        groups += ["surface" if str(node) in made_up else str(node)] * len(placed.faces)
        colors.append(_colors(placed))
        first += len(placed.vertices)
    if not vertices:
        raise SceneError(f"mesh {body!r}: {file.name} holds no triangles")
    painted = [color for color in colors if color is not None]
    return (
        np.concatenate(vertices),
        np.concatenate(triangles),
        groups,
        np.concatenate(painted) if len(painted) == len(colors) else None,
    )


def _check_gltf(file: Path, body: str) -> None:
    """Refuse a glTF file that claims more than its bytes can pay for, before trimesh reads it.

    Tables without bytes are zeros, which trimesh makes before it looks at anything else. Nodes that
    stand below several others, which the standard forbids, are placed as often as there are ways to
    them.
    """
    data = file.read_bytes()
    try:
        if data[:4] == b"glTF":
            length = int.from_bytes(data[12:16], "little")
            data = data[20 : 20 + length]
        described = json.loads(data)
        views = [int(view.get("byteLength", 0)) for view in described.get("bufferViews", [])]
        for accessor in described.get("accessors", []):
            rows, place = int(accessor.get("count", 0)), accessor.get("bufferView")
            limit = _ZEROS if place is None else views[place]
            if rows > limit:
                raise SceneError(
                    f"mesh {body!r}: {file.name} claims a table of {rows} rows; its bytes hold at "
                    f"most {limit}"
                )
        nodes = described.get("nodes", [])
        meshes = [len(mesh.get("primitives", [])) for mesh in described.get("meshes", [])]
        placed = sum(meshes[node["mesh"]] for node in nodes if node.get("mesh") is not None)
        _check_parts(file, body, len(nodes) + sum(meshes) + placed)
        below = [int(child) for node in nodes for child in node.get("children", [])]
        tops = [[int(node) for node in one.get("nodes", [])] for one in described.get("scenes", [])]
        if any(len({*below, *top}) != len(below) + len(top) for top in tops or [[]]):
            raise SceneError(
                f"mesh {body!r}: {file.name} places a node below several others; glTF wants a tree"
            )
    except (ValueError, TypeError, AttributeError, LookupError, RecursionError) as error:
        raise SceneError(
            f"mesh {body!r}: {file.name} cannot be read as a mesh (its glTF description: {error})"
        ) from None


def _obj_parts(file: Path) -> int:
    """Objects, groups and uses of materials of an OBJ file."""
    with file.open("rb") as lines:
        return sum(line.lstrip().startswith((b"o ", b"g ", b"usemtl ")) for line in lines)


def _check_parts(file: Path, body: str, n: int) -> None:
    """Refuse more nodes, primitives or groups than the file can pay for."""
    limit = max(_PARTS_FLOOR, file.stat().st_size // _BYTES_PER_PART)
    if n > limit:
        raise SceneError(
            f"mesh {body!r}: {file.name} has {n} nodes, primitives or groups; a file of its size "
            f"may have {limit}; join them in the program that wrote it"
        )


def _check_count(scene: Any, nodes: list[Any], file: Path, body: str) -> None:
    """Refuse more triangles than the file can pay for: nodes may place one mesh many times."""
    shown = (scene.geometry[scene.graph[node][1]] for node in nodes)
    total = sum(len(geometry.faces) for geometry in shown if hasattr(geometry, "faces"))
    limit = max(_TRIANGLES_FLOOR, _TRIANGLES_PER_BYTE * file.stat().st_size)
    if total > limit:
        raise SceneError(
            f"mesh {body!r}: {file.name} places {total} triangles; a file of its size may have "
            f"{limit}"
        )


def _colors(geometry: Any) -> NDArray[np.uint8] | None:
    visual = geometry.visual
    if getattr(visual, "kind", None) not in ("face", "vertex"):
        return None
    return np.asarray(visual.face_colors, np.uint8)
