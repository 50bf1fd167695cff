"""Operators on a map: not, and, or, xor of points or of rays, order along the ray, every ray."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from query.engine.bound import BoundCrossing, BoundNode, BoundPoint, at_points, evaluate
from query.engine.context import Context
from query.engine.kleene import Bools, Pair, combine, exactly
from query.engine.scans import match_sequence

__all__ = ["BoundEverything", "BoundLogic", "BoundThen"]


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundEverything(BoundNode):
    """Every ray: what no criterion at all asks for."""

    def on_rays(self, context: Context) -> Pair:
        return exactly(np.ones(context.n_rays, np.bool_))


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundLogic(BoundPoint):
    """``operator`` not, and, or, xor over points or rays, wherever it stands."""

    operator: str
    args: tuple[BoundNode, ...]
    is_point: bool

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return self.args

    def on_rays(self, context: Context) -> Pair:
        return combine(self.operator, [evaluate(context, arg) for arg in self.args])

    def on_points(self, context: Context) -> Pair:
        return combine(self.operator, [at_points(context, arg) for arg in self.args])


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundThen(BoundNode):
    """One after the other; monotone in its marks, so each side of the pair is one run."""

    args: tuple[BoundNode, ...]

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return self.args

    def on_rays(self, context: Context) -> Pair:
        is_detector = [isinstance(arg, BoundCrossing) for arg in self.args]
        pairs = [
            arg.on_crossings(context) if isinstance(arg, BoundCrossing) else at_points(context, arg)
            for arg in self.args
        ]
        crossings = context.crossings_of_points if any(is_detector) else None

        def run(masks: list[Bools]) -> Bools:
            return match_sequence(
                context.points, crossings, list(zip(is_detector, masks, strict=True))
            )

        certain = run([pair.certain for pair in pairs])
        if all(pair.exact for pair in pairs):
            return exactly(certain)
        return Pair(certain, run([pair.possible for pair in pairs]))
