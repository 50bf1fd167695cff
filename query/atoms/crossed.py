"""``crossed("sensor")``: passed through one of the named detectors, registered or not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from query.atoms.detected import Detected, names_and_regions
from query.expression.arguments import Region

__all__ = ["KINDS", "Crossed", "crossed"]


@dataclass(frozen=True)
class Crossed(Detected):
    """Passed through one of the named detectors, registered or not."""

    word = "crossed"
    title = "passed through a detector"
    phrase = "passed through"
    place = 30
    registered: ClassVar[bool] = False


def crossed(*what: str | Region) -> Crossed:
    """Passed through one of these detectors, registered or not."""
    return Crossed(*names_and_regions(what))


KINDS = (Crossed,)
