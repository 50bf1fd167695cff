"""Rays of a selection and the scene as 3D files: glTF, VTK PolyData, DXF, STEP.

Names are loaded when they are first used: the command's help loads no compiler.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from viewer.export.files import SUFFIXES, export_3d

__all__ = ["SUFFIXES", "export_3d"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from viewer.export import files

        return getattr(files, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
