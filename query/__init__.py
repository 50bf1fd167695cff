"""Criteria, selections, path tables and reports of ray maps.

>>> from query import count, detected, hit, select
>>> ghosts = (count(hit("L*", "reflected")) == 2) & detected("sensor")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from query.builders import (
    all_,
    angle_of_polarisation,
    as_criterion,
    bounces,
    count,
    crossed,
    degree_of_polarisation,
    detected,
    ellipse,
    event,
    flux,
    hit,
    incidence,
    last,
    length,
    medium,
    optical_length,
    optical_path,
    parameter,
    path,
    rect,
    source,
    wavelength,
)
from query.criteria import Criterion
from raymap.events import Event

if TYPE_CHECKING:
    from query.comparison import Comparison, compare
    from query.energy import Audit, audit
    from query.explanation import Explanation, explain
    from query.filter_strings import translate
    from query.ghosts import GhostMatrix, GhostTable, ghost_matrix, ghost_table
    from query.grammar import parse
    from query.illumination import Illumination, illuminated
    from query.image_files import write_image
    from query.images import detector_image, detector_images
    from query.json_form import from_json
    from query.pictures import DetectorImage
    from query.ray_report import report
    from query.rays_at_place import rays_at, write_ray_file
    from query.scan import Progress
    from query.selection import Selection
    from query.selector import select, select_many
    from query.sweeps import SweepRow, sweep
    from query.tables import PathRow, PathTable, path_table

_LAZY = {
    "Audit": "query.energy",
    "Comparison": "query.comparison",
    "DetectorImage": "query.pictures",
    "Explanation": "query.explanation",
    "GhostMatrix": "query.ghosts",
    "GhostTable": "query.ghosts",
    "Illumination": "query.illumination",
    "PathRow": "query.tables",
    "PathTable": "query.tables",
    "Progress": "query.scan",
    "Selection": "query.selection",
    "SweepRow": "query.sweeps",
    "audit": "query.energy",
    "compare": "query.comparison",
    "detector_image": "query.images",
    "detector_images": "query.images",
    "explain": "query.explanation",
    "from_json": "query.json_form",
    "ghost_matrix": "query.ghosts",
    "ghost_table": "query.ghosts",
    "illuminated": "query.illumination",
    "parse": "query.grammar",
    "path_table": "query.tables",
    "rays_at": "query.rays_at_place",
    "report": "query.ray_report",
    "select": "query.selector",
    "select_many": "query.selector",
    "sweep": "query.sweeps",
    "translate": "query.filter_strings",
    "write_image": "query.image_files",
    "write_ray_file": "query.rays_at_place",
}

__all__ = [
    "Audit",
    "Comparison",
    "Criterion",
    "DetectorImage",
    "Event",
    "Explanation",
    "GhostMatrix",
    "GhostTable",
    "Illumination",
    "PathRow",
    "PathTable",
    "Progress",
    "Selection",
    "SweepRow",
    "all_",
    "angle_of_polarisation",
    "as_criterion",
    "audit",
    "bounces",
    "compare",
    "count",
    "crossed",
    "degree_of_polarisation",
    "detected",
    "detector_image",
    "detector_images",
    "ellipse",
    "event",
    "explain",
    "flux",
    "from_json",
    "ghost_matrix",
    "ghost_table",
    "hit",
    "illuminated",
    "incidence",
    "last",
    "length",
    "medium",
    "optical_length",
    "optical_path",
    "parameter",
    "parse",
    "path",
    "path_table",
    "rays_at",
    "rect",
    "report",
    "select",
    "select_many",
    "source",
    "sweep",
    "translate",
    "wavelength",
    "write_image",
    "write_ray_file",
]


def __getattr__(name: str) -> Any:
    """Load what needs compiled code only when it is asked for."""
    if name not in _LAZY:
        raise AttributeError(f"module 'query' has no attribute {name!r}")
    value = getattr(import_module(_LAZY[name]), name)
    globals()[name] = value
    return value
