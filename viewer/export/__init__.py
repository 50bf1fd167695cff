"""Rays of a selection and the scene as 3D files: glTF, VTK PolyData, DXF, STEP.

Names are loaded when they are first used: the command's help loads no compiler.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from viewer.export.files import export_3d
    from viewer.export.format import EXPORT_FORMATS

__all__ = ["EXPORT_FORMATS", "export_3d"]


def __getattr__(name: str) -> Any:
    if name == "export_3d":
        from viewer.export.files import export_3d

        return export_3d
    if name == "EXPORT_FORMATS":
        from viewer.export.format import EXPORT_FORMATS

        return EXPORT_FORMATS
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
