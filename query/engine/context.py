"""What criteria are evaluated on: rays as runs of points, from path dictionaries or portions.

A `PathContext` holds one entry per different path: columns that paths do not have are unknown
there. A `RayContext` holds chosen rays of one portion exactly: what their path decides is taken
from the path, and only the streams that are touched are read.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from query.engine.kleene import Bools, Pair
from query.engine.measures import RayRecords
from query.engine.scans import Runs
from raymap.encoding.paths import PathDictionary
from raymap.model.directory import ChannelSet
from raymap.model.errors import FormatError
from raymap.model.events import Event
from raymap.model.portion import Descriptors
from raymap.model.rows import offsets_of
from raymap.optics.photometry import ray_weights

__all__ = [
    "Cancelled",
    "Context",
    "PathColumns",
    "PathContext",
    "RayContext",
    "StoredRays",
]
Ints = NDArray[np.integer]


class Cancelled(Exception):
    """The search was cancelled; what was found so far stays valid."""


class StoredRays(Protocol):
    """What a portion must offer (a `StoredPortion` does)."""

    @property
    def n_rays(self) -> int: ...
    @property
    def n_records(self) -> int: ...
    @property
    def channel_set(self) -> int: ...
    @property
    def has_weights(self) -> bool: ...
    @property
    def map(self) -> Any: ...
    def paths(self) -> PathDictionary: ...
    def path_numbers(self) -> NDArray[np.uint32]: ...
    def descriptors(self) -> Descriptors: ...
    @property
    def column_names(self) -> tuple[str, ...]: ...
    def column(self, name: str) -> NDArray[Any]: ...
    def color_table(self) -> NDArray[np.uint16]: ...
    def normals_at(
        self, records: Ints, faces: Ints, position: NDArray[np.float32]
    ) -> NDArray[np.int16]: ...


class PathColumns(NamedTuple):
    """Itineraries as compiled code takes them; columns that it does not need may be empty.

    Attributes
    ----------
    source : (n_rays,)
    offsets : (n_rays + 1,) points of ray r are rows offsets[r]:offsets[r + 1]
    object, face, event : (n_points,)
    crossing_offsets : (n_points + 1,) crossings of the segment that starts at each point
    detector, registered : (n_crossings,)
    """

    source: Ints
    offsets: Ints
    object: Ints
    face: Ints
    event: Ints
    crossing_offsets: Ints
    detector: Ints
    registered: Bools


class Context(ABC):
    """Columns of rays and their points; None where a column is unknown."""

    n_rays: int

    def __init__(self) -> None:
        # By bound node (`query.engine.bound`), which stands above the columns it is asked on
        self.point_results: dict[Any, Pair] = {}
        self.ray_results: dict[Any, Pair] = {}

    # The path's own columns; points of ray r are rows offsets[r]:offsets[r + 1].

    @property
    @abstractmethod
    def source(self) -> Ints: ...
    @property
    @abstractmethod
    def offsets(self) -> Ints: ...
    @property
    @abstractmethod
    def object(self) -> Ints: ...
    @property
    @abstractmethod
    def face(self) -> Ints: ...
    @property
    @abstractmethod
    def event(self) -> Ints: ...
    @property
    @abstractmethod
    def medium(self) -> Ints: ...
    @property
    @abstractmethod
    def crossing_offsets(self) -> Ints: ...
    @property
    @abstractmethod
    def detector(self) -> Ints: ...
    @property
    @abstractmethod
    def registered(self) -> Bools: ...

    def columns(
        self, *, face: bool = True, event: bool = True, crossings: bool = True
    ) -> PathColumns:
        """The path's own columns, without those that are not wanted.

        Raises
        ------
        FormatError
            Columns are not as long as the rays.
        """
        n, found = self.n_points, self.crossings_of_points if crossings else None
        columns = PathColumns(
            source=self.source,
            offsets=self.points.offsets,
            object=self.object,
            face=self.face if face else np.empty(0, np.int32),
            event=self.event if event else np.empty(0, np.int32),
            crossing_offsets=np.empty(0, np.int64) if found is None else found.offsets,
            detector=np.empty(0, np.int16) if found is None else self.detector,
            registered=np.empty(0, np.bool_) if found is None else self.registered,
        )
        lengths: list[tuple[NDArray[Any], int]] = [
            (columns.source, self.n_rays),
            (columns.object, n),
            (columns.face, n * face),
            (columns.event, n * event),
        ]
        if found is not None:
            lengths += [(columns.detector, found.n_rows), (columns.registered, found.n_rows)]
            lengths.append((columns.crossing_offsets, n + 1))
        if any(len(column) != wanted for column, wanted in lengths):
            raise FormatError("columns of paths are not as long as the paths")
        return columns

    # The same in the form that compiled loops take

    @cached_property
    def points(self) -> Runs:
        """Points of each ray."""
        return Runs.check(self.offsets)

    @cached_property
    def crossings(self) -> Runs:
        """Crossings of each ray."""
        return Runs.check(self.ray_crossing_offsets)

    @cached_property
    def crossings_of_points(self) -> Runs:
        """Crossings of the segment that starts at each point."""
        return Runs.check(self.crossing_offsets)

    @property
    def n_points(self) -> int:
        return int(self.offsets[-1])

    @cached_property
    def last_rows(self) -> Ints:
        """(n_rays,) row of the last point of each ray."""
        return self.offsets[1:] - 1

    @cached_property
    def lengths(self) -> Ints:
        """(n_rays,) number of points of each ray."""
        return np.diff(self.offsets)

    @cached_property
    def left(self) -> Bools:
        """(n_rays,) the ray left the scene."""
        left: Bools = (self.event[self.last_rows] & int(Event.LEFT_SCENE)) != 0
        return left

    @cached_property
    def ray_crossing_offsets(self) -> Ints:
        """(n_rays + 1,) crossings of each ray."""
        return self.crossing_offsets[self.offsets]

    # Streams beyond the path: unknown unless a subclass reads them.

    @property
    def triangle(self) -> Ints | None:
        return None

    @property
    def uv(self) -> NDArray[np.uint16] | None:
        return None


class PathContext(Context):
    """Different paths as if each were one ray."""

    def __init__(self, paths: PathDictionary) -> None:
        super().__init__()
        self.paths = paths
        self.n_rays = paths.n_paths

    @property
    def source(self) -> Ints:
        return self.paths.source

    @property
    def offsets(self) -> Ints:
        return self.paths.offsets

    @property
    def object(self) -> Ints:
        return self.paths.object

    @property
    def face(self) -> Ints:
        return self.paths.face

    @property
    def event(self) -> Ints:
        return self.paths.event

    @property
    def medium(self) -> Ints:
        return self.paths.medium

    @property
    def crossing_offsets(self) -> Ints:
        return self.paths.detector_offsets

    @property
    def detector(self) -> Ints:
        return self.paths.detector

    @property
    def registered(self) -> Bools:
        return self.paths.registered

    @cached_property
    def crossings_of_path(self) -> Ints:
        """(n_paths,) number of crossings."""
        return np.diff(self.ray_crossing_offsets)


class RayContext(Context):
    """Chosen rays of one portion, exactly.

    Parameters
    ----------
    portion : where the rays are stored
    base : the paths that ``path_of_ray`` numbers
    path_of_ray : (portion's rays,) path of each ray in ``base``
    rays : increasing indices of the chosen rays in the portion, None for all
    check : called before each stream is read; raises `Cancelled` when the search was cancelled
    """

    def __init__(
        self,
        portion: StoredRays,
        base: PathContext,
        path_of_ray: Ints,
        rays: Ints | None,
        channel_sets: Sequence[ChannelSet],
        check: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__()
        self.portion, self.base, self.rays, self.check = portion, base, rays, check
        self.all_paths = path_of_ray
        self.path = path_of_ray if rays is None else path_of_ray[rays]
        self.n_rays = len(self.path)
        self.channel_sets = channel_sets

    @cached_property
    def offsets(self) -> Ints:
        return self.points.offsets

    @cached_property
    def points(self) -> Runs:
        return self.base.points.take(self.path)

    @cached_property
    def rows(self) -> Ints:
        """(n_points,) rows of the base that the points of the rays are."""
        return self.points.rows(self.base.offsets[:-1][self.path])

    @cached_property
    def starts(self) -> Ints:
        """(n_rays,) first record of each ray in the portion."""
        begins = offsets_of(self.base.lengths[self.all_paths])[:-1]
        return begins if self.rays is None else begins[self.rays]

    @cached_property
    def ends(self) -> Ints:
        """(n_rays,) last record of each ray in the portion."""
        return self.starts + self.lengths - 1

    @cached_property
    def records(self) -> Ints:
        """(n_points,) records of the portion that the points are."""
        return self.points.rows(self.starts)

    @cached_property
    def lengths(self) -> Ints:
        return self.base.lengths[self.path]

    @cached_property
    def left(self) -> Bools:
        return self.base.left[self.path]

    @cached_property
    def source(self) -> Ints:
        return self.base.source[self.path]

    @cached_property
    def object(self) -> Ints:
        return self.base.object[self.rows]

    @cached_property
    def face(self) -> Ints:
        return self.base.face[self.rows]

    @cached_property
    def event(self) -> Ints:
        return self.base.event[self.rows]

    @cached_property
    def medium(self) -> Ints:
        return self.base.medium[self.rows]

    @cached_property
    def ray_crossing_offsets(self) -> Ints:
        return offsets_of(self.base.crossings_of_path[self.path])

    @cached_property
    def crossing_offsets(self) -> Ints:
        return offsets_of(np.diff(self.base.crossing_offsets)[self.rows])

    @cached_property
    def _base_crossings(self) -> Ints:
        starts = self.base.ray_crossing_offsets[:-1][self.path]
        return self.crossings.rows(starts)

    @cached_property
    def detector(self) -> Ints:
        return self.base.detector[self._base_crossings]

    @cached_property
    def registered(self) -> Bools:
        return self.base.registered[self._base_crossings]

    @cached_property
    def descriptor_rows(self) -> Ints | None:
        """(n_crossings,) rows among the portion's descriptors; None for all of them."""
        if self.rays is None:
            return None
        begins = offsets_of(self.base.crossings_of_path[self.all_paths])[:-1]
        return self.crossings.rows(begins[self.rays])

    @cached_property
    def triangle(self) -> Ints:
        self.check()
        column = self.portion.column("triangle")
        return column if self.rays is None else column[self.records]

    @cached_property
    def uv(self) -> NDArray[np.uint16]:
        self.check()
        uv = self.portion.column("uv")
        return uv if self.descriptor_rows is None else uv[self.descriptor_rows]

    @cached_property
    def position(self) -> NDArray[np.float32]:
        """(records of the portion, 3), to be used with `starts`."""
        self.check()
        return self.portion.column("position")

    @cached_property
    def recorded(self) -> RayRecords:
        """The rays' records and their positions, in the form that compiled loops take."""
        return RayRecords.check(self.position, self.starts, self.points, self.left)

    def normals_at(self, records: Ints, faces: Ints) -> NDArray[np.int16]:
        """(n, 3) normals of records of the portion, whose faces are known."""
        self.check()
        return self.portion.normals_at(records, faces, self.position)

    @cached_property
    def carried(self) -> NDArray[np.float64]:
        """(n_rays,) weight × worth of each ray at its end."""
        self.check()
        rays = np.arange(self.n_rays) if self.rays is None else self.rays
        found = ray_weights(self.portion, rays)
        return np.ones(self.n_rays) if found is None else found

    def optional(self, name: str, width: int) -> NDArray[Any] | None:
        """A column of numbers, (records of the portion, ...), that polarised traces store.

        None where the portion has none, or another's column of that name and another shape.
        """
        if name not in self.portion.column_names:
            return None
        self.check()
        column = self.portion.column(name)
        fits = column.dtype.kind == "f" and column.ndim == (1 if width == 1 else 2)
        fits = fits and len(column) == self.portion.n_records
        return column if fits and (width == 1 or column.shape[1] == width) else None

    @cached_property
    def channel_set(self) -> ChannelSet:
        return self.channel_sets[self.portion.channel_set]

    @cached_property
    def channels(self) -> Bools:
        """(n_colors, n_channels), which channels carry light in each colour code."""
        own = np.eye(self.channel_set.n_channels, dtype=np.bool_)
        return np.concatenate((own, self.portion.color_table() > 0))

    @cached_property
    def last_color(self) -> Ints:
        """(n_rays,) colour code of each ray's last record."""
        self.check()
        column = self.portion.column("last_color")
        return column if self.rays is None else column[self.rays]

    @cached_property
    def wavelength(self) -> NDArray[np.float64]:
        """(n_rays,) [nm], NaN while several channels carry light."""
        wavelengths = np.array(self.channel_set.wavelengths_nm)
        single = self.channels.sum(axis=1) == 1
        of_color = np.where(single, wavelengths[np.argmax(self.channels, axis=1)], np.nan)
        return of_color[self.last_color]
