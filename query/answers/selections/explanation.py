"""How a criterion is answered on a map, and how many rays satisfy each part of it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from query.answers.selections.reasons import reason_for_nothing
from query.engine.bind import Binder
from query.engine.bound import BoundNode
from query.engine.logic import BoundEverything
from query.engine.scan import Cancel, Scan, map_facts
from query.engine.second_try import asked_again
from query.expression.criterion import Criterion
from query.expression.spellings import as_criterion

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["Explanation", "Step", "explain"]

_COLUMNS = {
    "triangle": "triangle",
    "descriptors": "descriptors",
    "color": "color_code",
    "position": "position",
    "normal": "normal",
    "weight": "weight",
}
"""Columns of the streams that nodes ask for; any other is an optional column."""


@dataclass(frozen=True)
class Step:
    """A part of the criterion.

    Attributes
    ----------
    text : the part; ``depth`` in the tree
    rays : how many rays satisfy it; point conditions: at some point
    decided_by : "paths", or the streams that some rays need
    """

    text: str
    depth: int
    rays: int
    decided_by: str


@dataclass(frozen=True)
class Explanation:
    """Plan and counts.

    Attributes
    ----------
    steps : parts of the criterion, from the whole down
    portions : of the map; ``portions_to_read`` must be looked at for a count
    streams : stored bytes of each stream that must be read, over those portions
    merged : the map has a merged dictionary of ``n_paths`` paths
    paths_true, paths_unknown : paths that satisfy it for certain; that need their rays looked at
    """

    criterion: str
    rays: int
    steps: tuple[Step, ...]
    portions: int
    portions_to_read: int
    streams: dict[str, int]
    merged: bool
    n_paths: int
    paths_true: int
    paths_unknown: int
    seconds: float
    reason: str | None

    def to_json(self) -> dict[str, Any]:
        out = dict(self.__dict__)
        out["steps"] = [dict(step.__dict__) for step in self.steps]
        return out

    def __str__(self) -> str:
        lines = [f"{self.criterion}"]
        if self.merged:
            lines.append(
                f"{self.n_paths:,} different paths: {self.paths_true:,} true, "
                f"{self.paths_unknown:,} need their rays looked at"
            )
        else:
            lines.append("no merged dictionary (unfinished map): portions are asked one by one")
        size = sum(self.streams.values())
        lines.append(
            f"{self.portions_to_read} of {self.portions} portions to read, {size / 1e6:.1f} MB"
            + "".join(f"; {name} {stored / 1e6:.1f} MB" for name, stored in self.streams.items())
        )
        width = max((len(f"{step.rays:,}") for step in self.steps), default=1)
        for step in self.steps:
            note = "" if step.decided_by == "paths" else f"   [{step.decided_by}]"
            lines.append(f"{step.rays:>{width},}  {'  ' * step.depth}{step.text}{note}")
        if self.reason:
            lines.append(f"nothing matches: {self.reason}")
        return "\n".join(lines)


def _parts(node: Criterion, depth: int = 0) -> list[tuple[Criterion, int]]:
    """The criterion and its parts that can be asked of a ray, from the whole down."""
    found = [(node, depth)]
    for child in node.children:
        found += _parts(child, depth + 1)
    return found


@asked_again
def explain(
    map: RayMap, criterion: object, *, threads: int | None = None, cancel: Cancel = None
) -> Explanation:
    """Say how a criterion is answered and how many rays satisfy each of its parts.

    The whole and all parts are counted in one pass.
    """
    start = time.perf_counter()
    node = as_criterion(criterion)
    binder = Binder(map_facts(map))
    text = criterion if isinstance(criterion, str) else None
    parts: list[tuple[Criterion, int]] = [] if node is None else _parts(node)
    bound: list[BoundNode] = [BoundEverything()]
    if node is not None:
        binder.bind(node, text)
        bound = [binder.bind(part, text) for part, _ in parts]
    alone = Scan(map, bound[:1])
    to_read = alone.open_portions
    pairs = alone.verdicts.pairs
    scan = Scan(map, bound, threads=threads, cancel=cancel)
    counts = [int(total.by_source.rays.sum()) for total in scan.run()]
    steps = tuple(
        Step(str(part), depth, rays, ", ".join(sorted(own.streams)) or "paths")
        for (part, depth), own, rays in zip(parts, bound, counts, strict=False)
    )
    merged = alone.verdicts.base
    reason = reason_for_nothing(alone, bound[0]) if counts[0] == 0 else None
    return Explanation(
        criterion="every ray" if node is None else str(node),
        rays=int(map.rays),
        steps=steps,
        portions=len(map.portions),
        portions_to_read=len(to_read),
        streams=_stream_bytes(map, to_read, bound[0]),
        merged=merged is not None,
        n_paths=merged.n_rays if merged is not None else 0,
        paths_true=int(pairs[0].certain.sum()) if pairs else 0,
        paths_unknown=int((pairs[0].possible & ~pairs[0].certain).sum()) if pairs else 0,
        seconds=time.perf_counter() - start,
        reason=reason,
    )


def _stream_bytes(map: RayMap, portions: list[int], node: BoundNode) -> dict[str, int]:
    """Stored bytes of what must be read, by name."""
    if not portions:
        return {}
    wanted = {"path_numbers": "path_numbers"} | {
        name: _COLUMNS.get(name, f"x:{name}") for name in sorted(node.streams)
    }
    return {
        name: sum(map.portions[index].stream_bytes(column) for index in portions)
        for name, column in wanted.items()
    }
