"""Triangle meshes of a scene: read once each, placed, and ready for Embree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Quadric
from tracer.bodies.mesh import MeshBody
from tracer.geometry.kinds import MESH, ROW
from tracer.geometry.mesh import TriangleMesh
from tracer.geometry.shapes import Bounds, Mesh

if TYPE_CHECKING:
    from tracer.geometry.mesh_arrays import MeshArrays
    from tracer.geometry.mesh_scene import MeshScene, Placement

__all__ = ["MeshFace", "MeshRegistry", "SceneMeshes"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneMeshes:
    """Meshes for the engine; ``first_face`` is the row of face 0 of every mesh object."""

    arrays: MeshArrays
    first_face: NDArray[np.int64]
    scene: MeshScene

    def __reduce__(self) -> tuple[Any, ...]:
        # Embree's tree does not travel: it is built again from the meshes
        return _built, (self.scene.placements, self.first_face)


def _built(placements: Sequence[Placement], first_face: NDArray[np.int64]) -> SceneMeshes:
    from tracer.geometry.mesh_scene import MeshScene

    scene = MeshScene(placements)
    return SceneMeshes(arrays=scene.arrays, first_face=first_face, scene=scene)


@dataclass(frozen=True, eq=False)
class MeshFace:
    """A named face of a mesh as a place that rays depart from: only its box is known."""

    low: Array
    high: Array
    kind: int = MESH

    def row(self) -> Array:
        return np.zeros(ROW)

    def bounds(self) -> Bounds:
        return self.low, self.high

    def quadric(self) -> Quadric | None:
        return None

    def mesh(self, segments: int = 0) -> Mesh:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)


class MeshRegistry:
    """Reads mesh files once, however often they are placed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._read: dict[tuple[object, ...], TriangleMesh] = {}
        self.placements: list[Placement] = []
        self.first_face: list[int] = []

    def place(self, name: str, body: MeshBody, first_face: int) -> TriangleMesh:
        """Add a body; its mesh in the scene's frame."""
        from tracer.geometry.mesh_scene import Placement

        key = body.reading_key()
        if key not in self._read:
            self._read[key] = body.read(self.folder, name)
        origin, frame = body.frame()
        transform = np.column_stack([frame, origin])
        self.placements.append(Placement(mesh=self._read[key], transform=transform))
        self.first_face.append(first_face)
        return self._read[key].transformed(transform)

    def finish(self) -> SceneMeshes | None:
        """All meshes behind one search tree; None where there is none."""
        if not self.placements:
            return None
        return _built(self.placements, np.array(self.first_face, np.int64))
