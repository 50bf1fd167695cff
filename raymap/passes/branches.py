"""What happened to light at faces, as the laws of surfaces tell it apart.

A *branch* is one of the ways that light can go on from a face, or end there. Its probability is a
share of the law of the face's surface (`raymap.laws`), or a density of directions where the light
is scattered.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from raymap.encoding.paths import PathDictionary
from raymap.model.errors import DamagedPortion
from raymap.model.events import Event
from raymap.model.schema import NONE

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = [
    "ABSORBED",
    "BACK",
    "BRANCHES",
    "SCATTERED_BACK",
    "SCATTERED_THROUGH",
    "THROUGH",
    "TOTAL",
    "Partners",
    "branch_of_events",
    "media_before",
    "partners_of",
]

Ints = NDArray[np.integer[Any]]

BACK, TOTAL, THROUGH, ABSORBED, SCATTERED_BACK, SCATTERED_THROUGH = range(6)
BRANCHES = (
    "reflected", "totally reflected", "refracted", "absorbed", "scattered back",
    "scattered through",
)  # fmt: skip
"""Names of the branches, by number."""

_THROUGH_SCATTERED = Event.DIFFUSE_TRANSMISSION | Event.GLOSSY_TRANSMISSION
_BITS = (
    (SCATTERED_THROUGH, _THROUGH_SCATTERED),
    (SCATTERED_BACK, Event.DIFFUSE_REFLECTION | Event.GLOSSY_REFLECTION),
    (ABSORBED, Event.SURFACE_ABSORPTION),
    (THROUGH, Event.SPECULAR_REFRACTION),
    (TOTAL, Event.TIR),
    (BACK, Event.SPECULAR_REFLECTION),
)


def branch_of_events(events: Ints) -> NDArray[np.int8]:
    """Branch of each point's events, -1 where none was chosen (a depth limit, a crossing)."""
    found = np.full(len(events), NONE, np.int8)
    for branch, bits in _BITS:
        found[(events & int(bits)) != 0] = branch
    return found


def media_before(paths: PathDictionary) -> NDArray[np.int16]:
    """(n_points,) medium in which light arrives at each point; -1 at the first of a path."""
    before = np.empty(len(paths.medium), np.int16)
    before[1:] = paths.medium[:-1]
    before[paths.offsets[:-1]] = NONE
    return before


class Partners:
    """Which medium lies beyond a face for light that arrives in another, as refractions show it.

    Nested media and touching bodies cannot be told from a face alone; light that goes through says
    what lies beyond.
    """

    def __init__(self) -> None:
        self._beyond: dict[tuple[int, int], set[int]] = {}

    def learn(self, paths: PathDictionary) -> None:
        """Take in what the paths of a map or portion show."""
        crossed = int(Event.SPECULAR_REFRACTION | _THROUGH_SCATTERED)
        points = np.flatnonzero(((paths.event & crossed) != 0) & (paths.face >= 0))
        before = media_before(paths)[points]
        keys = np.stack([paths.face[points], before, paths.medium[points]], axis=1)
        for face, a, b in np.unique(keys.astype(np.int64), axis=0).tolist():
            # What lies beyond from one side is where the light comes from on the other
            self._beyond.setdefault((face, a), set()).add(b)
            self._beyond.setdefault((face, b), set()).add(a)

    def beyond(self, face: int, medium: int, others: Iterable[int] = ()) -> tuple[int, ...]:
        """Media seen beyond a face from a medium: none, one, or several where bodies overlap.

        Where no light went through the face, what all of the ``others`` (the faces of the same
        object) show that were gone through from this medium.
        """
        own = self._beyond.get((face, medium))
        if own is None:
            own = {beyond for other in others for beyond in self._beyond.get((other, medium), ())}
        return tuple(sorted(own))


def partners_of(map: RayMap) -> Partners:
    """What all paths of a map show of the media beyond its faces.

    Raises
    ------
    DamagedPortion
        unless the map was opened with ``on_damage="skip"``
    """
    partners = Partners()
    merged = map.merged
    if merged is not None:
        partners.learn(merged.paths)
    for portion in map.portions:
        if merged is None or not portion.has_paths:
            try:
                partners.learn(portion.paths())
            except DamagedPortion:
                if map.on_damage == "raise":
                    raise
    return partners
