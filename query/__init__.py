"""Criteria, selections, path tables and reports of ray maps.

>>> from query import count, detected, hit, select
>>> ghosts = (count(hit("L*", "reflected")) == 2) & detected("sensor")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from query.expression.builders import (
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
from query.expression.criteria import Criterion
from raymap.model.events import Event

if TYPE_CHECKING:
    from query.answers.comparison import Comparison, compare
    from query.answers.energy import Audit, audit
    from query.answers.explanation import Explanation, explain
    from query.answers.filter_strings import translate
    from query.answers.ghosts import GhostMatrix, GhostTable, ghost_matrix, ghost_table
    from query.answers.illumination import Illumination, illuminated
    from query.answers.image_files import write_image
    from query.answers.images import detector_image, detector_images
    from query.answers.pictures import DetectorImage
    from query.answers.ray_report import report
    from query.answers.rays_at_place import rays_at, write_ray_file
    from query.answers.selection import Selection
    from query.answers.selector import select, select_many
    from query.answers.sweeps import SweepRow, sweep
    from query.answers.tables import PathRow, PathTable, path_table
    from query.engine.scan import Progress
    from query.expression.grammar import parse
    from query.expression.json_form import from_json

_LAZY = {
    "Audit": "query.answers.energy",
    "Comparison": "query.answers.comparison",
    "DetectorImage": "query.answers.pictures",
    "Explanation": "query.answers.explanation",
    "GhostMatrix": "query.answers.ghosts",
    "GhostTable": "query.answers.ghosts",
    "Illumination": "query.answers.illumination",
    "PathRow": "query.answers.tables",
    "PathTable": "query.answers.tables",
    "Progress": "query.engine.scan",
    "Selection": "query.answers.selection",
    "SweepRow": "query.answers.sweeps",
    "audit": "query.answers.energy",
    "compare": "query.answers.comparison",
    "detector_image": "query.answers.images",
    "detector_images": "query.answers.images",
    "explain": "query.answers.explanation",
    "from_json": "query.expression.json_form",
    "ghost_matrix": "query.answers.ghosts",
    "ghost_table": "query.answers.ghosts",
    "illuminated": "query.answers.illumination",
    "parse": "query.expression.grammar",
    "path_table": "query.answers.tables",
    "rays_at": "query.answers.rays_at_place",
    "report": "query.answers.ray_report",
    "select": "query.answers.selector",
    "select_many": "query.answers.selector",
    "sweep": "query.answers.sweeps",
    "translate": "query.answers.filter_strings",
    "write_image": "query.answers.image_files",
    "write_ray_file": "query.answers.rays_at_place",
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
