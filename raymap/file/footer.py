"""The footer: index of the chunks, counts of the portions, the runs, a copy of the directory.

The merged path dictionary has a chunk of its own before it (in maps of version 1 it stands in the
footer), so that a footer is short: its last bytes come with one request, and they open the map.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xxhash
from numpy.typing import NDArray

from raymap.bytes.chunks import Chunk, MapFile
from raymap.bytes.layout import FOOTER, PATHS, TAIL_MAGIC, pack_chunk_header
from raymap.bytes.streams import Scope, StreamSet
from raymap.encoding.description import read_directory, run_of
from raymap.encoding.paths import MergedPaths, PathDictionary
from raymap.encoding.pathstreams import Bounds, check_itineraries
from raymap.encoding.portionmeta import PortionMeta
from raymap.file.totals import compare_totals
from raymap.model.directory import Directory
from raymap.model.errors import FormatError
from raymap.model.jsontext import parse_json, write_json

__all__ = [
    "LostFooter",
    "COPIED",
    "Footer",
    "IndexEntry",
    "copied_directory",
    "find_footer",
    "pack_footer",
    "pack_merged",
    "read_footer",
    "read_merged",
]

_PATHS_META = struct.Struct("<Q")
_TAIL = struct.Struct("<QQ8s")
COPIED = "directory."
"""Prefix of the streams of the directory that the footer repeats."""
MAX_PREFETCH = 2**24
"""Bytes of a footer that are fetched together."""
MAX_COPY = 2**15
"""Bytes up to which a directory is repeated: with the footer it comes in one request."""
_COUNTS = (
    "number",
    "first_ray",
    "last_ray",
    "n_rays",
    "n_records",
    "n_descriptors",
    "n_paths",
    "n_points",
    "n_crossings",
    "channel_set",
    "flags",
)
"""Fields of the index; the flags stand last."""
_STORED = {"n_crossings": "n_meetings"}
"""Those that the format names otherwise."""
_SIGNED = {"first_ray", "last_ray"}


@dataclass(frozen=True, slots=True)
class IndexEntry:
    """Where a portion stands in the file and what its header says.

    ``head_size`` is that of header, meta block and stream table; 0 where it is not known.
    """

    offset: int
    size: int
    meta: PortionMeta
    head_size: int = 0


@dataclass(eq=False)
class Footer:
    """What a footer says, without the merged dictionary.

    Attributes
    ----------
    portions : in number order
    chunks : (offset, tag) of all other chunks, in file order
    sizes : (size, head size) of those by offset, as far as they are known
    runs : one dict per run: seed, parameters, statistics
    channel_sets : a second copy of the channel sets, as JSON values
    has_merged : a merged dictionary is there
    merged_offset : of the chunk that holds it, None where it stands in the footer
    """

    portions: list[IndexEntry] = field(default_factory=list)
    chunks: list[tuple[int, bytes]] = field(default_factory=list)
    sizes: dict[int, tuple[int, int]] = field(default_factory=dict)
    runs: list[dict[str, Any]] = field(default_factory=list)
    channel_sets: list[dict[str, Any]] = field(default_factory=list)
    has_merged: bool = False
    merged_offset: int | None = None

    def with_merged(self) -> Footer:
        """Itself, knowing the chunk of the merged dictionary: the last one of its tag."""
        for offset, tag in self.chunks:
            if tag == PATHS:
                self.merged_offset, self.has_merged = offset, True
        return self


def pack_footer(footer: Footer, directory: StreamSet | None, version: tuple[int, int]) -> list[Any]:
    """The footer chunk as buffers to be written one after the other.

    Parameters
    ----------
    directory : its streams, to be repeated if they are few; None: not to be repeated
    version : of the format of the file

    Raises
    ------
    LimitExceeded
    """
    streams = StreamSet()
    described = {
        "version": version,
        "portions": len(footer.portions),
        "chunks": len(footer.chunks),
        "runs": footer.runs,
        "channel_sets": footer.channel_sets,
    }
    streams.add_bytes("json", write_json(described, "the footer"), level=3)
    metas = [entry.meta for entry in footer.portions]
    for name in ("offset", "size", "head_size"):
        values = [getattr(entry, name) for entry in footer.portions]
        streams.add(f"portion.{name}", np.array(values, np.uint64))
    for name in _COUNTS:
        kind = np.int64 if name in _SIGNED else np.uint64
        counts = np.array([getattr(meta, name) for meta in metas], kind)
        streams.add(f"portion.{_STORED.get(name, name)}", counts)
    if metas:
        streams.add("portion.emitted", np.stack([meta.emitted for meta in metas]))
    streams.add("chunk.offset", np.array([offset for offset, _ in footer.chunks], np.uint64))
    tags = b"".join(tag for _, tag in footer.chunks)
    streams.add("chunk.tag", np.frombuffer(tags, np.uint8).reshape(-1, 8))
    sizes = [footer.sizes.get(offset, (0, 0)) for offset, _ in footer.chunks]
    for name, number in (("size", 0), ("head_size", 1)):
        streams.add(f"chunk.{name}", np.array([each[number] for each in sizes], np.uint64))
    if directory is not None and directory.stored_bytes <= MAX_COPY:
        streams.take(directory, COPIED)
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
    return streams.chunk(FOOTER)


def pack_merged(
    merged: PathDictionary, local_to_global: list[NDArray[np.int32] | None]
) -> list[Any]:
    """The chunk of the merged dictionary as buffers."""
    streams = StreamSet()
    _add_merged(streams, merged, local_to_global)
    return streams.chunk(PATHS, _PATHS_META.pack(merged.n_paths))


def _add_merged(
    streams: StreamSet, merged: PathDictionary, local_to_global: list[NDArray[np.int32] | None]
) -> None:
    streams.add("path.source", merged.source, Scope.PATH)
    streams.add("path.length", np.diff(merged.offsets).astype(np.uint32), Scope.PATH)
    for name in ("object", "face", "event", "medium"):
        streams.add(f"path.{name}", getattr(merged, name), Scope.POINT)
    crossings = np.diff(merged.detector_offsets).astype(np.uint16)
    streams.add("path.meetings", crossings, Scope.POINT)
    streams.add("path.detector", merged.detector, Scope.CROSSING)
    streams.add("path.registered", merged.registered, Scope.CROSSING)
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


@dataclass(frozen=True)
class LostFooter:
    """Bytes at the end of a file that were a footer, and why they are none any more."""

    offset: int
    size: int
    reason: str


def find_footer(file: MapFile, size: int) -> Chunk | LostFooter | None:
    """The footer that ends the file, None if the file does not end with one."""
    tail = file.read(max(0, size - _TAIL.size), _TAIL.size)
    if len(tail) < _TAIL.size or not tail.endswith(TAIL_MAGIC):
        return None
    length, check, _ = _TAIL.unpack(tail)
    file.bytes.prefetch(size - min(length, MAX_PREFETCH))
    if check != xxhash.xxh3_64_intdigest(tail[:8] + TAIL_MAGIC) or not 0 < length <= size:
        return None
    try:
        chunk = file.chunk_at(size - length, size)
    except FormatError as error:
        return LostFooter(size - length, length, str(error))
    if chunk.tag != FOOTER or chunk.end != size:
        return LostFooter(size - length, length, "its head is that of another chunk")
    return chunk


def copied_directory(file: MapFile, chunk: Chunk) -> Directory | None:
    """The directory that a footer repeats; None where it repeats none, or it is damaged."""
    if f"{COPIED}json" not in chunk.by_name:
        return None
    try:
        described = parse_json(file.text_of(chunk), dict, "footer")
        major = described.get("version", [0])[0]
        directory = read_directory(file, chunk, COPIED)
        file.take_version(major)
    except (FormatError, LookupError, TypeError):
        return None
    return directory


def read_footer(file: MapFile, chunk: Chunk, n_sources: int) -> Footer:
    """Read a footer and check that its index lies within the file.

    Raises
    ------
    FormatError
        A stream is damaged or the index contradicts the file.
    """
    described = parse_json(file.text_of(chunk), dict, "footer")
    try:
        runs = [run_of(run) for run in described["runs"]]
        channel_sets = [dict(each) for each in described["channel_sets"]]
        counts_of = {name: _count(described.get(name)) for name in ("portions", "chunks")}
    except (ValueError, TypeError, KeyError) as error:
        raise FormatError(f"footer holds no sound JSON: {error}") from None
    offsets = file.column(chunk, "portion.offset", counts_of["portions"], np.uint64)
    n = len(offsets)
    if n > chunk.offset:
        raise FormatError("footer lists more portions than the file has bytes")
    sizes = file.column(chunk, "portion.size", n, np.uint64)
    counts = {
        name: file.column(
            chunk,
            f"portion.{_STORED.get(name, name)}",
            n,
            np.int64 if name in _SIGNED else np.uint64,
        )
        for name in _COUNTS
    }
    emitted = (
        file.column(chunk, "portion.emitted", n, np.int64, matrix=True).reshape(n, -1)
        if n
        else np.empty((0, n_sources), np.int64)
    )
    if emitted.shape[1] != n_sources:
        raise FormatError("footer counts the rays emitted of another number of sources")
    heads = _optional(file, chunk, "portion.head_size", n)
    portions = []
    previous = -1
    for row in range(n):
        flags = int(counts["flags"][row])
        fields: dict[str, Any] = {name: int(counts[name][row]) for name in _COUNTS[:-1]}
        meta = PortionMeta(**fields, **PortionMeta.marks(flags), emitted=emitted[row])
        meta.check()
        meta.check_size(int(sizes[row]))
        entry = IndexEntry(int(offsets[row]), int(sizes[row]), meta, int(heads[row]))
        if (
            entry.head_size > entry.size
            or entry.offset + entry.size > chunk.offset
            or meta.number <= previous
        ):
            raise FormatError("footer's index of portions contradicts the file")
        previous = meta.number
        portions.append(entry)
    others = file.column(chunk, "chunk.offset", counts_of["chunks"], np.uint64)
    tags = file.column(chunk, "chunk.tag", len(others), np.uint8, matrix=True).reshape(
        len(others), -1
    )
    if tags.shape[1:] != (8,) or (len(others) and int(others.max()) >= chunk.offset):
        raise FormatError("footer's index of chunks contradicts the file")
    chunks = [(int(offset), tag.tobytes()) for offset, tag in zip(others, tags, strict=True)]
    whole = _optional(file, chunk, "chunk.size", len(others))
    heads = _optional(file, chunk, "chunk.head_size", len(others))
    return Footer(
        portions=portions,
        chunks=chunks,
        sizes={
            offset: (int(size), int(head))
            for (offset, _), size, head in zip(chunks, whole, heads, strict=True)
        },
        runs=runs,
        channel_sets=channel_sets,
        has_merged="local_to_global" in chunk.by_name,
    ).with_merged()


def _count(value: Any) -> int | None:
    """A number of rows; maps of version 1 do not say it."""
    if value is not None and (type(value) is not int or value < 0):
        raise ValueError(f"{value!r} is no number of chunks")
    return value


def _optional(file: MapFile, chunk: Chunk, name: str, rows: int) -> NDArray[np.uint64]:
    """A column of sizes, zeros where it is not there."""
    if name not in chunk.by_name:
        return np.zeros(rows, np.uint64)
    return file.column(chunk, name, rows, np.uint64)


def read_merged(
    file: MapFile, chunk: Chunk, footer: Footer, bounds: Bounds, channels: list[int]
) -> MergedPaths:
    """Read the merged dictionary and the portions' numbers in it.

    Raises
    ------
    FormatError
        A stream is damaged or numbers point outside of the dictionary.
    """
    n = _merged_paths(file, chunk)
    columns = check_itineraries(
        lambda name, rows, dtype: file.column(chunk, f"path.{name}", rows, dtype), n, bounds
    )
    sets = []
    for number, n_channels in enumerate(channels):
        name = f"path.sum_wc.{number}"
        if name in chunk.by_name:
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
            file.column(chunk, "path.sum_wy2", n, np.float64)
            if "path.sum_wy2" in chunk.by_name
            else None
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


def _merged_paths(file: MapFile, chunk: Chunk) -> int:
    """Rows of the columns per path."""
    if chunk.tag != PATHS:
        return len(file.column(chunk, "path.source", None, np.int16))
    if len(chunk.header.meta) != _PATHS_META.size:
        raise FormatError("merged dictionary has a header of the wrong size")
    return int(_PATHS_META.unpack(chunk.header.meta)[0])
