"""Sums over single rays, as the oracle selects them."""

from __future__ import annotations

from typing import Any

import query
from tests.naive.interpreter import Interpreter
from tests.naive.rays import Ray, rays_of


def flux_of(map: Any, rays: list[Ray]) -> float:
    sources = map.directory.sources
    return sum(sources[ray.source].flux / map.emitted[ray.source] * ray.weight for ray in rays)


def matching(map: Any, criterion: str) -> list[Ray]:
    oracle, tree = Interpreter(map), query.parse(criterion)
    return [ray for ray in rays_of(map) if oracle.ray(tree, ray)]
