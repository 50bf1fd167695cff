"""Addresses of the compiled functions of kinds of surfaces, for the tables of the engine."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from raymap.jit.compiling import Door, Task, address_of
from raymap.jit.types import I64
from tracer.compiled import MIRROR, S_EVALUATE, S_KIND, S_MEET, S_PDF, S_SAMPLE, S_TOWARDS
from tracer.surfaces.interaction import MEET, TOWARDS
from tracer.surfaces.law import EVALUATE, PDF, SAMPLE, meet_by_law, towards_by_law
from tracer.surfaces.registry import SURFACES
from tracer.surfaces.surface import Surface

__all__ = ["link_surfaces", "number_of", "surface_tasks"]

_FIRST_OF_OTHERS = 1 << 20


def number_of(kind: type[Surface]) -> int:
    """Number of a kind, which does not depend on what else is installed."""
    if kind.number >= 0:
        return kind.number
    word = str(kind.model_fields["kind"].default)
    return _FIRST_OF_OTHERS + zlib.crc32(word.encode())


class _Link(NamedTuple):
    """A column of ``surface_i`` for a function of a kind."""

    kind: int
    column: int
    task: Task


def surface_tasks(surface_i: I64, *, towards: bool = False) -> list[Task]:
    """What is to be compiled for the kinds of a scene that are called by address."""
    return [link.task for link in _links(surface_i, towards=towards)]


def link_surfaces(surface_i: I64, *, towards: bool = False) -> None:
    """Fill in the addresses that rays (with ``towards``: pinholes, too) need of a scene's kinds."""
    for link in _links(surface_i, towards=towards):
        surface_i[surface_i[:, S_KIND] == link.kind, link.column] = address_of(link.task)


def _links(surface_i: I64, *, towards: bool) -> Iterator[_Link]:
    """What kinds are called for; the plain ones and mirrors are part of their callers."""
    present = {int(number) for number in np.unique(surface_i[:, S_KIND])}
    plain = {"absorber", "dielectric", "lambertian", "mirror"}
    if max(present, default=0) <= MIRROR:
        return
    for word in SURFACES:
        kind = SURFACES[word] if word not in plain else None
        if kind is None or number_of(kind) not in present:
            continue
        number = number_of(kind)

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
