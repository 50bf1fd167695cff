"""Kinds of bodies by the word that the scene file uses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

from raymap.model.registry import Registry
from tracer.bodies.body import Body

__all__ = ["BODIES"]


def _words(kind: type[Body]) -> Sequence[str]:
    return [str(word) for word in get_args(kind.model_fields["kind"].annotation)]


BODIES: Registry[type[Body]] = Registry(
    "tracer.bodies", "tracer.bodies", words=_words, of=Body, sort="kinds of bodies"
)
