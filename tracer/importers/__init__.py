"""Files of other programs as scenes: lens prescriptions (Zemax, CODE V) and CAD (STEP).

The way of a lens file: text -> `Prescription` (surfaces in their order) -> `Sequence` and `Bundles`
(its rays) -> `Elements` (parts in space, fitted together) -> tables of a scene. The way of a STEP
file: `CadSolid` -> a body in closed form, or triangles with exact normals.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tracer.importers.cad_format import read_cad
    from tracer.importers.cad_solid import CadSolid
    from tracer.importers.face_list import list_faces
    from tracer.importers.lens_scene import ImportedLens, import_lens
    from tracer.importers.prescription import ImportWarning, Prescription

_HOME = {
    "CadSolid": "cad_solid",
    "ImportWarning": "prescription",
    "ImportedLens": "lens_scene",
    "Prescription": "prescription",
    "import_lens": "lens_scene",
    "list_faces": "face_list",
    "read_cad": "cad_format",
}

__all__ = [
    "CadSolid",
    "ImportWarning",
    "ImportedLens",
    "Prescription",
    "import_lens",
    "list_faces",
    "read_cad",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"tracer.importers.{_HOME[name]}"), name)
    raise AttributeError(f"module 'tracer.importers' has no attribute {name!r}")
