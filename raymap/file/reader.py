"""RayMap: an open map, read at many places at once, also while it still grows."""

from __future__ import annotations

import bisect
import os
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.address import Address, place_of
from raymap.bytes.bytesource import LocalBytes
from raymap.bytes.chunks import Chunk, Gap, MapFile
from raymap.bytes.decoding import FOREIGN
from raymap.bytes.layout import CHANNELS, DETECTOR, DIRECTORY, FILE_HEADER_SIZE, PATHS, PORTION, RUN
from raymap.encoding.description import (
    parse_channel_set,
    read_channel_set,
    read_directory,
    read_display_meshes,
    read_run,
)
from raymap.encoding.paths import MergedPaths
from raymap.encoding.pathstreams import Bounds
from raymap.encoding.portionmeta import PortionMeta
from raymap.encoding.results import read_result
from raymap.file.agreement import FalseFooter, compare_all
from raymap.file.footer import (
    Footer,
    IndexEntry,
    LostFooter,
    copied_directory,
    find_footer,
    read_footer,
    read_merged,
)
from raymap.file.stamps import is_stamped
from raymap.file.stored import StoredPortion
from raymap.model.directory import ChannelSet, DisplayMesh
from raymap.model.errors import (
    DamagedPortion,
    DamageWarning,
    FormatError,
    NoRays,
    NotARayMap,
    RayMapError,
    RayNotFound,
)
from raymap.optics.photometry import Photometry

if TYPE_CHECKING:
    from raymap.encoding.detector_crossings import DetectorTable
    from raymap.encoding.shapes import ShapeTable
    from raymap.laws.stored import Laws

__all__ = ["Damage", "RayMap"]

COMPARED_RAYS = 2**20
COMPARED_PORTIONS = 64
"""A merged dictionary of at most so many rays and portions is compared before it is served."""


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes of a map that cannot be served.

    Attributes
    ----------
    portion : number of the portion, None where it is not known
    offset, length : the bytes
    reason : what is wrong with them
    """

    portion: int | None
    offset: int
    length: int
    reason: str


NO_RAYS = "no_rays"
"""Parameter of a run that stored no rays, only what the detectors counted."""

DETECTORS = "detectors"
"""Statistic of such a run: flux and standard error of each detector, by name."""

_LARGEST_ERROR = 1e150
"""Of a flux whose square is a number."""


class RayMap:
    """An open ray map; close it or use it as a context manager.

    Attributes
    ----------
    path : of the file; an `Address` where it is behind one (``s3://…``)
    directory : names, shapes and units
    channel_sets : by index
    portions : complete portions in number order
    finished : the file ends with a footer
    runs : per run seed, parameters and, when it was finished, statistics
    on_damage : "raise" or "skip"
    torn_bytes : bytes behind the last complete chunk, of a portion that is being written or was cut
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | Address,
        *,
        on_damage: Literal["raise", "skip"] = "raise",
    ) -> None:
        self.path = place_of(path)
        self.on_damage = on_damage
        self._damage: list[Damage] = []
        self._damaged_lock = threading.Lock()
        self._merged_lock = threading.Lock()
        self._merged: MergedPaths | None = None
        self._merged_dropped = False
        self._verified: bool | None = None
        self._results: dict[tuple[int, int], list[int]] | None = None
        self._footer_chunk: Chunk | None = None
        self._footer = Footer()
        self._last_ray = -1
        self.file = MapFile(self.path)
        try:
            self._load()
        except BaseException:
            self.file.close()
            raise

    @property
    def identities(self) -> list[tuple[int, int]]:
        """Device and inode of each open file of this machine, whatever its name means by now."""
        source = self.file.bytes
        return [source.identity] if isinstance(source, LocalBytes) else []

    # -- life --------------------------------------------------------------------------------

    def __enter__(self) -> RayMap:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self.file.close()

    def refresh(self) -> bool:
        """Take in what was written since; true if there is more (or the map was finished)."""
        size = self.file.size
        if size == self.bytes:
            return False
        before = len(self.portions), self.finished
        self._load()
        return (len(self.portions), self.finished) != before

    # -- counts ------------------------------------------------------------------------------

    @property
    def rays(self) -> int:
        """Rays stored."""
        return sum(portion.n_rays for portion in self.portions)

    @property
    def without_rays(self) -> bool:
        """The trace stored no rays, only what the detectors counted."""
        return not self.rays and any(
            (run.get("parameters") or {}).get(NO_RAYS) for run in self.runs
        )

    def need_rays(self) -> None:
        """Refuse what speaks about rays.

        Raises
        ------
        NoRays
        """
        if self.without_rays:
            raise NoRays(
                f"{self.path} holds no rays, only what its detectors counted (it was recorded "
                "with --no-rays): raymap info, image and chart read it"
            )

    @property
    def records(self) -> int:
        """Segment records stored."""
        return sum(portion.n_records for portion in self.portions)

    @property
    def emitted(self) -> NDArray[np.int64]:
        """(n_sources,) rays emitted in the portions served."""
        total = np.zeros(len(self.directory.sources), np.int64)
        for portion in self.portions:
            total += portion.emitted
        return total

    @property
    def damage(self) -> list[Damage]:
        """What was found damaged so far."""
        return self._damage

    @property
    def shards(self) -> Sequence[RayMap]:
        """The maps of which it is made: itself."""
        return (self,)

    @property
    def own_channel_sets(self) -> list[ChannelSet]:
        """Channel sets as this file numbers them."""
        return self._own_channel_sets

    @property
    def footer_chunk(self) -> Chunk | None:
        """The footer that ends the file."""
        return self._footer_chunk

    @property
    def other_chunks(self) -> list[tuple[int, bytes]]:
        """(offset, tag) of the chunks that are no portions."""
        return list(self._footer.chunks)

    @property
    def chunk_sizes(self) -> dict[int, tuple[int, int]]:
        """(size, head size) of those chunks by offset, as far as they are known."""
        return dict(self._footer.sizes)

    @property
    def bytes_read(self) -> int:
        """Bytes fetched from the file so far."""
        return self.file.bytes_read

    def laws(self, channel_set: int = 0) -> Laws | None:
        """What surfaces and media do to light of a channel set; None if the map does not say.

        Raises
        ------
        FormatError
            What it says is not sound.
        """
        from raymap.laws.stored import laws_of

        return laws_of(self.directory, self.channel_sets[channel_set])

    @cached_property
    def shapes(self) -> ShapeTable:
        """Shapes of the faces, compiled for the decoding of geometry."""
        from raymap.encoding.shapes import compile_shapes

        return compile_shapes(self.directory)

    @cached_property
    def detectors(self) -> DetectorTable:
        """Detectors, compiled for the decoding of descriptors."""
        from raymap.encoding.detector_crossings import compile_detectors

        return compile_detectors(self.directory)

    @cached_property
    def meshes(self) -> Mapping[int, DisplayMesh]:
        """Display meshes by object index, decoded when asked for."""
        return read_display_meshes(
            self.file, self._directory_chunk(self.bytes), len(self.directory.objects)
        )

    @property
    def verified(self) -> bool:
        """Whether `raymap.verify` has passed this very file on this machine, and nothing since
        has contradicted it. Without that, counts that come from the footer are its word alone.
        """
        if self._verified is None:
            self._verified = isinstance(self.path, Path) and is_stamped(self.path)
        return self._verified and not self.damage

    # -- rays --------------------------------------------------------------------------------

    @property
    def merged(self) -> MergedPaths | None:
        """The path dictionary of the whole map, None without a sound footer.

        That of a small map is compared with all portions before it is served, that of a large one
        portion by portion as these are read (`StoredPortion.compare`).
        """
        chunk = self._footer_chunk
        if chunk is None or not self._footer.has_merged:
            return None
        with self._merged_lock:
            if self._merged is None and not self._merged_dropped:
                try:
                    merged = read_merged(
                        self.file, self._merged_chunk(), self._footer, self.bounds, self._channels
                    )
                    if self.rays <= COMPARED_RAYS and len(self.portions) <= COMPARED_PORTIONS:
                        compare_all(merged, self.portions)
                    self._merged = merged
                except (FormatError, *FOREIGN) as error:
                    self._drop_merged(str(error))
            return self._merged

    def drop_merged(self, reason: str) -> FalseFooter:
        """Serve no merged dictionary any more, as it contradicts the portions; the error to raise.

        Nothing is lost: what the dictionary said is asked of the portions.
        """
        with self._merged_lock:
            self._drop_merged(f"merged dictionary: {reason}")
        return FalseFooter(f"{self.path}: {reason}")

    def _drop_merged(self, reason: str) -> None:
        self._merged, self._merged_dropped = None, True
        chunk = self._footer_chunk
        assert chunk is not None
        self._warn_of_footer(Damage(None, chunk.offset, chunk.header.size, reason))

    def _warn_of_footer(self, damage: Damage) -> None:
        """Remember a footer that cannot be used, and say so where nobody asks for the damage."""
        if not self.note_damage(damage) or self.on_damage == "skip":
            return
        warnings.warn(
            f"{self.path}: the footer cannot be used ({damage.reason}); the portions are read "
            "instead, nothing is lost",
            DamageWarning,
            stacklevel=3,
        )

    @cached_property
    def _photometry(self) -> dict[int, tuple[ChannelSet, Photometry]]:
        return {}

    @property
    def lights(self) -> list[Photometry]:
        """`photometry` of each channel set."""
        return [self.photometry(number) for number in range(len(self.channel_sets))]

    def photometry(self, channel_set: int) -> Photometry:
        """What light in the channels of a set is worth, in watt, lumen and colour.

        Raises
        ------
        RayMapError
            Nothing was recorded yet, so that the map has no channels.
        """
        if not self.channel_sets:
            raise RayMapError(f"{self.path} has no channels: nothing was recorded in it yet")
        chosen = self.channel_sets[channel_set]
        known = self._photometry.get(channel_set)
        if known is None or known[0] is not chosen:
            known = chosen, Photometry(self.directory, chosen)
            self._photometry[channel_set] = known
        return known[1]

    def _merged_chunk(self) -> Chunk:
        """The chunk that holds the merged dictionary."""
        assert self._footer_chunk is not None
        offset = self._footer.merged_offset
        if offset is None:
            return self._footer_chunk
        chunk = self._chunk_of(offset)
        if chunk.tag != PATHS:
            raise FormatError("another chunk lies in the place of the merged dictionary")
        return chunk

    def _chunk_of(self, offset: int) -> Chunk:
        """A chunk that the footer lists."""
        return self.file.chunk_at(offset, self.bytes, self._footer.sizes.get(offset, (0, 0))[1])

    def find_ray(self, ray_id: int) -> tuple[int, int]:
        """(index of the portion, index of the ray in it).

        Raises
        ------
        RayNotFound, NoRays
        """
        self.need_rays()
        index = bisect.bisect_left(self.portions, ray_id, key=lambda portion: portion.last_ray)
        while index < len(self.portions):
            portion = self.portions[index]
            if portion.n_rays:
                if portion.first_ray > ray_id:
                    break
                return index, portion.index_of(ray_id)
            index += 1
        raise RayNotFound(f"{self.path} has no ray {ray_id} (it holds {self.rays} rays)")

    def detector_error(self, name: str) -> float | None:
        """Standard error of all flux of a detector [flux unit] of a map without rays.

        Its cells do not tell it: light that misses one of them meets another. None where the map
        does not say it.
        """
        if len(self.runs) != 1:
            return None
        said: Any = self.runs[0].get("statistics")
        for key in (DETECTORS, name, "flux_se"):
            said = said.get(key) if isinstance(said, dict) else None
        if isinstance(said, bool) or not isinstance(said, int | float):
            return None
        return float(said) if 0.0 <= said <= _LARGEST_ERROR else None

    def detector_result(
        self, name: str, channel_set: int = 0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """What a detector counted over all rays: (Σ w·c, Σ (w·c)²), unnormalised.

        Returns
        -------
        sums, sums2 : (cells_v, cells_u, n_channels), or None where results do not cover every
            portion of the channel set (an interrupted trace); the descriptors say it too
        """
        wanted = self._detector_numbers.get(name)
        if wanted is None:
            raise ValueError(f"the map has no detector {name!r}")
        sums = sums2 = None
        covered: set[int] = set()
        for offset in self._result_places().get((wanted, channel_set), ()):
            try:
                chunk = self._chunk_of(offset)
                result = read_result(self.file, chunk, self.directory, self._channels)
            except (FormatError, *FOREIGN) as error:
                self.note_damage(Damage(None, offset, 0, f"detector result: {error}"))
                continue
            sums = result.sums if sums is None else sums + result.sums
            sums2 = result.sums2 if sums2 is None else sums2 + result.sums2
            covered.update(
                portion.number
                for portion in self.portions
                if result.first_portion <= portion.number < result.end_portion
            )
        needed = {
            p.number for p in self.portions if p.index.meta.channel_set == channel_set and p.n_rays
        }
        if sums is None or sums2 is None or not needed <= covered:
            return None
        return sums, sums2

    @cached_property
    def _detector_numbers(self) -> dict[str, int]:
        """Index of each detector by name."""
        return {detector.name: k for k, detector in enumerate(self.directory.detectors)}

    def _result_places(self) -> dict[tuple[int, int], list[int]]:
        """Offsets of the results by detector and channel set; each header is read once."""
        if self._results is None:
            places: dict[tuple[int, int], list[int]] = {}
            for offset, tag in self._footer.chunks:
                if tag != DETECTOR:
                    continue
                try:
                    chunk = self._chunk_of(offset)
                    if chunk.tag != DETECTOR:
                        raise FormatError("another chunk lies in its place")
                    head = read_result(self.file, chunk, self.directory, self._channels, data=False)
                except (FormatError, *FOREIGN) as error:
                    self.note_damage(Damage(None, offset, 0, f"detector result: {error}"))
                    continue
                places.setdefault((head.detector, head.channel_set), []).append(offset)
            self._results = places
        return self._results

    # -- damage ------------------------------------------------------------------------------

    def report_damage(self, index: IndexEntry, reason: str) -> DamagedPortion:
        """Remember damage and make the error that says so."""
        damage = Damage(index.meta.number, index.offset, index.size, reason)
        self.note_damage(damage)
        return self._error(damage, index.meta.n_records)

    def note_damage(self, damage: Damage) -> bool:
        """Remember damage, once; whether it was new."""
        with self._damaged_lock:
            new = all(
                (d.offset, d.portion) != (damage.offset, damage.portion) for d in self._damage
            )
            if new:
                self._damage.append(damage)
            return new

    def _error(self, damage: Damage, records: int | None = None) -> DamagedPortion:
        what = "bytes" if damage.portion is None else f"portion {damage.portion}"
        lost = "" if records is None else f"; {records} records are unreadable"
        error = DamagedPortion(
            f"{what} of {str(self.path)!r}: {damage.reason} (bytes {damage.offset}–"
            f"{damage.offset + damage.length - 1}){lost}, other portions are intact; use "
            'on_damage="skip" to read them'
        )
        error.reason = damage.reason
        return error

    # -- loading -----------------------------------------------------------------------------

    def _load(self) -> None:
        size = self.file.size
        found = find_footer(self.file, size)
        self._footer_chunk = found if isinstance(found, Chunk) else None
        self._load_directory(size)
        self._merged, self._merged_dropped, self._verified = None, False, None
        self._results = None
        self.torn_bytes = 0
        self.bytes = size
        if self._footer_chunk is None or not self._load_footer(self._footer_chunk):
            self._footer_chunk = None
            if isinstance(found, LostFooter):
                reason = f"footer: {found.reason}"
                self._warn_of_footer(Damage(None, found.offset, found.size, reason))
            self._walk(size)
        self.finished = self._footer_chunk is not None
        self.runs = self._footer.runs
        self.portions: Sequence[StoredPortion] = [
            StoredPortion(self, entry) for entry in self._footer.portions
        ]

    def _load_directory(self, size: int) -> None:
        """Read the first chunk; of a file far away the copy that came with the footer."""
        if self.file.bytes.distant and self._footer_chunk is not None:
            copied = copied_directory(self.file, self._footer_chunk)
            if copied is not None:
                self.directory, self.bounds = copied, Bounds.of(copied)
                return
        if not self.file.major:
            self.file.check_magic()
        try:
            self.directory = read_directory(self.file, self._directory_chunk(size))
            self.bounds = Bounds.of(self.directory)
        except (FormatError, *FOREIGN) as error:
            raise NotARayMap(
                f"{self.path} has no sound directory ({error}): nothing in it can be read"
            ) from None

    def _directory_chunk(self, size: int) -> Chunk:
        chunk = self.file.chunk_at(FILE_HEADER_SIZE, size)
        if chunk.tag != DIRECTORY:
            raise FormatError("the first chunk is no directory")
        return chunk

    def _load_footer(self, chunk: Chunk) -> bool:
        """Take the index from the footer; false if it is damaged."""
        try:
            self._footer = read_footer(self.file, chunk, len(self.directory.sources))
            self._set_channels([parse_channel_set(each) for each in self._footer.channel_sets])
            if any(e.meta.channel_set >= len(self._channels) for e in self._footer.portions):
                raise FormatError("a portion names a channel set that the map does not have")
            if len(self._footer.portions) <= COMPARED_PORTIONS and not self.file.bytes.distant:
                # Far away each header would cost a request; it is compared when it is read
                self._compare_headers()
        except (FormatError, *FOREIGN) as error:
            self._warn_of_footer(Damage(None, chunk.offset, chunk.header.size, f"footer: {error}"))
            return False
        return True

    def _compare_headers(self) -> None:
        """Compare the footer's index with the headers of the portions, where these are sound."""
        for entry in self._footer.portions:
            try:
                chunk = self.file.chunk_at(entry.offset, self.bytes, entry.head_size)
            except FormatError:
                continue
            if chunk.tag != PORTION or chunk.header.meta != entry.meta.pack():
                raise FormatError(f"its index contradicts portion {entry.meta.number}")

    def _walk(self, size: int) -> None:
        """Find the chunks one after the other, as there is no footer."""
        self._footer = Footer()
        self._last_ray = -1
        self._set_channels([])
        for item in self.file.walk(FILE_HEADER_SIZE, size):
            if isinstance(item, Gap):
                self._take_gap(item, size)
                continue
            try:
                self._take_chunk(item)
            except (FormatError, *FOREIGN) as error:
                self._found(Damage(None, item.offset, item.header.size, str(error)))

    def _take_gap(self, gap: Gap, size: int) -> None:
        if gap.end == size:
            lost = any(item.offset == gap.offset for item in self.damage)
            self.torn_bytes = 0 if lost else size - gap.offset
            self.bytes = gap.offset
        else:
            self._found(Damage(None, gap.offset, gap.end - gap.offset, gap.reason))

    def _take_chunk(self, chunk: Chunk) -> None:
        if chunk.tag == PORTION:
            meta = PortionMeta.parse(chunk.header.meta, len(self.directory.sources))
            meta.check_size(chunk.header.size)
            last = self._footer.portions[-1].meta if self._footer.portions else None
            if last is not None and meta.number <= last.number:
                raise FormatError(f"portion {meta.number} follows portion {last.number}")
            if meta.n_rays and meta.first_ray <= self._last_ray:
                raise FormatError(f"portion {meta.number} repeats ray numbers")
            if meta.channel_set >= len(self._channels):
                raise FormatError(f"portion {meta.number} names an unknown channel set")
            self._last_ray = max(meta.last_ray, self._last_ray)
            self._footer.portions.append(
                IndexEntry(chunk.offset, chunk.header.size, meta, chunk.header.head_size)
            )
            return
        if chunk.tag == CHANNELS:
            self._set_channels([*self._own_channel_sets, read_channel_set(self.file, chunk)])
        elif chunk.tag == RUN:
            self._footer.runs.append(read_run(self.file, chunk))
        self._footer.chunks.append((chunk.offset, chunk.tag))
        self._footer.sizes[chunk.offset] = chunk.header.size, chunk.header.head_size

    def _set_channels(self, channel_sets: list[ChannelSet]) -> None:
        self.channel_sets = channel_sets
        self._own_channel_sets = channel_sets
        self._channels = [channel_set.n_channels for channel_set in channel_sets]

    def _found(self, damage: Damage) -> None:
        self.note_damage(damage)
        if self.on_damage == "raise":
            raise self._error(damage)

    def __iter__(self) -> Iterator[StoredPortion]:
        return iter(self.portions)

    def __repr__(self) -> str:
        state = "finished" if self.finished else "unfinished"
        return f"<RayMap {str(self.path)!r}: {self.rays} rays, {state}>"

    def describe(self) -> dict[str, Any]:
        """The summary that ``raymap info`` prints."""
        directory = self.directory
        records = self.records
        return {
            "rays": self.rays,
            "records": records,
            "portions": len(self.portions),
            "bytes": self.bytes,
            "bytes_per_record": self.bytes / records if records else None,
            "finished": self.finished,
            "without_rays": self.without_rays,
            "verified": self.verified,
            "sources": [source.name for source in directory.sources],
            "objects": list(directory.object_columns.names),
            "faces": list(directory.faces.names),
            "detectors": [detector.name for detector in directory.detectors],
            "media": [medium.name for medium in directory.media],
            "channels": [channel_set.labels for channel_set in self.channel_sets],
            "inputs": [entry.model_dump() for entry in directory.inputs],
            "units": {"length": directory.length_unit, "flux": directory.flux_unit},
            "emitted": dict(
                zip(
                    (source.name for source in directory.sources),
                    (int(count) for count in self.emitted),
                    strict=True,
                )
            ),
            "runs": self.runs,
            "damaged": [
                {"portion": d.portion, "offset": d.offset, "length": d.length, "reason": d.reason}
                for d in self.damage
            ],
        }
