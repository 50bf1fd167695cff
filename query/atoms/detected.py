"""``detected("sensor", rect(0, 0, 10, 10))``: registered by one of the named detectors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from query.engine.bind import Binder
from query.engine.bound import BoundCrossing, BoundNode
from query.engine.context import Context
from query.engine.kleene import Bools, Pair, exactly
from query.engine.regions import BoundRegion, bind_region
from query.engine.scans import look_up
from query.expression.arguments import Names, Region, Regions
from query.expression.atom import Condition
from query.expression.words import canonical_names
from raymap.model.errors import CriterionError

__all__ = ["KINDS", "Detected", "detected", "ellipse", "names_and_regions", "rect"]


@dataclass(frozen=True)
class Detected(Condition):
    """Registered by one of the named detectors, inside one of the regions if any are given.

    Attributes
    ----------
    registered : it must also have registered the light, not only been passed
    """

    names: tuple[str, ...]
    regions: tuple[Region, ...] = ()

    word = "detected"
    title = "registered by a detector"
    phrase = "detected by"
    arguments = (
        Names(of="detector", help="names of detectors"),
        Regions(help="parts of the detector, any of which"),
    )
    place = 20
    registered: ClassVar[bool] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", canonical_names(self.names, self.word))

    @property
    def is_crossing(self) -> bool:
        return True

    def bind(self, binder: Binder, text: str) -> BoundNode:
        detectors = binder.directory.detectors
        table = binder.table(self.names, [detector.name for detector in detectors], "detector")
        regions = {}
        if self.regions:
            for index in np.flatnonzero(table).tolist():
                regions[index] = tuple(
                    bind_region(region, detectors[index], binder.directory.length_unit)
                    for region in self.regions
                )
        return BoundDetected(text=text, table=table, registered=self.registered, regions=regions)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundDetected(BoundCrossing):
    """``table`` : (n_detectors + 1,) bool; ``regions`` per detector index, empty: anywhere."""

    table: Bools
    registered: bool
    regions: dict[int, tuple[BoundRegion, ...]]

    def own_streams(self) -> tuple[str, ...]:
        return ("descriptors",) if self.regions else ()

    def on_crossings(self, context: Context) -> Pair:
        met = look_up(self.table, context.detector)
        if self.registered:
            met &= context.registered
        if not self.regions:
            return exactly(met)
        uv = context.uv
        if uv is None:
            return Pair(np.zeros_like(met), met)
        inside = np.zeros_like(met)
        for detector, regions in self.regions.items():
            chosen = np.flatnonzero(met & (context.detector == detector))
            place = uv[chosen].astype(np.float64)
            here = np.zeros(len(chosen), np.bool_)
            for region in regions:
                here |= region.holds(place)
            inside[chosen] = here
        return exactly(inside)

    def never(self, map: Any) -> str | None:
        regions = [region for regions in self.regions.values() for region in regions]
        if not regions or not all(region.is_outside for region in regions):
            return None
        width, height = regions[0].cells
        name = map.directory.detectors[next(iter(self.regions))].name
        return f"{self.text}: the region lies outside the {width} x {height} cells of {name}"

    def wider(self) -> tuple[BoundNode, str] | None:
        if not self.regions:
            return None
        anywhere = BoundDetected(table=self.table, registered=self.registered, regions={})
        return anywhere, "reach the detector, none inside the region"


def rect(x0: float, y0: float, x1: float, y1: float, unit: str = "") -> Region:
    """Part of a detector, half-open; in cells, or from the centre with ``unit="mm"``."""
    return Region("rect", (x0, y0, x1, y1), unit)


def ellipse(cx: float, cy: float, rx: float, ry: float, unit: str = "") -> Region:
    """Part of a detector, closed; in cells, or from the centre with ``unit="mm"``."""
    return Region("ellipse", (cx, cy, rx, ry), unit)


def names_and_regions(
    what: tuple[str | Region, ...],
) -> tuple[tuple[str, ...], tuple[Region, ...]]:
    """Names and regions, mixed, apart."""
    names = tuple(item for item in what if isinstance(item, str))
    regions = tuple(item for item in what if isinstance(item, Region))
    if len(names) + len(regions) != len(what):
        raise CriterionError("detected and crossed take names and regions")
    return names, regions


def detected(*what: str | Region) -> Detected:
    """Registered by one of these detectors: ``detected("sensor", rect(0, 0, 10, 10))``."""
    return Detected(*names_and_regions(what))


KINDS = (Detected,)
