"""A recorded map with ideal absorbers that were not there: a map that every reader of maps takes.

Rays end where they first meet a stop (`raymap.passes.stops`); all before that remains. That is what
a trace of the scene with black stops in it would have recorded of the same rays.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.decoding import decodes
from raymap.encoding.dictionary import PathMerger
from raymap.encoding.paths import MergedPaths, PathDictionary
from raymap.encoding.pathstreams import Bounds
from raymap.file.reader import RayMap
from raymap.file.stored import StoredPortion
from raymap.file.views import MapView, PortionView
from raymap.model.directory import ChannelSet, Detector, Directory, DisplayMesh, Surface
from raymap.model.errors import RayMapError
from raymap.model.events import Event
from raymap.model.portion import Descriptors
from raymap.model.rows import offsets_of, rows_of_rays
from raymap.model.sceneobjects import Face, SceneObject, SceneObjects
from raymap.model.schema import COLOR_SCALE, NONE, NORMAL_SCALE
from raymap.passes.pathsums import sums_of_paths
from raymap.passes.stops import Stop, Stopped, StopTable

__all__ = ["StoppedMap", "StoppedPortion"]

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
_MEETS = int(Event.DETECTOR_CROSSED | Event.DETECTOR_REGISTERED)


class _Cut(NamedTuple):
    """Where the rays of a portion end, and what is left of them.

    Attributes
    ----------
    found : the rays that are stopped
    offsets : (n_rays + 1,) records of each ray
    rows : (n_records,) recorded record of each; of the point on a stop that of the segment to it
    ends, begin : (n_stopped,) records of points on stops, and of the segments to these
    crossings : (n_descriptors,) recorded crossings that remain
    counts : (n_records,) of them on the segment that starts at each record
    numbers : (n_rays,) path of each
    paths : without sums
    """

    found: Stopped
    offsets: I64
    rows: I64
    ends: I64
    begin: I64
    crossings: I64
    counts: NDArray[np.uint16]
    numbers: NDArray[np.uint32]
    paths: PathDictionary


class StoppedPortion(PortionView):
    """A portion whose rays end at stops."""

    def __init__(self, own: StoredPortion, map: StoppedMap) -> None:
        super().__init__(own, map)
        self._stopped = map
        # Rays are told apart by paths even where the recording has none
        self.has_paths = True
        self._lock = threading.RLock()
        self._known: _Cut | None = None
        self._summed: PathDictionary | None = None

    def forget(self) -> None:
        """Give back what was computed."""
        self._known = self._summed = None

    # -- where rays end ------------------------------------------------------------------------

    def _cut(self) -> _Cut:
        with self._lock:
            known = self._known
            if known is None:
                known = self._known = self._find()
                self._stopped.recent.remember(self)
            return known

    def stopped(self) -> Stopped:
        """Which rays end at stops, and where."""
        return self._cut().found

    def _find(self) -> _Cut:
        own = self.own
        offsets = own.record_offsets()
        position = own.column("position")
        left = (own.column("event")[offsets[1:] - 1] & int(Event.LEFT_SCENE)) != 0
        found = self._stopped.table.meet(position, offsets, left)
        lengths = np.diff(offsets)
        steps = found.record - offsets[found.ray]
        lengths[found.ray] = steps + 2
        new_offsets = offsets_of(lengths)
        # Records of each ray up to the stop; the point on it takes the place of the next one
        own_rows = np.arange(int(new_offsets[-1])) + np.repeat(
            offsets[:-1] - new_offsets[:-1], lengths
        )
        ends = new_offsets[found.ray + 1] - 1
        own_rows[ends] = found.record
        begin = ends - 1
        counts, crossings, kept = self._crossings_left(found, own_rows, ends, position)
        numbers, paths = self._paths_of(found, steps, kept)
        return _Cut(found, new_offsets, own_rows, ends, begin, crossings, counts, numbers, paths)

    def _crossings_left(
        self, found: Stopped, rows: I64, ends: I64, position: Any
    ) -> tuple[NDArray[np.uint16], I64, NDArray[np.uint8]]:
        """Crossings on the segments, which they are, and which of each last segment's remain."""
        own = self.own
        recorded = own.column("descriptor_count").astype(np.int64)
        starts = offsets_of(recorded)
        detector = own._crossed()[0]
        # Of the segments that are cut
        last = rows_of_rays(starts, found.record)
        owner = np.repeat(np.arange(len(found.ray)), recorded[found.record])
        stays = np.zeros(len(last), np.bool_)
        for number in np.unique(detector[last]).tolist():
            here = np.flatnonzero(detector[last] == number)
            stays[here] = (
                self._stopped.reach(number, position, found.record[owner[here]])
                <= (found.reach[owner[here]])
            )
        alive = np.ones(len(detector), np.bool_)
        alive[last[~stays]] = False
        of_record = recorded[rows].copy()
        of_record[ends] = 0
        chosen = rows_of_rays(starts, rows[of_record > 0])
        chosen = chosen[alive[chosen]]
        of_record[ends - 1] -= np.bincount(owner[~stays], minlength=len(found.ray))
        # Of each last segment which crossings remain, to tell paths apart
        most = int(recorded[found.record].max()) if len(found.ray) else 0
        flags = np.zeros((len(found.ray), most), np.uint8)
        index = np.arange(len(last)) - np.repeat(
            offsets_of(recorded[found.record])[:-1], recorded[found.record]
        )
        flags[owner, index] = 1 + stays
        return of_record.astype(np.uint16), chosen, flags

    def _paths_of(
        self, found: Stopped, steps: I64, kept: NDArray[np.uint8]
    ) -> tuple[NDArray[np.uint32], PathDictionary]:
        """Path of each ray, and the paths, whose sums are those of nobody."""
        own = self.own
        recorded = own.paths()
        numbers = own.path_numbers().astype(np.int64)
        first_object = self._stopped.first_object
        first_face = self._stopped.first_face
        keys = np.concatenate(
            (
                np.stack((numbers[found.ray], steps, found.stop), axis=1),
                kept.astype(np.int64),
            ),
            axis=1,
        )
        _, ray, label = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        going = np.ones(self.n_rays, np.bool_)
        going[found.ray] = False
        whole, of_ray = np.unique(numbers[going], return_inverse=True)
        coarse = np.empty(self.n_rays, np.int64)
        coarse[going] = of_ray.ravel()
        coarse[found.ray] = len(whole) + label.ravel()
        # One path of each label, those of rays that go on as they were
        base = np.concatenate((whole, numbers[found.ray[ray]]))
        lengths = np.diff(recorded.offsets)[base]
        lengths[len(whole) :] = steps[ray] + 2
        offsets = offsets_of(lengths)
        rows = np.arange(int(offsets[-1])) + np.repeat(
            recorded.offsets[:-1][base] - offsets[:-1], lengths
        )
        ends = offsets[1:][len(whole) :] - 1
        counts = np.diff(recorded.detector_offsets)[rows]
        counts[ends] = 0
        crossings = rows_of_rays(recorded.detector_offsets, rows[counts > 0])
        alive = np.ones(len(crossings), np.bool_)
        places = offsets_of(counts)
        last = ends - 1
        flags = kept[ray]
        alive[rows_of_rays(places, last)] = flags[flags > 0] == 2
        registered = recorded.registered[crossings] & alive
        columns: dict[str, Any] = {
            "object": recorded.object[rows], "face": recorded.face[rows],
            "event": recorded.event[rows], "medium": recorded.medium[rows],
        }  # fmt: skip
        columns["object"][ends] = first_object + found.stop[ray]
        columns["face"][ends] = first_face + found.stop[ray]
        columns["event"][ends] = int(Event.SURFACE_ABSORPTION)
        columns["medium"][ends] = columns["medium"][last]
        columns["event"][last] = _marked(
            columns["event"][last], places[last], places[last + 1], alive, registered
        )
        point = np.repeat(np.arange(len(rows)), counts)
        left = np.bincount(point, alive, len(rows)).astype(np.int64)
        zeros = np.zeros(len(base))
        merger = PathMerger()
        merged = merger.add(
            PathDictionary(
                source=recorded.source[base],
                offsets=offsets,
                **columns,
                detector_offsets=offsets_of(left),
                detector=recorded.detector[crossings][alive],
                registered=recorded.registered[crossings][alive],
                rays=np.zeros(len(base), np.int64),
                sum_w=zeros,
                sum_w2=zeros,
                sum_wc=(),
                grouped=self.grouped,
            )
        )
        return merged[coarse].astype(np.uint32), merger.dictionary()

    # -- paths ---------------------------------------------------------------------------------

    @property
    def n_records(self) -> int:
        """Of what is left of the rays."""
        return int(self._cut().offsets[-1])

    @property
    def n_descriptors(self) -> int:
        """Crossings that remain."""
        return len(self._cut().crossings)

    @decodes
    def paths(self) -> PathDictionary:
        """The paths that end where stops are."""
        cut = self._cut()
        with self._lock:
            if self._summed is None:
                self._summed = self._with_sums(cut)
            return self._summed

    def _with_sums(self, cut: _Cut) -> PathDictionary:
        light = self._stopped.photometry(self.channel_set)
        ends = self.color_codes(self._column_last_color()).colors() / COLOR_SCALE
        weight = self.own.column("weight").astype(np.float64)
        n = cut.paths.n_paths
        sums = sums_of_paths(cut.numbers, n, weight, ends, self.own, light)
        sets = [np.zeros((n, 0)) for _ in self._stopped.channel_sets]
        sets[self.channel_set] = sums.colors
        worth_squares = sums.worth_squares
        if worth_squares is None and light.unit == "lm":
            worth_squares = sums.squares
        return replace(
            cut.paths,
            rays=np.bincount(cut.numbers, minlength=n),
            sum_w=sums.weight,
            sum_w2=sums.squares,
            sum_wc=tuple(sets),
            sum_wy2=worth_squares,
            grouped=self.grouped,
        )

    @decodes
    def path_numbers(self) -> NDArray[np.uint32]:
        """(n_rays,) row of `paths` that each ray took."""
        return self._cut().numbers

    @decodes
    def record_offsets(self) -> I64:
        """(n_rays + 1,) records of what is left of each ray."""
        return self._cut().offsets

    def check_rows(self, numbers: NDArray[np.uint32]) -> None:
        """The recording's paths account for its records; new ones are made of them."""
        self.own.check_rows(self.own.path_numbers())

    def compare(self, merged: PathDictionary, local: Any) -> None:
        """Nothing: there is no dictionary of the whole map."""

    # -- columns -------------------------------------------------------------------------------

    @decodes
    def _decoded(self, name: str) -> NDArray[Any] | None:
        method = _OWN.get(name)
        if method is not None:
            return method(self)
        column = self.own._decoded(name)
        if column is None or len(column) != self.own.n_records:
            return column
        return column[self._cut().rows]

    def _at_ends(self, name: str, value: Any) -> Any:
        """A column of records with other values at the points on stops."""
        cut = self._cut()
        column = self.own.column(name)[cut.rows]
        column[cut.ends] = value
        return column

    def _column_object(self) -> Any:
        return self._at_ends("object", self._stopped.first_object + self._cut().found.stop)

    def _column_face(self) -> Any:
        return self._at_ends("face", self._stopped.first_face + self._cut().found.stop)

    def _column_triangle(self) -> Any:
        return self._at_ends("triangle", self._cut().found.primitive)

    def _column_event(self) -> Any:
        cut = self._cut()
        event = self._at_ends("event", int(Event.SURFACE_ABSORPTION))
        starts = offsets_of(cut.counts)
        alive = np.ones(len(cut.crossings), np.bool_)
        registered = self.own._crossed()[1][cut.crossings]
        at = cut.begin
        event[at] = _marked(event[at], starts[at], starts[at + 1], alive, registered)
        return event

    def _column_position(self) -> Any:
        cut = self._cut()
        own = self.own.column("position")
        record, reach = cut.found.record, cut.found.reach[:, None]
        first, second = (own[at].astype(np.float64) for at in (record, record + 1))
        position = own[cut.rows]
        position[cut.ends] = first + reach * (second - first)
        return position

    def _column_normal(self) -> Any:
        return self._at_ends("normal", np.rint(self._cut().found.normal * NORMAL_SCALE))

    def _column_optical_path(self) -> Any:
        own = self.own._decoded("optical_path")
        if own is None:
            return None
        cut = self._cut()
        record, reach = cut.found.record, cut.found.reach
        column = own[cut.rows]
        column[cut.ends] = own[record] + reach * (own[record + 1] - own[record])
        return column

    def _column_last_color(self) -> Any:
        codes = self.own.column("last_color").copy()
        found = self._cut().found
        if len(found.ray):
            codes[found.ray] = self.own.column("color_code")[found.record]
        return codes

    def _column_descriptor_count(self) -> Any:
        return self._cut().counts

    def _column_first_descriptor(self) -> Any:
        counts = self._cut().counts
        return np.where(counts > 0, offsets_of(counts)[:-1], NONE).astype(np.int32)

    def _column_cell(self) -> Any:
        return self.own.column("cell")[self._cut().crossings]

    def _column_uv(self) -> Any:
        return self.own.column("uv")[self._cut().crossings]

    @decodes
    def descriptors(self, position: NDArray[np.float32] | None = None) -> Descriptors:
        """Crossings before stops, in record order."""
        own, chosen = self.own.descriptors(), self._cut().crossings
        return Descriptors(
            detector=own.detector[chosen],
            cell=own.cell[chosen],
            cosine=own.cosine[chosen],
            uv=own.uv[chosen],
            registered=own.registered[chosen],
        )

    def _crossed(self) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
        detector, registered = self.own._crossed()
        chosen = self._cut().crossings
        return detector[chosen], registered[chosen]

    def carried(self, rays: Any, records: Any, *, whole: bool) -> tuple[F64, F64]:
        """As of the recording, where the light still is."""
        return self.own.carried(rays, self._cut().rows[records], whole=whole)

    def normals_at(
        self, records: Any, faces: Any, position: NDArray[np.float32]
    ) -> NDArray[np.int16]:
        """(n, 3) normals of some records."""
        cut = self._cut()
        on_stop = faces >= self._stopped.first_face
        if not on_stop.any():
            own = self.own.column("position")
            return self.own.normals_at(cut.rows[records], faces, own)
        column: NDArray[np.int16] = self._column_normal()[records]
        return column

    def _normals(self, position: NDArray[np.float32] | None) -> NDArray[np.int16]:
        normal: NDArray[np.int16] = self._column_normal()
        return normal


_OWN: dict[str, Callable[[StoppedPortion], NDArray[Any]]] = {
    name: getattr(StoppedPortion, f"_column_{name}")
    for name in (
        "object", "face", "triangle", "event", "position", "normal", "optical_path", "last_color",
        "descriptor_count", "first_descriptor", "cell", "uv",
    )
}  # fmt: skip
"""Columns that stops change; of all others the rows are taken that remain."""


def _marked(
    event: Any, starts: I64, ends: I64, alive: NDArray[np.bool_], registered: NDArray[np.bool_]
) -> Any:
    """Events of points with the bits of the crossings that remain on their segments.

    Parameters
    ----------
    starts, ends : (n,) crossings of each point; alive, registered : of the crossings
    """
    crossed, counted = (np.concatenate(([0], np.cumsum(each))) for each in (alive, registered))
    event = event & ~_MEETS
    event = event | np.where(crossed[ends] > crossed[starts], int(Event.DETECTOR_CROSSED), 0)
    return event | np.where(counted[ends] > counted[starts], int(Event.DETECTOR_REGISTERED), 0)


class StoppedMap(MapView):
    """A map with more stops.

    Parameters
    ----------
    base : an open map of rays
    stops : ideal absorbers, whose names no object of the map has

    Raises
    ------
    RayMapError
        The map holds no rays, has such an object, or a detector of which it is not known where
        along a segment it was met.
    """

    def __init__(self, base: RayMap, stops: tuple[Stop, ...]) -> None:
        base.need_rays()
        self.table = StopTable(stops)
        self.stops = stops
        taken = {entry.name for entry in base.directory.objects}
        for stop in stops:
            if stop.name in taken:
                raise RayMapError(f"an object of the map is already called {stop.name!r}")
            taken.add(stop.name)
        for detector in base.directory.detectors:
            _refuse_unknown(detector)
        super().__init__(base, lambda portion: StoppedPortion(portion, self))
        self.first_object = len(base.directory.objects)
        self.first_face = len(base.directory.faces)
        self.directory = _with_objects(base.directory, stops)
        self.bounds = Bounds.of(self.directory)
        self.channel_sets = [_with_law(each) for each in base.channel_sets]

    def unstopped(self) -> MapView:
        """What it looks at, by the same names: the stops are there, and no light meets them."""
        found = MapView(self.base)
        found.directory, found.bounds = self.directory, self.bounds
        found.channel_sets = self.channel_sets
        return found

    @property
    def merged(self) -> MergedPaths | None:
        """None: paths are told apart portion by portion."""
        return None

    def detector_result(self, name: str, channel_set: int = 0) -> None:
        """None: what detectors counted is counted anew."""

    @property
    def meshes(self) -> Mapping[int, DisplayMesh]:
        """Display meshes by object index, those of stops too."""
        found = dict(self.base.meshes)
        for number, stop in enumerate(self.stops):
            vertices, triangles = stop.drawn()
            found[self.first_object + number] = DisplayMesh(
                vertices=vertices.astype(np.float32),
                triangles=triangles.astype(np.int32),
                face=np.zeros(len(triangles), np.int32),
            )
        return found

    def reach(self, detector: int, position: Any, records: I64) -> F64:
        """(n,) where along segments a detector was met; beyond all where their ends are it."""
        entry = self.directory.detectors[detector]
        if entry.kind not in ("plane", "camera"):
            return np.full(len(records), np.inf)
        axis = np.cross(entry.axis_u, entry.axis_v)
        first, second = (position[at].astype(np.float64) for at in (records, records + 1))
        way = (second - first) @ axis
        height = (np.asarray(entry.center, np.float64) - first) @ axis
        far = np.full(len(records), np.inf)
        return np.asarray(np.divide(height, way, out=far, where=way != 0.0))


def _refuse_unknown(detector: Detector) -> None:
    if detector.kind == "surface" and detector.object == NONE:
        raise RayMapError(
            f"detector {detector.name!r} says of no light where along its way it was met, so that "
            "stops cannot be put before or behind it: record the scene with the stop in it"
        )


def _with_objects(directory: Directory, stops: tuple[Stop, ...]) -> Directory:
    known = {entry.name for entry in directory.surfaces}
    name = "stops"
    while name in known:
        name += "_"
    surface = len(directory.surfaces)
    objects = [
        SceneObject(
            name=stop.name,
            kind="stop",
            faces=(Face(name="face", primitive_count=stop.count, surface=surface),),
        )
        for stop in stops
    ]
    more = {
        "objects": SceneObjects((*directory.objects, *objects)),
        "surfaces": (*directory.surfaces, Surface(name=name, kind="absorber")),
    }
    found = directory.model_copy(update=more)
    for cached in ("faces", "object_columns"):
        found.__dict__.pop(cached, None)
    return found


def _with_law(channels: ChannelSet) -> ChannelSet:
    """The channel set that says of stops that they absorb all light."""
    laws = channels.laws
    if not laws or not isinstance(laws.get("surfaces"), list):
        return channels
    surfaces = [*laws["surfaces"], {"law": "absorber"}]
    return channels.model_copy(update={"laws": {**laws, "surfaces": surfaces}})
