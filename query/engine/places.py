"""Detectors placed after the trace, as people write them: ``plane(z=120, size=[36, 24])``.

What is written is the name of the detector, too: pictures, charts and criteria call it by it.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from query.engine.descriptions import (
    LARGEST,
    across,
    described,
    flat_place,
    number,
    pair,
    three,
    vector,
)
from query.expression.arguments import PLACES
from query.expression.names import unknown
from raymap.model.directory import Detector, Directory
from raymap.model.errors import RayMapError
from raymap.optics.cells import is_pinhole
from raymap.passes.crossings import Place, may_be_placed
from raymap.passes.placed import PlacedMap

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["is_place", "parse_place", "seen_by", "with_detectors"]

F64 = NDArray[np.float64]
_CALL = re.compile(rf"\s*({'|'.join(PLACES)})\s*\((.*)\)\s*", re.DOTALL)
_KEYS = {
    "plane": ("x", "y", "z", "center", "looks", "up", "size", "cells", "acceptance_deg"),
    "sphere": ("center", "radius", "axis", "cells", "side"),
    "far_field": ("axis", "c0", "cells", "gamma_deg"),
    "moved": ("detector", "by", "to", "turn", "about", "size", "cells"),
}
_EXAMPLES = {
    "plane": "plane(z=120, size=[36, 24], cells=[720, 480])",
    "sphere": "sphere(center=[0, 0, 0], radius=50, cells=[72, 36])",
    "far_field": "far_field(axis=[0, 0, 1], cells=[360, 180])",
    "moved": "moved(detector='sensor', by=[0, 0, 1])",
}


def is_place(text: str) -> bool:
    """Whether a text describes a place, and is not only the name of a detector."""
    return _CALL.fullmatch(text) is not None


def seen_by(map: RayMap, detector: str) -> RayMap:
    """The map where a detector stands that is meant: a view, if it is described and not named."""
    names = {entry.name for entry in map.directory.detectors}
    return map if detector in names or not is_place(detector) else with_detectors(map, detector)


def with_detectors(map: RayMap, *places: str) -> RayMap:
    """A view of a map with detectors that were not there when it was recorded.

    Every question takes the view in place of the map; the detectors are called by their texts.
    Light is counted as it comes along: what stood in its way when the map was recorded still does.

    Parameters
    ----------
    map : an open map of rays, or a view of one (`query.what_if`); it must stay open
    places : ``"plane(z=120, size=[36, 24], cells=[720, 480])"``: ``x``, ``y`` or ``z``, or
        ``center`` and ``looks``; ``"sphere(center=[0, 0, 0], radius=50)"``;
        ``"far_field(axis=[0, 0, 1], cells=[360, 180])"``;
        ``"moved(detector='sensor', by=[0, 0, 1])"``: a recorded one moved ``by`` or ``to``, turned
        by ``turn`` degrees about ``about``, of another ``size`` or ``cells``

    Raises
    ------
    RayMapError
        A text that describes no place; a pinhole, whose picture no ray makes.
    """
    known = {entry.name for entry in map.directory.detectors}
    found = [parse_place(text, map.directory) for text in dict.fromkeys(places)]
    return PlacedMap(map, [place for place in found if place.detector.name not in known])


def parse_place(text: str, directory: Directory) -> Place:
    """Read the description of a place.

    Raises
    ------
    RayMapError
    """
    shape, values = described(text, "place", _KEYS, _EXAMPLES)
    try:
        place: Place = _MAKERS[shape](text, values, directory)
    except ValidationError as error:
        raise RayMapError(f"{text}: {error.errors()[0]['msg']}") from None
    entry = place.detector.model_copy(update={"name": text.strip()})
    return replace(place, detector=Detector.model_validate(entry.model_dump()))


def _cells(text: str, value: Any) -> tuple[int, int]:
    if not isinstance(value, list) or len(value) != 2 or not all(type(n) is int for n in value):
        raise RayMapError(f"{text}: cells is two whole numbers, as [720, 480]")
    return int(value[0]), int(value[1])


def _plane(text: str, values: dict[str, Any], directory: Directory) -> Place:
    center, normal, looks = flat_place(text, values, "looks")
    up = None if "up" not in values else vector(text, "up", values["up"], unit=True)
    u, v = across(normal, up, text)
    if "size" not in values:
        raise RayMapError(f"{text}: size is missing, as size=[36, 24]")
    acceptance = number(text, "acceptance_deg", values.get("acceptance_deg", 90.0), 1e-6, 90.0)
    entry = Detector(
        name="plane",
        cells=_cells(text, values.get("cells", [100, 100])),
        center=three(center),
        axis_u=three(u),
        axis_v=three(v),
        size=pair(text, "size", values["size"], 1e-30, LARGEST),
        parameters={"placed_after_the_trace": True},
    )
    least = math.cos(math.radians(acceptance)) if acceptance < 90.0 else 0.0
    return Place(detector=entry, both_sides=looks is None, least_cosine=least)


def _sphere(text: str, values: dict[str, Any], directory: Directory) -> Place:
    if "radius" not in values:
        raise RayMapError(f"{text}: radius is missing")
    radius = number(text, "radius", values["radius"], 1e-30, LARGEST)
    axis = vector(text, "axis", values.get("axis", [0, 0, 1]), unit=True)
    side = values.get("side", "both")
    if side not in ("both", "outside"):
        raise RayMapError(f"{text}: side is both, or outside: light that comes from there")
    u, v = across(axis, None, text)
    cells = _cells(text, values.get("cells", [72, 36]))
    area = 4.0 * math.pi * radius**2
    entry = Detector(
        name="sphere",
        kind="surface",
        cells=cells,
        center=three(vector(text, "center", values.get("center", [0, 0, 0]))),
        axis_u=three(u),
        axis_v=three(v),
        size=(2.0 * math.pi * radius, 2.0 * radius),
        uv_meaning="projection",
        parameters={
            "sphere_radius": radius,
            "cell_area": [area / (cells[0] * cells[1])],
            "mapping": "u around the axis, v along it: cells of equal area",
            "placed_after_the_trace": True,
        },
    )
    return Place(detector=entry, both_sides=side == "both")


def _far_field(text: str, values: dict[str, Any], directory: Directory) -> Place:
    axis = vector(text, "axis", values.get("axis", [0, 0, 1]), unit=True)
    zero = None if "c0" not in values else vector(text, "c0", values["c0"], unit=True)
    if zero is None:
        u, _ = across(axis, None, text)
    else:
        u = zero - (zero @ axis) * axis
        length = float(np.linalg.norm(u))
        if length < 1e-9:
            raise RayMapError(f"{text}: c0 lies along the axis")
        u = u / length
    # Angles of type C run the other way round
    v = np.cross(u, axis)
    low, high = pair(text, "gamma_deg", values.get("gamma_deg", [0.0, 180.0]), 0.0, 180.0)
    if not low < high:
        raise RayMapError(f"{text}: gamma_deg rises")
    entry = Detector(
        name="far_field",
        kind="far_field",
        cells=_cells(text, values.get("cells", [360, 180])),
        axis_u=three(u),
        axis_v=three(v),
        size=(360.0, high - low),
        uv_meaning="projection",
        parameters={
            "gamma_deg": [low, high],
            "angles": "type_c",
            "axis": axis.tolist(),
            "size_unit": "deg",
            "placed_after_the_trace": True,
        },
    )
    return Place(detector=entry)


def _moved(text: str, values: dict[str, Any], directory: Directory) -> Place:
    names = [entry.name for entry in directory.detectors]
    name = str(values.get("detector", ""))
    if name not in names:
        raise unknown("detector", name, names)
    own = directory.detectors[names.index(name)]
    if is_pinhole(own):
        raise RayMapError(
            f"{text}: {name!r} is a pinhole, whose picture is summed up while tracing: no ray "
            "makes it, so that it cannot be moved; record it at its new place"
        )
    if not may_be_placed(own):
        raise RayMapError(
            f"{text}: {name!r} is of kind {own.kind}; planes and far fields can be moved"
        )
    parameters = {**own.parameters, "placed_after_the_trace": True, "moved_from": name}
    center = np.asarray(own.center, np.float64)
    u, v = np.asarray(own.axis_u, np.float64), np.asarray(own.axis_v, np.float64)
    if "to" in values and "by" in values:
        raise RayMapError(f"{text}: it is moved by a way or to a place, not both")
    if "to" in values:
        center = vector(text, "to", values["to"])
    if "by" in values:
        center = center + vector(text, "by", values["by"])
    if "turn" in values:
        angle = math.radians(number(text, "turn", values["turn"], -360.0, 360.0))
        if "about" not in values:
            raise RayMapError(f"{text}: about is missing, the axis that it is turned about")
        about = vector(text, "about", values["about"], unit=True)
        u, v = (_turned(vector, about, angle) for vector in (u, v))
        if own.kind == "far_field":
            axis = _turned(np.asarray(own.parameters["axis"], np.float64), about, angle)
            parameters["axis"] = axis.tolist()
    size = own.size
    if "size" in values:
        if own.kind != "plane":
            raise RayMapError(f"{text}: a {own.kind} has no size")
        size = pair(text, "size", values["size"], 1e-30, LARGEST)
    entry = own.model_copy(
        update={
            "center": three(center),
            "axis_u": three(u),
            "axis_v": three(v),
            "size": size,
            "cells": own.cells if "cells" not in values else _cells(text, values["cells"]),
            "blocking": False,
            "object": -1,
            "parameters": parameters,
        }
    )
    acceptance = own.parameters.get("acceptance_deg", 90.0)
    least = math.cos(math.radians(float(acceptance))) if float(acceptance) < 90.0 else 0.0
    both = own.kind == "far_field" or bool(own.parameters.get("both_sides", False))
    return Place(detector=entry, both_sides=both, least_cosine=least)


def _turned(vector: F64, axis: F64, angle: float) -> F64:
    """A vector turned about a unit axis (Rodrigues' formula)."""
    c, s = math.cos(angle), math.sin(angle)
    turned: F64 = vector * c + np.cross(axis, vector) * s + axis * (axis @ vector) * (1.0 - c)
    return turned


_MAKERS: dict[str, Any] = {
    "plane": _plane,
    "sphere": _sphere,
    "far_field": _far_field,
    "moved": _moved,
}
