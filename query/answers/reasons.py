"""Why a criterion matched nothing: which part of it this map can never satisfy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from query.engine import bound as b
from query.engine.scan import Scan

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["reason_for_nothing"]


def reason_for_nothing(scan: Scan, node: b.BoundNode) -> str:
    """One sentence for a person whose criterion matched no ray."""
    if not sum(portion.n_rays for portion in scan.map.portions):
        return "the map holds no rays"
    parts = _conjuncts(node)
    for part in parts:
        never = _never(part, scan)
        if never:
            return never
    counts = _counts(scan, parts)
    for part, count in zip(parts, counts, strict=True):
        if count == 0:
            return _empty(part, scan)
    if len(parts) > 1:
        shown = "; ".join(
            f"{part.text}: {count:,} rays" for part, count in zip(parts, counts, strict=True)
        )
        return f"each part is satisfied by some rays, but no ray satisfies all of them ({shown})"
    return _empty(node, scan)


def _conjuncts(node: b.BoundNode) -> list[b.BoundNode]:
    if isinstance(node, b.BoundLogic) and node.operator == "and":
        return [part for arg in node.args for part in _conjuncts(arg)]
    return [node]


def _counts(scan: Scan, parts: Sequence[b.BoundNode]) -> list[int]:
    again = Scan(scan.map, parts, threads=scan.threads)
    return [int(total.by_source.rays.sum()) for total in again.run()]


def _never(node: b.BoundNode, scan: Scan) -> str | None:
    """A reason that needs no ray to be looked at."""
    directory = scan.map.directory
    if isinstance(node, b.BoundWavelength) and not node.possible:
        nm = sorted({w for chosen in scan.map.channel_sets for w in chosen.wavelengths_nm})
        channels = ", ".join(f"{w:g}" for w in nm[:12]) + (" …" if len(nm) > 12 else "")
        return f"{node.text}: the channels of this map are {channels} nm"
    if isinstance(node, b.BoundRecorded) and not node.stored:
        return (
            f"{node.text}: this map has no column {node.column!r}; "
            "a scene with [trace] light = 'polarised' writes it"
        )
    if isinstance(node, b.BoundCount | b.BoundBounces) and _below_zero(node):
        return f"{node.text}: a count is a whole number from 0 upward"
    if isinstance(node, b.BoundDetected) and node.regions:
        outside = [_is_outside(region) for regions in node.regions.values() for region in regions]
        if outside and all(outside):
            index, regions = next(iter(node.regions.items()))
            cells = regions[0].cells
            name = directory.detectors[index].name
            return (
                f"{node.text}: the region lies outside the {cells[0]} x {cells[1]} cells of {name}"
            )
    if isinstance(node, b.BoundSource):
        silent = scan.map.emitted[node.table]
        if not silent.any():
            return f"{node.text}: this source emitted no ray in this map"
    return None


def _below_zero(node: b.BoundCount | b.BoundBounces) -> bool:
    value = node.value
    if node.operator == "==":
        return value < 0 or not float(value).is_integer()
    return (node.operator == "<" and value <= 0) or (node.operator == "<=" and value < 0)


def _is_outside(region: b.BoundRegion) -> bool:
    first, second, third, fourth = region.numbers
    width, height = region.cells
    if region.shape == "rect":
        empty = third <= first or fourth <= second
        return empty or third <= 0 or fourth <= 0 or first > width or second > height
    return (
        first + third < 0
        or second + fourth < 0
        or first - third > width
        or (second - fourth > height)
    )


def _empty(node: b.BoundNode, scan: Scan) -> str:
    """A part that no ray satisfies."""
    if isinstance(node, b.BoundHit) and not node.any_place and node.events:
        bare = b.BoundHit(places=node.places)
        [count] = _counts(scan, [bare])
        if count:
            return f"{node.text}: {count:,} rays meet it, but this never happens there in this map"
    if isinstance(node, b.BoundDetected) and node.regions:
        anywhere = b.BoundDetected(table=node.table, registered=node.registered, regions={})
        [count] = _counts(scan, [anywhere])
        if count:
            return f"{node.text}: {count:,} rays reach the detector, none inside the region"
    possible = True
    merged = scan.merged
    if merged is not None and all(part is not None for part in merged.local_to_global):
        base = scan.verdicts.base
        from query.engine.evaluate import evaluate

        assert base is not None
        possible = bool(np.any(evaluate(base, node).possible))
    if not possible:
        return f"{node.text}: no path of this map satisfies it"
    return f"{node.text}: no ray of this map satisfies it"
