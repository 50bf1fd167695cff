"""Kinds of surfaces by the word that the scene file uses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from raymap.model.registry import Registry
from tracer.surfaces.surface import Surface

__all__ = ["SURFACES"]


def _words(kind: type[Surface]) -> Sequence[str]:
    return [str(word) for word in get_args(kind.model_fields["kind"].annotation)]


SURFACES: Registry[type[Surface]] = Registry(
    "tracer.surfaces", "tracer.surfaces", words=_words, of=Surface, sort="kinds of surfaces"
)
