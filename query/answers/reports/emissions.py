"""Which emissions a map holds, and what that says of the errors of two maps together.

Random numbers are drawn from a stream keyed by (seed, number of the emission). So two maps share
their random numbers where seed and emission are the same, even if their scenes differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from raymap.model.errors import DamagedPortion

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["Emissions", "Relation", "emissions_of", "relation", "seeds_by_portion"]

Kind = Literal["paired", "independent", "overlapping", "unknown"]
Span = tuple[int, int]


@dataclass(frozen=True)
class Emissions:
    """The emissions of a map.

    Attributes
    ----------
    spans : by seed the first and last number of emissions that follow each other, in order
    whole : by seed, whether all emissions in the spans are stored, so that there are no others
    emitted : by source
    portions : what each portion says of its emissions; equal for copies of one map
    """

    spans: dict[int | None, list[Span]]
    whole: dict[int | None, bool]
    emitted: tuple[int, ...]
    portions: tuple[Any, ...]


@dataclass(frozen=True)
class Relation:
    """How the emissions of two maps stand to each other.

    Attributes
    ----------
    kind : "paired", the same emissions; "independent", none in common; "overlapping", some (may)
        be in common; "unknown", as a seed is not known
    sentence : for people, with what it means for errors
    """

    kind: Kind
    sentence: str


def seeds_by_portion(map: RayMap) -> list[int | None]:
    """Seed of the run of each portion; None where the map does not tell."""
    seeds: list[int | None] = []
    for portion in map.portions:
        seed = None
        for run in portion.map.runs:
            first = run.get("first_portion")
            if (first if isinstance(first, int) else 0) <= portion.number:
                stated = run.get("seed")
                known = isinstance(stated, int) and not isinstance(stated, bool)
                seed = stated if known else None
        seeds.append(seed)
    return seeds


def emissions_of(map: RayMap) -> Emissions:
    """What the portions of a map say of its emissions."""
    spans: dict[int | None, list[Span]] = {}
    whole: dict[int | None, bool] = {}
    said = []
    for portion, seed in zip(map.portions, seeds_by_portion(map), strict=True):
        emitted = tuple(int(n) for n in portion.emitted)
        if not portion.n_rays and not any(emitted):
            continue
        span, complete = _span(portion, sum(emitted))
        said.append((seed, span, portion.n_rays, emitted))
        whole[seed] = whole.get(seed, True) and complete
        own = spans.setdefault(seed, [])
        if own and own[-1][1] + 1 == span[0]:
            own[-1] = own[-1][0], span[1]
        elif span[1] >= span[0]:
            own.append(span)
    return Emissions(spans, whole, tuple(int(n) for n in map.emitted), tuple(said))


def _span(portion: Any, emitted: int) -> tuple[Span, bool]:
    """First and last emission of a portion, and whether it stores them all."""
    span = int(portion.first_ray), int(portion.last_ray)
    if not portion.grouped:
        return span, span[1] - span[0] + 1 == portion.n_rays == emitted
    try:
        numbers = portion.column("emission")
    except DamagedPortion:
        return span, False
    ends = int(numbers.min()), int(numbers.max())
    rises = bool((numbers[1:] >= numbers[:-1]).all())
    # Emissions may be numbered with gaps for the rays into which each may split
    return ends, rises and len(np.unique(numbers)) == emitted


def relation(first: Emissions, second: Emissions) -> Relation:
    """How the emissions of two maps stand to each other."""
    seeds = first.spans.keys() | second.spans.keys()
    shared = first.spans.keys() & second.spans.keys()
    if None in seeds:
        return Relation(
            "unknown",
            "the seeds are not known, so the maps may share random numbers: errors are added, "
            "which is the most that they can be",
        )
    if not shared:
        return Relation(
            "independent",
            "the seeds differ, so the maps are independent: errors add in quadrature",
        )
    words = _seeds([seed for seed in shared if seed is not None])
    whole = all(side.whole[seed] for side in (first, second) for seed in shared)
    same = first.portions == second.portions or (whole and first.spans == second.spans)
    if same and first.emitted == second.emitted:
        return Relation(
            "paired",
            f"both maps hold the same emissions ({words}): errors are those of the differences, "
            "emission by emission",
        )
    if whole and not any(_overlap(first.spans[seed], second.spans[seed]) for seed in shared):
        return Relation(
            "independent",
            f"both maps are of {words}, but share no ray number, so they are independent: "
            "errors add in quadrature",
        )
    return Relation(
        "overlapping",
        f"both maps hold rays of {words}, but not the same ones, so they are not independent: "
        "errors are added, which is the most that they can be",
    )


def _overlap(some: list[Span], others: list[Span]) -> bool:
    return any(a[0] <= b[1] and b[0] <= a[1] for a in some for b in others)


def _seeds(seeds: list[int]) -> str:
    listed = ", ".join(str(seed) for seed in sorted(seeds)[:4])
    return f"seed{'s' if len(seeds) > 1 else ''} {listed}{' …' if len(seeds) > 4 else ''}"
