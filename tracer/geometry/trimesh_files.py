"""Mesh files as the package trimesh reads them, held to what their bytes can pay for."""

from __future__ import annotations

import logging
from collections.abc import Collection
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import MissingExtra, RayMapError, SceneError
from raymap.model.givenfile import given_bytes, not_readable
from tracer.description.named_files import named_file
from tracer.geometry.mesh_format import MeshArrays
from tracer.geometry.polygon_files import with_triangles

__all__ = ["check_parts", "read_with_trimesh"]

_LARGEST_BYTES = 2 * 2**30
"""Of a file that a mesh file names."""

_TRIANGLES_FLOOR, _TRIANGLES_PER_BYTE = 2**22, 16
"""Triangles of any mesh file, and as many times its bytes."""


_PARTS_FLOOR, _BYTES_PER_PART = 4096, 256
"""Nodes, primitives and groups of any mesh file, and bytes that pay for one more: trimesh takes
milliseconds for each."""


class _Beside:
    """Files that a mesh file names (buffers, materials): named by the scene through it.

    Textures are not among them: nothing looks at their pixels, which may be many, and what draws
    a picture of a strange format is another program.
    """

    def __init__(self, folder: Path, names: Collection[str]) -> None:
        self.folder, self.names = folder, names
        self._known: dict[str, bytes] = {}

    def get(self, name: str) -> bytes:
        """The bytes of a file beside the mesh file; those of a file that is named twice, once."""
        if name not in self.names:
            raise FileNotFoundError(f"{name} is not read")
        if name not in self._known:
            path = named_file(self.folder, name.strip())
            self._known[name] = given_bytes(path, "file", SceneError, largest=_LARGEST_BYTES)
        return self._known[name]

    __getitem__ = get

    def keys(self) -> list[str]:
        """No names: nothing is looked for that the mesh file does not name."""
        return []


class _Named(BytesIO):
    """Bytes with the name of a file, by which trimesh calls parts without a name."""

    def __init__(self, data: bytes, name: str) -> None:
        super().__init__(data)
        self.name = name


def read_with_trimesh(
    file: Path,
    where: str,
    *,
    named_by_file: bool = False,
    beside: Collection[str] = (),
    **options: Any,
) -> MeshArrays:
    """Vertices, triangles, and for each triangle its group and colour.

    Parameters
    ----------
    where : as messages begin
    named_by_file : trimesh calls a part without a name as the file
    beside : names of further files that may be read, as the file gives them
    options : of trimesh's loader
    """
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtra(
            f"{where}: reading {file.name} needs the package trimesh; pip install 'raymap[mesh]'"
        ) from error
    # What trimesh logs of files that it cannot read stands in our error
    logging.getLogger("trimesh").addHandler(logging.NullHandler())
    options |= {"process": False, "resolver": _Beside(file.parent, beside)}
    try:
        given = file.read_bytes()
        changed = with_triangles(given, file.suffix, f"{where}: {file.name}")
        if changed is given:
            scene = trimesh.load_scene(file, **options)
        else:
            suffix = file.suffix.lower().removeprefix(".")
            stream = _Named(changed, file.name)
            scene = trimesh.load_scene(stream, file_type=suffix, **options)
    except RayMapError as error:
        # Of a file that this one names
        raise SceneError(f"{where}: {file.name}: {error}") from None
    except OSError as error:
        raise SceneError(f"{where}: {not_readable(file, 'mesh file', error)}") from None
    except Exception as error:  # a reader of foreign files may raise anything
        raise SceneError(
            f"{where}: {file.name} cannot be read as a mesh ({error}); "
            "STL, OBJ, PLY, glTF and GLB are understood"
        ) from error
    vertices, triangles, groups, colors = [], [], [], []
    nodes = list(scene.graph.nodes_geometry)
    # trimesh calls by the name of the file what has none of its own
    made_up = {file.name, "geometry_0", ""}
    made_up |= {file.stem} if named_by_file else set()
    first = 0
    _check_count(scene, nodes, file, where)
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
        raise SceneError(f"{where}: {file.name} holds no triangles")
    painted = [color for color in colors if color is not None]
    return MeshArrays(
        np.concatenate(vertices),
        np.concatenate(triangles),
        groups,
        np.concatenate(painted) if len(painted) == len(colors) else None,
    )


def check_parts(file: Path, where: str, n: int) -> None:
    """Refuse more nodes, primitives or groups than the file can pay for."""
    limit = max(_PARTS_FLOOR, file.stat().st_size // _BYTES_PER_PART)
    if n > limit:
        raise SceneError(
            f"{where}: {file.name} has {n} nodes, primitives or groups; a file of its size "
            f"may have {limit}; join them in the program that wrote it"
        )


def _check_count(scene: Any, nodes: list[Any], file: Path, where: str) -> None:
    """Refuse more triangles than the file can pay for: nodes may place one mesh many times."""
    shown = (scene.geometry[scene.graph[node][1]] for node in nodes)
    total = sum(len(geometry.faces) for geometry in shown if hasattr(geometry, "faces"))
    limit = max(_TRIANGLES_FLOOR, _TRIANGLES_PER_BYTE * file.stat().st_size)
    if total > limit:
        raise SceneError(
            f"{where}: {file.name} places {total} triangles; a file of its size may have {limit}"
        )


def _colors(geometry: Any) -> NDArray[np.uint8] | None:
    visual = geometry.visual
    if getattr(visual, "kind", None) not in ("face", "vertex"):
        return None
    return np.asarray(visual.face_colors, np.uint8)
