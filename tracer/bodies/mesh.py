"""Triangles from a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from tracer.bodies.body import Body
from tracer.description.fields import Positive
from tracer.description.named_files import named_file

if TYPE_CHECKING:
    from tracer.geometry.mesh import TriangleMesh

__all__ = ["MeshBody"]


class MeshBody(Body):
    """Triangles from a file (STL, OBJ, PLY, glTF), ``scale`` scene units per unit of the file.

    ``name_by`` says what makes a face: one, group, color, or edges sharper than ``angle_deg``;
    ``smooth_deg`` interpolates normals across flatter edges.
    """

    kind: Literal["mesh"]
    file: str
    scale: Positive
    name_by: Literal["one", "group", "color", "angle"] = "group"
    angle_deg: Annotated[float, Field(gt=0, lt=180)] = 30.0
    smooth_deg: Annotated[float, Field(gt=0, lt=180)] | None = None
    flip: bool = False

    def problems(self) -> list[str]:
        if self.kind == "mesh" and "angle_deg" in self.model_fields_set and self.name_by != "angle":
            return ['angle_deg: goes with name_by = "angle", without which it has no effect']
        return super().problems()

    def reading_key(self) -> tuple[object, ...]:
        """What bodies that are placed from one reading of a file have in common."""
        return (
            self.file, self.scale, self.name_by, self.angle_deg, self.smooth_deg, self.flip,
            self.medium is None,
        )  # fmt: skip

    def read(self, folder: Path, name: str) -> TriangleMesh:
        """The triangles in the body's own frame [scene units].

        Raises
        ------
        SceneError
            where the file cannot be read or its triangles cannot be traced
        """
        from tracer.geometry.mesh_files import load_mesh

        return load_mesh(
            named_file(folder, self.file),
            name=name,
            scale=self.scale,
            faces=self.name_by,
            angle_deg=self.angle_deg,
            smooth_deg=self.smooth_deg,
            solid=self.medium is not None,
            flip=self.flip,
        )


KINDS = (MeshBody,)
