"""Addresses of the compiled functions of kinds of surfaces, for the tables of the engine."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from raymap.jit.compiling import Door, Task, address_of
from raymap.jit.types import I64
from tracer.compiled import (
    MIRROR,
    S_DRAW,
    S_EVALUATE,
    S_KIND,
    S_MEET,
    S_PDF,
    S_SAMPLE,
    S_TOWARDS,
    S_WEIGH,
)
from tracer.surfaces.interaction import DRAW, MEET, TOWARDS, WEIGH
from tracer.surfaces.law import (
    EVALUATE,
    PDF,
    SAMPLE,
    draw_by_law,
    meet_by_law,
    towards_by_law,
    weigh_by_law,
)
from tracer.surfaces.registry import SURFACES
from tracer.surfaces.surface import Surface

__all__ = ["link_surfaces", "number_of", "surface_tasks"]

_FIRST_OF_OTHERS = 1 << 20


def number_of(kind: type[Surface]) -> int:
    """Number of a kind, which does not depend on what else is installed."""
    if kind.number >= 0:
        return kind.number
    return _of_word(str(kind.model_fields["kind"].default))


def _of_word(word: str) -> int:
    """Number of a kind that is not built in."""
    return _FIRST_OF_OTHERS + zlib.crc32(word.encode())


class _Link(NamedTuple):
    """A column of ``surface_i`` for a function of a kind."""

    kind: int
    column: int
    task: Task


def surface_tasks(surface_i: I64, *, weighed: bool = False) -> list[Task]:
    """What is to be compiled for the kinds of a scene that are called by address."""
    return [link.task for link in _links(surface_i, towards=False, weighed=weighed)]


def link_surfaces(surface_i: I64, *, towards: bool = False, weighed: bool = False) -> None:
    """Fill in the addresses that rays need of a scene's kinds.

    ``towards``: pinholes ask them, too. ``weighed``: rays carry weights.
    """
    for link in _links(surface_i, towards=towards, weighed=weighed):
        surface_i[surface_i[:, S_KIND] == link.kind, link.column] = address_of(link.task)


def _links(surface_i: I64, *, towards: bool, weighed: bool) -> Iterator[_Link]:
    """What kinds are called for; the plain ones and mirrors are part of their callers."""
    present = {int(number) for number in np.unique(surface_i[:, S_KIND])}
    if max(present, default=0) <= MIRROR:
        return
    # Of other distributions only what the scene has is imported
    kinds = [entry.kind for entry in SURFACES.entries(ours=True)]
    kinds += [SURFACES[word] for word in SURFACES if _of_word(word) in present]
    for kind in kinds:
        number = number_of(kind)
        if number not in present or number <= MIRROR:
            continue

        def link(column: int, door: Door, function: object, number: int = number) -> _Link:
            return _Link(number, column, door.task(function))

        law = kind.law
        if law is not None:
            yield link(S_SAMPLE, SAMPLE, law.sample)
            yield link(S_EVALUATE, EVALUATE, law.evaluate)
            yield link(S_PDF, PDF, law.pdf)
        yield link(S_MEET, MEET, meet_by_law if law is not None else kind.meet)
        last = towards_by_law if law is not None else kind.towards
        if towards and last is not None:
            yield link(S_TOWARDS, TOWARDS, last)
        draw = draw_by_law if law is not None else kind.draw
        if weighed and draw is not None:
            yield link(S_DRAW, DRAW, draw)
            yield link(S_WEIGH, WEIGH, weigh_by_law if law is not None else kind.weigh)
