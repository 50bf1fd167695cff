"""Kinds of sources by the word that the scene file uses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from raymap.model.registry import Registry
from tracer.sources.source import Source

__all__ = ["SOURCES"]


def _words(kind: type[Source]) -> Sequence[str]:
    return [str(word) for word in get_args(kind.model_fields["kind"].annotation)]


SOURCES: Registry[type[Source]] = Registry(
    "tracer.sources", "tracer.sources", words=_words, of=Source, sort="kinds of sources"
)
