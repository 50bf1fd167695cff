"""Rays of a selection and the scene as 3D files: glTF, VTK PolyData, DXF, STEP."""

from __future__ import annotations

from viewer.models.files import SUFFIXES, export_3d

__all__ = ["SUFFIXES", "export_3d"]
