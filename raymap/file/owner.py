"""What a portion and its owner, the map that holds it, ask of each other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.address import Address
from raymap.bytes.chunks import MapFile
from raymap.encoding.paths import PathDictionary
from raymap.encoding.pathstreams import Bounds
from raymap.file.footer import IndexEntry
from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import DamagedPortion, FormatError
from raymap.optics.photometry import Photometry

if TYPE_CHECKING:
    from raymap.encoding.colors import ColorCodes
    from raymap.encoding.detector_crossings import DetectorTable
    from raymap.encoding.shapes import ShapeTable

__all__ = ["Owner", "ReadPortion"]


class Owner(Protocol):
    """What a portion needs of the map that it is part of (a `raymap.file.reader.RayMap`)."""

    path: Path | Address
    on_damage: Literal["raise", "skip"]
    file: MapFile

    @property
    def directory(self) -> Directory: ...
    @property
    def channel_sets(self) -> list[ChannelSet]: ...
    @property
    def bounds(self) -> Bounds: ...
    @property
    def detectors(self) -> DetectorTable: ...
    @property
    def shapes(self) -> ShapeTable: ...
    @property
    def bytes(self) -> int: ...
    @property
    def runs(self) -> Any: ...
    def photometry(self, channel_set: int) -> Photometry: ...
    def report_damage(self, index: IndexEntry, reason: str) -> DamagedPortion: ...
    def drop_merged(self, reason: str) -> FormatError: ...


class ReadPortion(Protocol):
    """What comparing and plain dictionaries need of a portion (a `StoredPortion`)."""

    number: int
    n_rays: int
    channel_set: int
    grouped: bool
    index: IndexEntry

    @property
    def n_records(self) -> int: ...
    @property
    def n_descriptors(self) -> int: ...
    @property
    def map(self) -> Owner: ...
    def paths(self) -> PathDictionary: ...
    def path_numbers(self) -> NDArray[np.uint32]: ...
    def record_offsets(self) -> NDArray[np.int64]: ...
    def column(self, name: str) -> NDArray[Any]: ...
    def color_table(self) -> NDArray[np.uint16]: ...
    def color_codes(self, codes: NDArray[np.int32]) -> ColorCodes: ...
    def _crossing_offsets(self, counts: NDArray[np.uint16]) -> NDArray[np.int64]: ...
    def _crossed(self) -> tuple[NDArray[np.int16], NDArray[np.bool_]]: ...
