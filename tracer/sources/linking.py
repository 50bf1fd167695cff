"""Addresses of the compiled functions of kinds of sources, for the tables of the engine."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np

from raymap.jit.compiling import Task, address_of
from raymap.jit.types import I64
from tracer.compiled import L_EMIT, L_KIND, L_TOWARDS
from tracer.sources.registry import SOURCES
from tracer.sources.source import EMIT, EMITS_TOWARDS, Source

__all__ = ["link_sources", "source_number", "source_tasks"]


def source_number(kind: type[Source]) -> int:
    """Number of a kind with a law of its own, which does not depend on what else is installed."""
    if kind.law is None:
        return 0
    return _of_word(str(kind.model_fields["kind"].default))


def source_tasks(source_i: I64, *, towards: bool = False) -> list[Task]:
    """What is to be compiled for the kinds of a scene that are called by address."""
    return [task for _, _, task in _links(source_i, towards=towards)]


def link_sources(source_i: I64, *, towards: bool = False) -> None:
    """Fill in the addresses that rays (with ``towards``: pinholes, too) need of a scene's kinds."""
    for number, column, task in _links(source_i, towards=towards):
        source_i[source_i[:, L_KIND] == number, column] = address_of(task)


def _of_word(word: str) -> int:
    return 1 + zlib.crc32(word.encode())


def _links(source_i: I64, *, towards: bool) -> Iterator[tuple[int, int, Task]]:
    present = {int(number) for number in np.unique(source_i[:, L_KIND])}
    if not present - {0}:
        return
    # Only what the scene has is imported
    for kind in [SOURCES[word] for word in SOURCES if _of_word(word) in present]:
        number = source_number(kind)
        if kind.law is None or number not in present:
            continue
        yield number, L_EMIT, EMIT.task(kind.law.emit)
        if towards and kind.law.towards is not None:
            yield number, L_TOWARDS, EMITS_TOWARDS.task(kind.law.towards)
