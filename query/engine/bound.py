"""Bound criteria: names resolved to tables over indices, units to the map's units.

A bound node answers for every ray of a context, as a Kleene pair: on path dictionaries columns
beyond the path are unknown, on rays with their streams the pair is exact. It says which streams it
needs beyond the path (`streams`); an empty set means that the path alone decides it. Point
conditions also answer for every point, crossings of detectors for every crossing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from query.engine.context import Context, RayContext
from query.engine.kleene import Bools, Pair, apply, exactly, gather
from query.engine.surface_parameters import COMPARISONS
from raymap.model.unfinished import Unfinished

__all__ = [
    "BoundCompare",
    "BoundCrossing",
    "BoundNode",
    "BoundPoint",
    "BoundValue",
    "at_points",
    "compare",
    "evaluate",
    "some_point",
    "unknown",
]


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundNode:
    """A node whose names are resolved; ``text`` is the criterion it stands for."""

    text: str = ""

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return ()

    @cached_property
    def streams(self) -> frozenset[str]:
        """Streams that are needed beyond the path."""
        own = frozenset(self.own_streams())
        return own.union(*(child.streams for child in self.children))

    def own_streams(self) -> tuple[str, ...]:
        """Streams of its own: "position", "normal", "color", "weight", "triangle", "descriptors",
        or the name of an optional column."""
        return ()

    def on_rays(self, context: Context) -> Pair:
        """Truth for every ray; `evaluate` remembers it."""
        raise Unfinished(self, "on_rays")

    def never(self, map: Any) -> str | None:
        """Why no ray of an open map can satisfy it, where that needs no ray to be looked at."""
        return None

    def wider(self) -> tuple[BoundNode, str] | None:
        """A condition that demands less, and what is said where its rays are not enough.

        The text stands behind the number of rays that satisfy the wider one.
        """
        return None


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundPoint(BoundNode):
    """A point condition; of a ray it asks for some point."""

    def on_points(self, context: Context) -> Pair:
        """Truth for every point; `at_points` remembers it."""
        raise Unfinished(self, "on_points")

    def on_rays(self, context: Context) -> Pair:
        return some_point(context, self)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundCrossing(BoundNode):
    """Speaks of crossings of segments and detectors; of a ray it asks for some crossing."""

    def on_crossings(self, context: Context) -> Pair:
        """Truth for every crossing."""
        raise Unfinished(self, "on_crossings")

    def on_rays(self, context: Context) -> Pair:
        return apply(self.on_crossings(context), context.crossings.any)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundCompare(BoundNode):
    """A number of the ray compared with ``value``, in the unit of the map."""

    operator: str
    value: float

    def samples(self, context: RayContext) -> tuple[NDArray[Any], NDArray[Any]]:
        """Rays of the context (n,) and the number of each, several of a ray where it has several.

        NaN where the number is undefined.
        """
        raise Unfinished(self, "samples")

    def undefined(self, map: Any) -> str:
        """Why it is undefined for some rays of a map; empty where that needs no words."""
        return ""


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundValue(BoundCompare):
    """A number that is computed from streams: unknown on paths, exact on rays."""

    def own_streams(self) -> tuple[str, ...]:
        # Without any nobody would look at rays, and the unknown answer of paths would be the last
        raise Unfinished(self, "own_streams")

    def values(self, context: RayContext) -> NDArray[Any]:
        """(n_rays,) the number of each ray; NaN where it is undefined."""
        raise Unfinished(self, "values")

    def samples(self, context: RayContext) -> tuple[NDArray[Any], NDArray[Any]]:
        return np.arange(context.n_rays), self.values(context)

    def on_rays(self, context: Context) -> Pair:
        if not isinstance(context, RayContext):
            return unknown(context)
        return exactly(compare(self.operator, self.values(context), self.value))


def evaluate(context: Context, node: BoundNode) -> Pair:
    """Truth of a criterion for every ray of the context."""
    known = context.ray_results.get(node)
    if known is None:
        if isinstance(context, RayContext) and not node.streams:
            # The path decides: no need to look at the ray
            known = gather(evaluate(context.base, node), context.path)
        else:
            known = node.on_rays(context)
        context.ray_results[node] = known
    return known


def at_points(context: Context, node: BoundNode) -> Pair:
    """Truth of a point condition at every point of the context."""
    known = context.point_results.get(node)
    if known is None:
        if isinstance(context, RayContext) and not node.streams:
            known = gather(at_points(context.base, node), context.rows)
        else:
            assert isinstance(node, BoundPoint)
            known = node.on_points(context)
        context.point_results[node] = known
    return known


def some_point(context: Context, node: BoundNode) -> Pair:
    """A point condition asked of a ray: at some point."""
    return apply(at_points(context, node), context.points.any)


def unknown(context: Context) -> Pair:
    """Possible for every ray, certain for none."""
    return Pair(np.zeros(context.n_rays, np.bool_), np.ones(context.n_rays, np.bool_))


def compare(operator: str, values: NDArray[Any], value: float) -> Bools:
    """Compare numbers; a comparison with something undefined is false, also ``!=``."""
    result: Bools = COMPARISONS[operator](values, value)
    if values.dtype.kind == "f":
        result = result & ~np.isnan(values)
    return result
