"""Bound criteria: names resolved to tables over indices, units to the map's units.

A bound node says which streams it needs beyond the path (`streams`); an empty set means that the
path alone decides it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from query.engine.path_machine import PathMachine
from query.expression.names import ObjectMatch

__all__ = [
    "BoundAll",
    "BoundBounces",
    "BoundCount",
    "BoundDetected",
    "BoundEverything",
    "BoundFlux",
    "BoundHit",
    "BoundIncidence",
    "BoundLast",
    "BoundLength",
    "BoundLogic",
    "BoundMedium",
    "BoundNode",
    "BoundPath",
    "BoundRecorded",
    "BoundRegion",
    "BoundSource",
    "BoundThen",
    "BoundWavelength",
    "EventMasks",
]

Bools = NDArray[np.bool_]

EventMasks = tuple[tuple[int, ...], ...]
"""Alternatives of events; in each, every mask must have a bit set at the point."""


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
        return ()


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundEverything(BoundNode):
    """Every ray: what no criterion at all asks for."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundSource(BoundNode):
    """``table`` : (n_sources,) bool."""

    table: Bools


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundHit(BoundNode):
    """Point condition on object, face, primitive and events.

    Attributes
    ----------
    any_place : no condition on object and face (`event`), not even that there is one
    places : alternatives; without triangles they are merged into one
    events : alternatives of events; empty: whatever happened
    """

    any_place: bool = False
    places: tuple[ObjectMatch, ...] = ()
    events: EventMasks = ()

    def own_streams(self) -> tuple[str, ...]:
        return ("triangle",) if any(place.triangle >= 0 for place in self.places) else ()


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundLogic(BoundNode):
    """``operator`` not, and, or, xor over points or rays, wherever it stands."""

    operator: str
    args: tuple[BoundNode, ...]
    is_point: bool

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return self.args


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundAll(BoundNode):
    """Point conditions at one point; without any, every point."""

    args: tuple[BoundNode, ...]

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return self.args


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundRegion:
    """A region of one detector in cells: ``rect`` half-open, ``ellipse`` closed."""

    shape: str
    numbers: tuple[float, float, float, float]
    cells: tuple[int, int]


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundDetected(BoundNode):
    """``table`` : (n_detectors + 1,) bool; ``regions`` per detector index, empty: anywhere."""

    table: Bools
    registered: bool
    regions: dict[int, tuple[BoundRegion, ...]]

    def own_streams(self) -> tuple[str, ...]:
        return ("descriptors",) if self.regions else ()


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundMedium(BoundNode):
    """``table`` : (n_media + 1,) bool."""

    table: Bools


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundLast(BoundNode):
    point: BoundNode

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return (self.point,)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundThen(BoundNode):
    args: tuple[BoundNode, ...]

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return self.args


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundPath(BoundNode):
    machine: PathMachine

    def own_streams(self) -> tuple[str, ...]:
        return ("triangle",) if self.machine.needs_triangles else ()


@dataclass(frozen=True, eq=False, kw_only=True)
class _BoundCompare(BoundNode):
    operator: str
    value: float


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundCount(_BoundCompare):
    point: BoundNode

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return (self.point,)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundBounces(_BoundCompare):
    pass


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundFlux(_BoundCompare):
    """The flux of a ray at its end.

    ``per_weight`` : (n_sources,) flux of a ray of weight 1; ``weighted``: weights are stored;
    ``worth_by_color``: it depends on the colour, too.
    """

    per_weight: NDArray[np.float64]
    weighted: bool
    worth_by_color: bool

    def own_streams(self) -> tuple[str, ...]:
        return ("weight",) * self.weighted + ("color",) * self.worth_by_color


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundWavelength(_BoundCompare):
    """``possible``: some channel of the map satisfies it."""

    possible: bool

    def own_streams(self) -> tuple[str, ...]:
        return ("color",) if self.possible else ()


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundLength(_BoundCompare):
    """``optical`` weighs each segment with the refractive index of its medium."""

    optical: bool

    def own_streams(self) -> tuple[str, ...]:
        return ("position", "color") if self.optical else ("position",)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundIncidence(_BoundCompare):
    point: BoundNode

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return (self.point,)

    def own_streams(self) -> tuple[str, ...]:
        return ("position", "normal")


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundRecorded(_BoundCompare):
    """A quantity from the optional ``column`` of the map.

    Attributes
    ----------
    word : which quantity; ``point`` : where, None for the end of the ray
    stored : some portion has the column
    """

    word: str
    column: str
    stored: bool
    point: BoundNode | None = None

    @property
    def children(self) -> tuple[BoundNode, ...]:
        return () if self.point is None else (self.point,)

    def own_streams(self) -> tuple[str, ...]:
        return (self.column,) if self.stored else ()
