"""Make parts possible: edges that cross and neighbours that overlap are trimmed."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from tracer.importers.parts import Part

__all__ = ["fit_parts"]

_STEPS = 512
_THINNEST_EDGE = 1e-3
"""Thickness of a trimmed edge, in that of the middle."""


def fit_parts(parts: list[Part]) -> Iterator[str]:
    """Change the parts until none crosses itself or another one; say what was trimmed."""
    for part in parts:
        yield from _fit_edge(part)
    ordered = sorted(parts, key=lambda part: part.low.z)
    for first, second in itertools.combinations(ordered, 2):
        if first.high is second.low:
            continue
        yield from _fit_pair(first, second)


def _crossing(part: Part) -> float | None:
    """Distance from the axis at which the faces of a part come too close; None if they do not."""
    least = _THINNEST_EDGE * (part.high.z - part.low.z)
    for r in np.linspace(0.0, part.outer, _STEPS + 1):
        thickness = part.high.height(float(r)) - part.low.height(float(r))
        if not thickness >= least:
            return float(r)
    return None


def _fit_edge(part: Part) -> Iterator[str]:
    if _crossing(part) is None:
        return
    # A land may be what crosses: carry the smaller face on to the rim instead
    small, large = sorted((part.low, part.high), key=lambda face: face.semi_diameter)
    before = small.semi_diameter
    part.limit = large.semi_diameter
    small.semi_diameter = large.semi_diameter
    where = _crossing(part)
    if where is None:
        return
    kept = max(before, min(where * (1.0 - 1.0 / _STEPS), large.semi_diameter))
    cut = large.semi_diameter
    small.semi_diameter = large.semi_diameter = kept
    while (where := _crossing(part)) is not None and where > 0.0:
        kept = min(where, kept) * (1.0 - 1.0 / _STEPS)
        small.semi_diameter = large.semi_diameter = kept
    part.limit = kept
    yield (
        f"{part.name} (surfaces {part.numbers}): its faces cross at the edge; it is trimmed from "
        f"radius {cut:.5g} to {kept:.5g}"
    )


def _overlap(first: Part, second: Part) -> float | None:
    """Distance from the axis at which ``second`` runs into ``first``, which lies before it."""
    inside = max(first.hole, second.hole)
    reach = min(first.outer, second.outer)
    if reach <= inside or second.lowest > first.highest:
        return None
    tolerance = 1e-12 * (abs(first.high.z) + abs(second.low.z) + 1.0)
    for r in np.linspace(inside, reach, _STEPS + 1):
        gap = second.low.height(float(r)) - first.high.height(float(r))
        if not gap >= -tolerance:
            return float(r)
    return None


def _fit_pair(first: Part, second: Part) -> Iterator[str]:
    if _overlap(first, second) is None:
        return
    # What a file says about rims, and flat lands, are free: give them up first
    for part in (first, second):
        part.limit = min(part.limit, max(part.low.semi_diameter, part.high.semi_diameter))
    if _overlap(first, second) is None:
        return
    for part, face in ((first, first.high), (second, second.low)):
        before = face.semi_diameter
        face.semi_diameter = part.outer
        if _crossing(part) is not None or not np.isfinite(face.sag(part.outer)):
            face.semi_diameter = before
    where = _overlap(first, second)
    if where is None:
        return
    kept = where * (1.0 - 1.0 / _STEPS)
    for part in (first, second):
        for face in (part.low, part.high):
            face.semi_diameter = min(face.semi_diameter, kept)
        part.limit = kept
    yield (
        f"{first.name} and {second.name} (surfaces {first.numbers}; {second.numbers}) run into "
        f"each other; both are trimmed to radius {kept:.5g}"
    )
