"""What a CAD file holds, whatever its format: solids and their faces."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

__all__ = ["CadFace", "CadSolid"]


@dataclass(frozen=True, kw_only=True, eq=False)
class CadFace:
    """A face of a solid; ``shape`` is OpenCASCADE's, in millimetres; ``color`` "#rrggbb" or ""."""

    name: str
    shape: Any
    kind: str
    area: float
    color: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class CadSolid:
    """A solid in place, lengths in millimetres; ``size`` is the diagonal of its box."""

    origin: str
    name: str
    shape: Any
    volume: float
    size: float
    color: str = ""
    faces: tuple[CadFace, ...] = field(default=())
