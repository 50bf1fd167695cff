"""Kinds of detectors by the word that the scene file uses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from raymap.model.registry import Registry
from tracer.detectors.detector import DetectorKind

__all__ = ["DETECTORS"]


def _words(kind: type[DetectorKind]) -> Sequence[str]:
    return [str(word) for word in get_args(kind.model_fields["kind"].annotation)]


DETECTORS: Registry[type[DetectorKind]] = Registry(
    "tracer.detectors", "tracer.detectors", words=_words, of=DetectorKind, sort="kinds of detectors"
)
