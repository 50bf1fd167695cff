"""A recorded map with detectors that were not there: a map that every reader of maps takes.

Rays and all that happened to them stay; crossings of the new detectors are computed where
segments cross them (`raymap.passes.crossings`). So paths are told apart by the new detectors, too.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.decoding import decodes
from raymap.encoding.paths import MergedPaths, PathDictionary
from raymap.file.reader import RayMap
from raymap.file.stored import StoredPortion
from raymap.file.views import MapView, PortionView
from raymap.model.errors import RayMapError
from raymap.model.events import Event
from raymap.model.portion import Descriptors
from raymap.model.rows import offsets_of, rows_of_rays
from raymap.model.schema import COLOR_SCALE, NONE
from raymap.passes.crossings import Place, Segments
from raymap.passes.pathsums import sums_of_paths

__all__ = ["PlacedMap", "PlacedPortion"]

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_OWN = {"descriptor_count", "first_descriptor", "cell", "uv", "event"}
"""Columns that new crossings change."""


class _Met(NamedTuple):
    """New crossings of a portion in the order of the records, and the paths that they make.

    Attributes
    ----------
    record, detector, registered, cell, uv, cosine : (n,) of the crossings
    numbers : (n_rays,) new path of each ray
    base : (n_paths,) recorded path that each new one refines
    first : (n_paths,) a ray of each
    """

    record: I64
    detector: NDArray[np.int16]
    registered: NDArray[np.bool_]
    cell: NDArray[np.uint16]
    uv: NDArray[np.uint16]
    cosine: NDArray[np.int16]
    numbers: I64
    base: I64
    first: I64


class PlacedPortion(PortionView):
    """A portion whose rays meet more detectors."""

    def __init__(self, own: StoredPortion, map: PlacedMap) -> None:
        super().__init__(own, map)
        self._placed = map
        # Rays are told apart by paths even where the recording has none
        self.has_paths = True
        self._lock = threading.RLock()
        self._known: _Met | None = None
        self._paths: PathDictionary | None = None

    # -- crossings ------------------------------------------------------------------------------

    def _met(self) -> _Met:
        with self._lock:
            known = self._known
            if known is None:
                known = self._known = self._find()
                self._placed.recent.remember(self)
            return known

    def _find(self) -> _Met:
        parts = []
        first = len(self._placed.base.directory.detectors)
        segments = Segments(self.own)
        for number, place in enumerate(self._placed.places):
            found = segments.cross(place)
            cell, uv = found.stored(place.detector.cells)
            detector = np.full(len(found.record), first + number, np.int16)
            registered = place.registers(found.cosine)
            parts.append(
                (found.record, found.reach, detector, registered, cell, uv, found.stored_cosine())
            )
        columns = [np.concatenate(each) for each in zip(*parts, strict=True)]
        order = np.lexsort((columns[1], columns[0]))
        record, _, detector, registered, cell, uv, cosine = (each[order] for each in columns)
        numbers, base, first_ray = self._new_paths(record, detector, registered)
        return _Met(record, detector, registered, cell, uv, cosine, numbers, base, first_ray)

    def _new_paths(
        self, record: I64, detector: NDArray[np.int16], registered: NDArray[np.bool_]
    ) -> tuple[I64, I64, I64]:
        """Paths told apart by where on them the new crossings are: see `_Met`."""
        offsets = self.own.record_offsets()
        ray = np.searchsorted(offsets, record, side="right") - 1
        kinds = 2 * (len(self._placed.directory.detectors) + 1)
        code = (record - offsets[ray]) * kinds + detector.astype(np.int64) * 2 + registered
        labels = self.own.path_numbers().astype(np.int64)
        starts = offsets_of(np.bincount(ray, minlength=len(labels)))
        # Crossing after crossing, so that equal labels are equal paths
        rays = np.flatnonzero(np.diff(starts))
        step = 0
        while len(rays):
            pairs = np.stack((labels[rays], code[starts[rays] + step]), axis=1)
            _, own = np.unique(pairs, axis=0, return_inverse=True)
            labels[rays] = int(labels.max()) + 1 + own.ravel()
            step += 1
            rays = rays[np.diff(starts)[rays] > step]
        _, first, numbers = np.unique(labels, return_index=True, return_inverse=True)
        base = self.own.path_numbers().astype(np.int64)[first]
        return numbers.ravel().astype(np.int64), base, first.astype(np.int64)

    def forget(self) -> None:
        """Give back what was computed."""
        self._known = self._paths = None

    # -- paths ---------------------------------------------------------------------------------

    @decodes
    def paths(self) -> PathDictionary:
        """The dictionary, refined by the new crossings."""
        met = self._met()
        with self._lock:
            paths = self._paths
            if paths is None:
                paths = self._paths = self._refined(met)
            return paths

    def _refined(self, met: _Met) -> PathDictionary:
        own = self.own.paths()
        rows = rows_of_rays(own.offsets, met.base)
        lengths = np.diff(own.offsets)[met.base]
        offsets = offsets_of(lengths)
        before = np.diff(own.detector_offsets)[rows]
        # The crossings of a ray of each path, by its points
        records = self.own.record_offsets()
        ray = np.searchsorted(records, met.record, side="right") - 1
        of_ray = offsets_of(np.bincount(ray, minlength=self.n_rays))
        chosen = rows_of_rays(of_ray, met.first)
        path = np.repeat(np.arange(len(met.first)), np.diff(of_ray)[met.first])
        point = offsets[path] + met.record[chosen] - records[ray[chosen]]
        more = np.bincount(point, minlength=len(rows))
        detector_offsets, old, new = _places(before, more)
        detector = np.empty(int(detector_offsets[-1]), np.int16)
        registered = np.empty(len(detector), np.bool_)
        kept = rows_of_rays(own.detector_offsets, rows)
        detector[old], detector[new] = own.detector[kept], met.detector[chosen]
        registered[old], registered[new] = own.registered[kept], met.registered[chosen]
        event = own.event[rows].copy()
        _mark(event, point, met.registered[chosen])
        light = self._placed.photometry(self.channel_set)
        ends = self.own.color_codes(self.own.column("last_color")).colors() / COLOR_SCALE
        weight = self.own.column("weight").astype(np.float64)
        n = len(met.base)
        sums = sums_of_paths(met.numbers, n, weight, ends, self.own, light)
        sets = [np.zeros((n, 0)) for _ in self._placed.channel_sets]
        sets[self.channel_set] = sums.colors
        worth_squares = sums.worth_squares
        if worth_squares is None and light.unit == "lm":
            worth_squares = sums.squares
        return PathDictionary(
            source=own.source[met.base],
            offsets=offsets,
            object=own.object[rows],
            face=own.face[rows],
            event=event,
            medium=own.medium[rows],
            detector_offsets=detector_offsets,
            detector=detector,
            registered=registered,
            rays=np.bincount(met.numbers, minlength=n),
            sum_w=sums.weight,
            sum_w2=sums.squares,
            sum_wc=tuple(sets),
            sum_wy2=worth_squares,
            grouped=self.grouped,
        )

    @decodes
    def path_numbers(self) -> NDArray[np.uint32]:
        """(n_rays,) row of `paths` that each ray took."""
        return self._met().numbers.astype(np.uint32)

    def check_rows(self, numbers: NDArray[np.uint32]) -> None:
        """The recording's paths account for its records; new ones are made of them."""
        self.own.check_rows(self.own.path_numbers())

    def compare(self, merged: PathDictionary, local: Any) -> None:
        """Nothing: there is no dictionary of the whole map."""

    # -- columns -------------------------------------------------------------------------------

    @property
    def n_descriptors(self) -> int:
        """Recorded and new crossings."""
        return self.own.n_descriptors + len(self._met().record)

    def _crossed(self) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
        met = self.descriptors()
        return met.detector, met.registered

    @decodes
    def _decoded(self, name: str) -> NDArray[Any] | None:
        if name not in _OWN:
            return self.own._decoded(name)
        if name == "event":
            event: NDArray[np.int32] = self.own.column("event").copy()
            met = self._met()
            _mark(event, met.record, met.registered)
            return event
        if name == "descriptor_count":
            return np.diff(self._descriptor_offsets()).astype(np.uint16)
        if name == "first_descriptor":
            offsets = self._descriptor_offsets()
            return np.where(np.diff(offsets) > 0, offsets[:-1], NONE).astype(np.int32)
        column: NDArray[Any] = getattr(self.descriptors(), name)
        return column

    def _descriptor_offsets(self) -> I64:
        return self._descriptor_places()[0]

    def _descriptor_places(self) -> tuple[I64, I64, I64]:
        """Offsets by record, where the recorded descriptors stand, and where the new ones do."""
        before = self.own.column("descriptor_count").astype(np.int64)
        record = self._met().record
        more = np.bincount(record, minlength=self.n_records)
        return _places(before, more)

    @decodes
    def descriptors(self, position: NDArray[np.float32] | None = None) -> Descriptors:
        """Recorded and new crossings, in record order."""
        met = self._met()
        own = self.own.descriptors(position)
        offsets, old, new = self._descriptor_places()
        n = int(offsets[-1])

        def joined(mine: NDArray[Any], more: NDArray[Any]) -> Any:
            both = np.empty((n, *mine.shape[1:]), mine.dtype)
            both[old], both[new] = mine, more
            return both

        return Descriptors(
            detector=joined(own.detector, met.detector),
            cell=joined(own.cell, met.cell),
            cosine=joined(own.cosine, met.cosine),
            uv=joined(own.uv, met.uv),
            registered=joined(own.registered, met.registered),
        )


def _places(before: I64, more: I64) -> tuple[I64, I64, I64]:
    """Offsets of runs of old and then new items, and where the items of each kind stand.

    Parameters
    ----------
    before, more : (n,) old and new items of each run
    """
    counts = before + more
    offsets = offsets_of(counts)
    places = np.arange(int(offsets[-1]))
    is_old = places - np.repeat(offsets[:-1], counts) < np.repeat(before, counts)
    return offsets, places[is_old], places[~is_old]


def _mark(event: NDArray[np.int32], rows: I64, registered: NDArray[np.bool_]) -> None:
    """Set the bits of crossings of detectors at the points that their segments start at."""
    event[rows] |= int(Event.DETECTOR_CROSSED)
    event[rows[registered]] |= int(Event.DETECTOR_REGISTERED)


class PlacedMap(MapView):
    """A map with more detectors; the map that it looks at stays open and unchanged.

    Parameters
    ----------
    base : an open map of rays, or a view of one
    places : the new detectors, whose names the map does not have

    Raises
    ------
    RayMapError
        The map holds no rays, or has such a detector.
    """

    def __init__(self, base: RayMap, places: Sequence[Place]) -> None:
        base.need_rays()
        super().__init__(base)
        self.places = tuple(places)
        entries = tuple(place.detector for place in places)
        names = [entry.name for entry in (*base.directory.detectors, *entries)]
        if len(set(names)) < len(names):
            raise RayMapError(f"a detector of the map is already called {entries[-1].name!r}")
        detectors = (*base.directory.detectors, *entries)
        self.directory = base.directory.model_copy(update={"detectors": detectors})
        self.bounds = replace(base.bounds, detector=len(detectors))
        self.portions = [PlacedPortion(portion, self) for portion in base.portions]

    def over(self, base: RayMap) -> PlacedMap:
        """The same detectors in another map."""
        return PlacedMap(base, self.places)

    @property
    def merged(self) -> MergedPaths | None:
        """None: paths are told apart portion by portion."""
        return None

    def detector_result(self, name: str, channel_set: int = 0) -> Any:
        """What a recorded detector counted; None of a new one, which rays tell."""
        if any(place.detector.name == name for place in self.places):
            return None
        return self.base.detector_result(name, channel_set)
