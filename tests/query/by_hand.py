"""Sums over single rays, as the oracle selects them."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import Any

import query
from tests.naive.interpreter import Interpreter
from tests.naive.rays import Ray, rays_of


def flux_of(map: Any, rays: list[Ray]) -> float:
    sources = map.directory.sources
    return sum(sources[ray.source].flux / map.emitted[ray.source] * ray.weight for ray in rays)


def flux_se_of(map: Any, rays: list[Ray]) -> float:
    """sqrt of Σ over sources of (Φ/N)² [Σ over emissions of (Σw)² - (Σw)²/N]."""
    variance = 0.0
    for number, source in enumerate(map.directory.sources):
        brought: dict[Any, float] = defaultdict(float)
        for ray in rays:
            if ray.source == number:
                brought[ray.emission] += ray.weight
        if brought:
            emitted = float(map.emitted[number])
            squares = sum(w**2 for w in brought.values()) - sum(brought.values()) ** 2 / emitted
            variance += (source.flux / emitted) ** 2 * squares
    return math.sqrt(variance)


def matching(map: Any, criterion: str) -> list[Ray]:
    oracle, tree = Interpreter(map), query.parse(criterion)
    return [ray for ray in rays_of(map) if oracle.ray(tree, ray)]
