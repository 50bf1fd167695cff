"""Views of a map: another map that every reader of maps takes, made of one that stays as it is.

A view says what it changes; all else is asked of what it looks at.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.decoding import decodes
from raymap.encoding.colors import ColorCodes
from raymap.encoding.paths import MergedPaths, PathDictionary
from raymap.file.reader import Damage, RayMap
from raymap.file.stored import StoredPortion
from raymap.model.directory import DisplayMesh
from raymap.model.portion import Descriptors

__all__ = ["MapView", "PortionView", "Recent", "Unseen"]

F64 = NDArray[np.float64]


class Unseen(NamedTuple):
    """A branch that the recording's law never drew: what would take it, as a bound.

    ``by_source`` : unnormalised Σ w c of the light that arrives there times the new share
    """

    face: int
    branch: int
    by_source: F64


class _Forgetful(Protocol):
    def forget(self) -> None: ...


class Recent:
    """What was computed of the portions last looked at: of a large map all would fill the memory.

    Parameters
    ----------
    kept : portions
    """

    def __init__(self, kept: int = 16) -> None:
        self._kept, self._known = kept, deque[_Forgetful]()
        self._lock = threading.Lock()

    def remember(self, portion: _Forgetful) -> None:
        """Keep what was computed of a portion, and give back that of the oldest one."""
        with self._lock:
            self._known.append(portion)
            oldest = self._known.popleft() if len(self._known) > self._kept else None
        if oldest is not None and oldest is not portion:
            oldest.forget()


class PortionView(StoredPortion):
    """A portion that is another one but for what a view changes.

    Parameters
    ----------
    own : what it looks at
    map : the view that it is part of
    """

    def __init__(self, own: StoredPortion, map: RayMap) -> None:
        super().__init__(map, own.index)
        self.own = own
        self.channel_set, self.has_weights = own.channel_set, own.has_weights
        self.has_paths = own.has_paths
        self.first_ray, self.last_ray, self.emitted = own.first_ray, own.last_ray, own.emitted

    @property
    def n_records(self) -> int:
        """As of what it looks at."""
        return self.own.n_records

    @property
    def n_descriptors(self) -> int:
        """As of what it looks at."""
        return self.own.n_descriptors

    @property
    def column_names(self) -> tuple[str, ...]:
        """As of what it looks at."""
        return self.own.column_names

    @decodes
    def paths(self) -> PathDictionary:
        """As of what it looks at."""
        return self.own.paths()

    @decodes
    def path_numbers(self) -> NDArray[np.uint32]:
        """As of what it looks at."""
        return self.own.path_numbers()

    @decodes
    def record_offsets(self) -> NDArray[np.int64]:
        """As of what it looks at."""
        return self.own.record_offsets()

    def check_rows(self, numbers: NDArray[np.uint32]) -> None:
        """As of what it looks at."""
        self.own.check_rows(numbers)

    def compare(self, merged: PathDictionary, local: Any) -> None:
        """As of what it looks at."""
        self.own.compare(merged, local)

    @decodes
    def _decoded(self, name: str) -> NDArray[Any] | None:
        return self.own._decoded(name)

    @decodes
    def descriptors(self, position: NDArray[np.float32] | None = None) -> Descriptors:
        """As of what it looks at."""
        return self.own.descriptors(position)

    def ray_ids(self) -> NDArray[np.int64]:
        """As of what it looks at."""
        return self.own.ray_ids()

    def index_of(self, ray_id: int) -> int:
        """As of what it looks at."""
        return self.own.index_of(ray_id)

    def color_table(self) -> NDArray[np.uint16]:
        """As of what it looks at."""
        return self.own.color_table()

    def color_codes(self, codes: NDArray[np.int32]) -> ColorCodes:
        """As of what it looks at."""
        return self.own.color_codes(codes)

    def carried(self, rays: Any, records: Any, *, whole: bool) -> tuple[F64, F64]:
        """As of what it looks at."""
        return self.own.carried(rays, records, whole=whole)

    def normals_at(
        self, records: Any, faces: Any, position: NDArray[np.float32]
    ) -> NDArray[np.int16]:
        """As of what it looks at."""
        return self.own.normals_at(records, faces, position)

    def _normals(self, position: NDArray[np.float32] | None) -> NDArray[np.int16]:
        return self.own._normals(position)

    def _crossed(self) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
        return self.own._crossed()


class MapView(RayMap):
    """A map that is another one but for what it changes; that one stays open and unchanged.

    Parameters
    ----------
    base : an open map, or a view of one
    portion : the view of a portion

    Attributes
    ----------
    threads : for passes over the whole map; 0: as many as there are cores
    """

    def __init__(
        self, base: RayMap, portion: Callable[[StoredPortion], StoredPortion] | None = None
    ) -> None:
        # It is the open map itself, but for what is set here
        self.__dict__.update(base.__dict__)
        for known in ("_photometry", "detectors", "shapes"):
            self.__dict__.pop(known, None)
        self.base = base
        self.threads = 0
        self.recent = Recent()
        if portion is not None:
            self.portions = [portion(each) for each in base.portions]

    @property
    def merged(self) -> MergedPaths | None:
        """As of what it looks at."""
        return self.base.merged

    @property
    def damage(self) -> list[Damage]:
        """As of what it looks at."""
        return self.base.damage

    @property
    def verified(self) -> bool:
        """As of what it looks at."""
        return self.base.verified

    @property
    def bytes_read(self) -> int:
        """As of what it looks at."""
        return self.base.bytes_read

    @property
    def meshes(self) -> Mapping[int, DisplayMesh]:
        """As of what it looks at."""
        return self.base.meshes

    @property
    def identities(self) -> list[tuple[int, int]]:
        """As of what it looks at."""
        return self.base.identities

    def path_factors(self) -> F64 | None:
        """(n_merged_paths,) by what all rays of each path count more; None where rays differ."""
        return None

    def changed(self, channel_set: int) -> Any:
        """`raymap.passes.reweighting.ChangedLaws` of what it looks at; None of no changes."""
        return self.base.changed(channel_set) if isinstance(self.base, MapView) else None

    @property
    def impossible(self) -> int:
        """Events met so far that the recorded laws do not allow: rounding put them there."""
        return self.base.impossible if isinstance(self.base, MapView) else 0

    @property
    def vague(self) -> int:
        """Scatterings met so far whose law changed and whose direction is not known well enough."""
        return self.base.vague if isinstance(self.base, MapView) else 0

    def unseen(self) -> list[Unseen]:
        """What new laws open that the old ones never drew (`raymap.passes.revised`)."""
        return self.base.unseen() if isinstance(self.base, MapView) else []

    def detector_result(self, name: str, channel_set: int = 0) -> Any:
        """As of what it looks at."""
        return self.base.detector_result(name, channel_set)

    @property
    def shards(self) -> Sequence[RayMap]:
        """The maps of which it is made: itself."""
        return (self,)

    def refresh(self) -> bool:
        """A view is of the rays that were there when it was made."""
        return False

    def close(self) -> None:
        """Close what it looks at."""
        self.base.close()
