"""Why a criterion matched nothing: which part of it this map can never satisfy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from query.engine.bound import BoundNode, evaluate
from query.engine.logic import BoundLogic
from query.engine.scan import Scan

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["reason_for_nothing"]


def reason_for_nothing(scan: Scan, node: BoundNode) -> str:
    """One sentence for a person whose criterion matched no ray."""
    if not sum(portion.n_rays for portion in scan.map.portions):
        return "the map holds no rays"
    parts = _conjuncts(node)
    for part in parts:
        never = part.never(scan.map)
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


def _conjuncts(node: BoundNode) -> list[BoundNode]:
    if isinstance(node, BoundLogic) and node.operator == "and":
        return [part for arg in node.args for part in _conjuncts(arg)]
    return [node]


def _counts(scan: Scan, parts: Sequence[BoundNode]) -> list[int]:
    again = Scan(scan.map, parts, threads=scan.threads)
    return [int(total.by_source.rays.sum()) for total in again.run()]


def _empty(node: BoundNode, scan: Scan) -> str:
    """A part that no ray satisfies."""
    wider = node.wider()
    if wider is not None:
        less, told = wider
        [count] = _counts(scan, [less])
        if count:
            return f"{node.text}: {count:,} rays {told}"
    possible = True
    merged = scan.merged
    if merged is not None and all(part is not None for part in merged.local_to_global):
        base = scan.verdicts.base
        assert base is not None
        possible = bool(np.any(evaluate(base, node).possible))
    if not possible:
        return f"{node.text}: no path of this map satisfies it"
    return f"{node.text}: no ray of this map satisfies it"
