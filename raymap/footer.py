"""The footer: index of the chunks, counts of the portions, the merged path dictionary, the runs."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xxhash
from numpy.typing import NDArray

from raymap.agreement import compare_totals
from raymap.chunks import Chunk, MapFile
from raymap.errors import FormatError
from raymap.layout import FOOTER, pack_chunk_header
from raymap.paths import MergedPaths, PathDictionary
from raymap.pathstreams import Bounds, check_itineraries
from raymap.portionmeta import PortionMeta
from raymap.streams import Scope, StreamSet

__all__ = ["Footer", "IndexEntry", "find_footer", "pack_footer", "read_footer", "read_merged"]

_TAIL = struct.Struct("<QQ8s")
TAIL_MAGIC = b"RMAP\r\nZ\n"
_COUNTS = (
    "number",
    "first_ray",
    "last_ray",
    "n_rays",
    "n_records",
    "n_descriptors",
    "n_paths",
    "n_points",
    "n_meetings",
    "channel_set",
    "flags",
)
"""Fields of the index; the flags stand last."""
_SIGNED = {"first_ray", "last_ray"}


@dataclass(frozen=True, slots=True)
class IndexEntry:
    """Where a portion stands in the file and what its header says."""

    offset: int
    size: int
    meta: PortionMeta


@dataclass(eq=False)
class Footer:
    """What a footer says, without the merged dictionary.

    Attributes
    ----------
    portions : in number order
    chunks : (offset, tag) of all other chunks, in file order
    runs : one dict per run: seed, parameters, statistics
    channel_sets : a second copy of the channel sets, as JSON values
    has_merged : a merged dictionary is there
    """

    portions: list[IndexEntry] = field(default_factory=list)
    chunks: list[tuple[int, bytes]] = field(default_factory=list)
    runs: list[dict[str, Any]] = field(default_factory=list)
    channel_sets: list[dict[str, Any]] = field(default_factory=list)
    has_merged: bool = False


def pack_footer(
    footer: Footer,
    merged: PathDictionary | None,
    local_to_global: list[NDArray[np.int32] | None],
) -> list[Any]:
    """The footer chunk as buffers to be written one after the other."""
    streams = StreamSet()
    described = {"runs": footer.runs, "channel_sets": footer.channel_sets}
    streams.add_bytes("json", json.dumps(described).encode(), level=3)
    metas = [entry.meta for entry in footer.portions]
    for name in ("offset", "size"):
        values = [getattr(entry, name) for entry in footer.portions]
        streams.add(f"portion.{name}", np.array(values, np.uint64))
    for name in _COUNTS:
        kind = np.int64 if name in _SIGNED else np.uint64
        streams.add(f"portion.{name}", np.array([getattr(meta, name) for meta in metas], kind))
    if metas:
        streams.add("portion.emitted", np.stack([meta.emitted for meta in metas]))
    streams.add("chunk.offset", np.array([offset for offset, _ in footer.chunks], np.uint64))
    tags = b"".join(tag for _, tag in footer.chunks)
    streams.add("chunk.tag", np.frombuffer(tags, np.uint8).reshape(-1, 8))
    if merged is not None:
        _add_merged(streams, merged, local_to_global)
    # The tail lies in the chunk as its last stream, so that the size of the chunk is known before
    tail = np.zeros(_TAIL.size, np.uint8)
    streams.raw = True
    streams.add("tail", tail)
    size = len(pack_chunk_header(FOOTER, b"", streams.entries)) + streams.stored_bytes
    packed = struct.pack("<Q", size)
    check = xxhash.xxh3_64_intdigest(packed + TAIL_MAGIC)
    streams.entries.pop()
    streams.buffers.pop()
    streams.add("tail", np.frombuffer(_TAIL.pack(size, check, TAIL_MAGIC), np.uint8))
    return [pack_chunk_header(FOOTER, b"", streams.entries), *streams.buffers]


def _add_merged(
    streams: StreamSet, merged: PathDictionary, local_to_global: list[NDArray[np.int32] | None]
) -> None:
    streams.add("path.source", merged.source, Scope.PATH)
    streams.add("path.length", np.diff(merged.offsets).astype(np.uint32), Scope.PATH)
    for name in ("object", "face", "event", "medium"):
        streams.add(f"path.{name}", getattr(merged, name), Scope.POINT)
    meetings = np.diff(merged.detector_offsets).astype(np.uint16)
    streams.add("path.meetings", meetings, Scope.POINT)
    streams.add("path.detector", merged.detector, Scope.MEETING)
    streams.add("path.registered", merged.registered, Scope.MEETING)
    streams.add("path.rays", merged.rays, Scope.PATH)
    streams.add("path.sum_w", merged.sum_w, Scope.PATH)
    streams.add("path.sum_w2", merged.sum_w2, Scope.PATH)
    if merged.sum_wy2 is not None:
        streams.add("path.sum_wy2", merged.sum_wy2, Scope.PATH)
    streams.add("path.grouped", np.array([merged.grouped]))
    for number, sums in enumerate(merged.sum_wc):
        if sums.shape[1]:
            streams.add(f"path.sum_wc.{number}", sums, Scope.PATH)
    present = [numbers for numbers in local_to_global if numbers is not None]
    joined = np.concatenate(present) if present else np.empty(0, np.int32)
    streams.add("local_to_global", joined.astype(np.uint32))


def find_footer(file: MapFile, size: int) -> Chunk | None:
    """The footer that ends the file, None if the file does not end with one."""
    tail = file.read(max(0, size - _TAIL.size), _TAIL.size)
    if len(tail) < _TAIL.size or not tail.endswith(TAIL_MAGIC):
        return None
    length, check, _ = _TAIL.unpack(tail)
    if check != xxhash.xxh3_64_intdigest(tail[:8] + TAIL_MAGIC) or not 0 < length <= size:
        return None
    try:
        chunk = file.chunk_at(size - length, size)
    except FormatError:
        return None
    return chunk if chunk.tag == FOOTER and chunk.end == size else None


def read_footer(file: MapFile, chunk: Chunk, n_sources: int) -> Footer:
    """Read a footer and check that its index lies within the file.

    Raises
    ------
    FormatError
        A stream is damaged or the index contradicts the file.
    """
    try:
        described = json.loads(file.text_of(chunk))
        runs = [dict(run) for run in described["runs"]]
        channel_sets = [dict(each) for each in described["channel_sets"]]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise FormatError(f"footer holds no sound JSON: {error}") from None
    offsets = file.column(chunk, "portion.offset", None, np.uint64)
    n = len(offsets)
    if n > chunk.offset:
        raise FormatError("footer lists more portions than the file has bytes")
    sizes = file.column(chunk, "portion.size", n, np.uint64)
    counts = {
        name: file.column(chunk, f"portion.{name}", n, np.int64 if name in _SIGNED else np.uint64)
        for name in _COUNTS
    }
    emitted = (
        file.column(chunk, "portion.emitted", n, np.int64, matrix=True).reshape(n, -1)
        if n
        else np.empty((0, n_sources), np.int64)
    )
    if emitted.shape[1] != n_sources:
        raise FormatError("footer counts the rays emitted of another number of sources")
    portions = []
    previous = -1
    for row in range(n):
        flags = int(counts["flags"][row])
        fields: dict[str, Any] = {name: int(counts[name][row]) for name in _COUNTS[:-1]}
        meta = PortionMeta(**fields, **PortionMeta.marks(flags), emitted=emitted[row])
        meta.check()
        meta.check_size(int(sizes[row]))
        entry = IndexEntry(int(offsets[row]), int(sizes[row]), meta)
        if entry.offset + entry.size > chunk.offset or meta.number <= previous:
            raise FormatError("footer's index of portions contradicts the file")
        previous = meta.number
        portions.append(entry)
    others = file.column(chunk, "chunk.offset", None, np.uint64)
    tags = file.column(chunk, "chunk.tag", len(others), np.uint8, matrix=True).reshape(
        len(others), -1
    )
    if tags.shape[1:] != (8,) or (len(others) and int(others.max()) >= chunk.offset):
        raise FormatError("footer's index of chunks contradicts the file")
    names = {entry.name for entry in chunk.header.streams}
    return Footer(
        portions=portions,
        chunks=[(int(offset), tag.tobytes()) for offset, tag in zip(others, tags, strict=True)],
        runs=runs,
        channel_sets=channel_sets,
        has_merged="local_to_global" in names,
    )


def read_merged(
    file: MapFile, chunk: Chunk, footer: Footer, bounds: Bounds, channels: list[int]
) -> MergedPaths:
    """Read the merged dictionary and the portions' numbers in it.

    Raises
    ------
    FormatError
        A stream is damaged or numbers point outside of the dictionary.
    """
    n = len(file.column(chunk, "path.source", None, np.int16))
    columns = check_itineraries(
        lambda name, rows, dtype: file.column(chunk, f"path.{name}", rows, dtype), n, bounds
    )
    sets = []
    names = {entry.name for entry in chunk.header.streams}
    for number, n_channels in enumerate(channels):
        name = f"path.sum_wc.{number}"
        if name in names:
            sums = file.column(chunk, name, n, np.float64, matrix=True).reshape(n, -1)
            if n and sums.shape[1] != n_channels:
                raise FormatError(f"stream {name!r} has {sums.shape[1]} channels")
            sets.append(sums)
        else:
            sets.append(np.zeros((n, 0)))
    paths = PathDictionary(
        **columns._asdict(),
        rays=file.column(chunk, "path.rays", n, np.int64),
        sum_w=file.column(chunk, "path.sum_w", n, np.float64),
        sum_w2=file.column(chunk, "path.sum_w2", n, np.float64),
        sum_wc=tuple(sets),
        sum_wy2=(
            file.column(chunk, "path.sum_wy2", n, np.float64) if "path.sum_wy2" in names else None
        ),
        grouped=bool(file.column(chunk, "path.grouped", 1, np.bool_)[0]),
    )
    local = [entry.meta.n_paths if entry.meta.has_paths else 0 for entry in footer.portions]
    numbers = file.column(chunk, "local_to_global", sum(local), np.uint32)
    if len(numbers) and int(numbers.max()) >= n:
        raise FormatError("a portion's path is not in the merged dictionary")
    pieces = np.split(numbers.astype(np.int32), np.cumsum(local)[:-1]) if local else []
    merged = MergedPaths(
        paths=paths,
        local_to_global=[
            piece if entry.meta.has_paths else None
            for piece, entry in zip(pieces, footer.portions, strict=True)
        ],
    )
    metas = [entry.meta for entry in footer.portions if entry.meta.has_paths]
    compare_totals(
        merged,
        sum(meta.n_rays for meta in metas),
        [any(meta.channel_set == number for meta in metas) for number in range(len(channels))],
        weighted=any(meta.has_weights for meta in metas),
        grouped=any(meta.grouped for meta in metas),
    )
    return merged
