"""Addresses of the compiled functions of kinds of detectors, for the tables of the engine."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np

from raymap.jit.compiling import Task, address_of
from raymap.jit.types import I64
from tracer.compiled import D_KIND, D_REGISTER
from tracer.detectors.detector import REGISTER, DetectorKind, ViewDetector
from tracer.detectors.registry import DETECTORS

__all__ = ["detector_number", "detector_tasks", "link_detectors"]


def detector_number(kind: type[DetectorKind]) -> int:
    """Number of a kind of another distribution, which does not depend on what is installed."""
    if not issubclass(kind, ViewDetector):
        return 0
    return _of_word(str(kind.model_fields["kind"].default))


def detector_tasks(detector_i: I64) -> list[Task]:
    """What is to be compiled for the kinds of a scene that are called by address."""
    return [task for _, task in _links(detector_i)]


def link_detectors(detector_i: I64) -> None:
    """Fill in the addresses of functions of a scene's kinds."""
    for number, task in _links(detector_i):
        detector_i[detector_i[:, D_KIND] == number, D_REGISTER] = address_of(task)


def _of_word(word: str) -> int:
    return 1 + zlib.crc32(word.encode())


def _links(detector_i: I64) -> Iterator[tuple[int, Task]]:
    present = {int(number) for number in np.unique(detector_i[:, D_KIND])}
    if not present - {0}:
        return
    # Only what the scene has is imported
    for kind in [DETECTORS[word] for word in DETECTORS if _of_word(word) in present]:
        number = detector_number(kind)
        if number in present and issubclass(kind, ViewDetector):
            yield number, REGISTER.task(kind.register)
