"""Criteria, selections, path tables and reports of ray maps.

>>> from query import count, detected, hit, select
>>> ghosts = (count(hit("L*", "reflected")) == 2) & detected("sensor")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from query.builders import (
    all_,
    as_criterion,
    bounces,
    count,
    crossed,
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
    parameter,
    path,
    rect,
    source,
    wavelength,
)
from query.criteria import Criterion
from raymap.events import Event

if TYPE_CHECKING:
    from query.grammar import parse
    from query.json_form import from_json
    from query.scan import Progress
    from query.selection import Selection
    from query.selector import select, select_many

_LAZY = {
    "Progress": "query.scan",
    "Selection": "query.selection",
    "from_json": "query.json_form",
    "parse": "query.grammar",
    "select": "query.selector",
    "select_many": "query.selector",
}

__all__ = [
    "Criterion",
    "Event",
    "Progress",
    "Selection",
    "all_",
    "as_criterion",
    "bounces",
    "count",
    "crossed",
    "detected",
    "ellipse",
    "event",
    "flux",
    "from_json",
    "hit",
    "incidence",
    "last",
    "length",
    "medium",
    "optical_length",
    "parameter",
    "parse",
    "path",
    "rect",
    "select",
    "select_many",
    "source",
    "wavelength",
]


def __getattr__(name: str) -> Any:
    """Load what needs compiled code only when it is asked for."""
    if name not in _LAZY:
        raise AttributeError(f"module 'query' has no attribute {name!r}")
    value = getattr(import_module(_LAZY[name]), name)
    globals()[name] = value
    return value
