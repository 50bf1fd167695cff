"""The registries of this room, by name; ``raymap kinds`` lists what is in them."""

from __future__ import annotations

from typing import Any

from raymap.model.registry import Registry
from tracer.bodies.registry import BODIES
from tracer.detectors.registry import DETECTORS
from tracer.geometry.mesh_format import MESH_FORMATS
from tracer.geometry.other_shapes import SHAPES
from tracer.importers.cad_format import CAD_FORMATS
from tracer.importers.lens_format import LENS_FORMATS
from tracer.light import LIGHT_FORMATS
from tracer.media.keys.key import MEDIUM_KEYS
from tracer.media.phases.phase import PHASES
from tracer.scene.files import FILE_TABLES
from tracer.sources.registry import SOURCES
from tracer.surfaces.registry import SURFACES
from tracer.surfaces.scatter_laws.law import SCATTER_LAWS

__all__ = ["REGISTRIES"]

REGISTRIES: dict[str, Registry[Any]] = {
    "bodies": BODIES,
    "shapes": SHAPES,
    "surfaces": SURFACES,
    "scatter_laws": SCATTER_LAWS,
    "media": MEDIUM_KEYS,
    "phases": PHASES,
    "sources": SOURCES,
    "detectors": DETECTORS,
    "scene_files": FILE_TABLES,
    "lens_formats": LENS_FORMATS,
    "cad_formats": CAD_FORMATS,
    "mesh_formats": MESH_FORMATS,
    "light_formats": LIGHT_FORMATS,
}
