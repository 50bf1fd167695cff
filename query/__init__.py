"""Criteria, selections, path tables and reports of ray maps.

>>> from query import count, detected, hit, select
>>> ghosts = (count(hit("L*", "reflected")) == 2) & detected("sensor")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from query.expression.criterion import Criterion
from query.expression.spellings import as_criterion
from raymap.model.events import Event

if TYPE_CHECKING:
    from query.answers.filter_strings import translate
    from query.answers.images.focus import Focus, focus
    from query.answers.images.image_files import write_image
    from query.answers.images.images import detector_image, detector_images
    from query.answers.images.pictures import DetectorImage
    from query.answers.paths.ghosts import GhostMatrix, GhostTable, ghost_matrix, ghost_table
    from query.answers.paths.tables import PathRow, PathTable, path_table
    from query.answers.reports.comparison import Comparison, compare
    from query.answers.reports.energy import Audit, audit
    from query.answers.reports.histograms import Histogram, PathNumbers, histogram, path_numbers
    from query.answers.reports.illumination import Illumination, illuminated
    from query.answers.reports.ray_report import report
    from query.answers.reports.rays_at_place import rays_at, write_ray_file
    from query.answers.reports.sweeps import SweepRow, sweep
    from query.answers.selections.explanation import Explanation, explain
    from query.answers.selections.selection import Selection
    from query.answers.selections.selector import select, select_many
    from query.answers.what_if.effect import Effect, effect, what_if
    from query.answers.what_if.improve import Improvement, improve
    from query.answers.what_if.sensitivity import Sensitivity, sensitivity
    from query.atoms.angle_of_polarisation import angle_of_polarisation
    from query.atoms.bounces import bounces
    from query.atoms.count import count
    from query.atoms.crossed import crossed
    from query.atoms.crosses import crosses
    from query.atoms.degree_of_polarisation import degree_of_polarisation
    from query.atoms.detected import detected, ellipse, rect
    from query.atoms.event import all_, event
    from query.atoms.flux import flux
    from query.atoms.hit import hit, parameter
    from query.atoms.incidence import incidence
    from query.atoms.last import last
    from query.atoms.length import length
    from query.atoms.medium import medium
    from query.atoms.optical_length import optical_length
    from query.atoms.optical_path import optical_path
    from query.atoms.path import path
    from query.atoms.source import source
    from query.atoms.time import time
    from query.atoms.wavelength import wavelength
    from query.engine.places import with_detectors
    from query.engine.scan import Progress
    from query.expression.grammar import parse
    from query.expression.json_form import from_json

_LAZY = {
    "Audit": "query.answers.reports.energy",
    "Comparison": "query.answers.reports.comparison",
    "DetectorImage": "query.answers.images.pictures",
    "Explanation": "query.answers.selections.explanation",
    "Focus": "query.answers.images.focus",
    "GhostMatrix": "query.answers.paths.ghosts",
    "GhostTable": "query.answers.paths.ghosts",
    "Histogram": "query.answers.reports.histograms",
    "Improvement": "query.answers.what_if.improve",
    "Illumination": "query.answers.reports.illumination",
    "PathNumbers": "query.answers.reports.histograms",
    "PathRow": "query.answers.paths.tables",
    "PathTable": "query.answers.paths.tables",
    "Progress": "query.engine.scan",
    "Selection": "query.answers.selections.selection",
    "Sensitivity": "query.answers.what_if.sensitivity",
    "SweepRow": "query.answers.reports.sweeps",
    "all_": "query.atoms.event",
    "angle_of_polarisation": "query.atoms.angle_of_polarisation",
    "audit": "query.answers.reports.energy",
    "bounces": "query.atoms.bounces",
    "compare": "query.answers.reports.comparison",
    "count": "query.atoms.count",
    "crossed": "query.atoms.crossed",
    "crosses": "query.atoms.crosses",
    "degree_of_polarisation": "query.atoms.degree_of_polarisation",
    "detected": "query.atoms.detected",
    "detector_image": "query.answers.images.images",
    "detector_images": "query.answers.images.images",
    "ellipse": "query.atoms.detected",
    "event": "query.atoms.event",
    "explain": "query.answers.selections.explanation",
    "flux": "query.atoms.flux",
    "focus": "query.answers.images.focus",
    "from_json": "query.expression.json_form",
    "ghost_matrix": "query.answers.paths.ghosts",
    "ghost_table": "query.answers.paths.ghosts",
    "histogram": "query.answers.reports.histograms",
    "hit": "query.atoms.hit",
    "illuminated": "query.answers.reports.illumination",
    "improve": "query.answers.what_if.improve",
    "incidence": "query.atoms.incidence",
    "last": "query.atoms.last",
    "length": "query.atoms.length",
    "medium": "query.atoms.medium",
    "optical_length": "query.atoms.optical_length",
    "optical_path": "query.atoms.optical_path",
    "parameter": "query.atoms.hit",
    "parse": "query.expression.grammar",
    "path": "query.atoms.path",
    "path_numbers": "query.answers.reports.histograms",
    "path_table": "query.answers.paths.tables",
    "rays_at": "query.answers.reports.rays_at_place",
    "rect": "query.atoms.detected",
    "report": "query.answers.reports.ray_report",
    "select": "query.answers.selections.selector",
    "select_many": "query.answers.selections.selector",
    "sensitivity": "query.answers.what_if.sensitivity",
    "source": "query.atoms.source",
    "sweep": "query.answers.reports.sweeps",
    "time": "query.atoms.time",
    "translate": "query.answers.filter_strings",
    "wavelength": "query.atoms.wavelength",
    "what_if": "query.answers.what_if.effect",
    "effect": "query.answers.what_if.effect",
    "Effect": "query.answers.what_if.effect",
    "with_detectors": "query.engine.places",
    "write_image": "query.answers.images.image_files",
    "write_ray_file": "query.answers.reports.rays_at_place",
}

__all__ = [
    "Audit",
    "Comparison",
    "Criterion",
    "DetectorImage",
    "Effect",
    "Event",
    "Explanation",
    "Focus",
    "GhostMatrix",
    "GhostTable",
    "Histogram",
    "Illumination",
    "Improvement",
    "PathNumbers",
    "PathRow",
    "PathTable",
    "Progress",
    "Selection",
    "Sensitivity",
    "SweepRow",
    "all_",
    "angle_of_polarisation",
    "as_criterion",
    "audit",
    "bounces",
    "compare",
    "count",
    "crossed",
    "crosses",
    "degree_of_polarisation",
    "detected",
    "detector_image",
    "detector_images",
    "effect",
    "ellipse",
    "event",
    "explain",
    "flux",
    "focus",
    "from_json",
    "ghost_matrix",
    "ghost_table",
    "histogram",
    "hit",
    "illuminated",
    "improve",
    "incidence",
    "last",
    "length",
    "medium",
    "optical_length",
    "optical_path",
    "parameter",
    "parse",
    "path",
    "path_numbers",
    "path_table",
    "rays_at",
    "rect",
    "report",
    "select",
    "select_many",
    "sensitivity",
    "source",
    "sweep",
    "time",
    "translate",
    "wavelength",
    "what_if",
    "with_detectors",
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
