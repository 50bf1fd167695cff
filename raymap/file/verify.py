"""Read all of a map and say what is sound."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from raymap.bytes.chunks import Chunk, Gap
from raymap.bytes.decoding import FOREIGN
from raymap.bytes.layout import CHANNELS, DETECTOR, FILE_HEADER_SIZE, RUN
from raymap.bytes.streams import decode_bytes
from raymap.encoding.description import read_channel_set, read_directory, read_run
from raymap.encoding.dictionary import PathMerger
from raymap.encoding.results import read_result
from raymap.file.agreement import FALSE_COUNTS, FALSE_RAYS, FalseFooter, difference, false_sums
from raymap.file.cellsums import DetectorSums
from raymap.file.checks import check_portion
from raymap.file.footer import COPIED
from raymap.file.mixed import MixedMap
from raymap.file.reader import Damage, RayMap
from raymap.file.stamps import forget, stamp
from raymap.file.stored import StoredPortion
from raymap.model.directory import ChannelSet
from raymap.model.errors import DamagedPortion, FormatError, InvalidPortion, RayMapError
from raymap.optics.cells import is_pinhole

__all__ = ["Verification", "portion_problem", "verify"]


@dataclass(kw_only=True)
class Verification:
    """What was found in a map.

    Attributes
    ----------
    portions, good : portions found, and those that are sound in every byte
    rays_readable : rays of the sound ones
    finished : the map ends with a footer
    torn_bytes : bytes of a portion that was being written when the recording ended
    damage : everything else
    """

    portions: int = 0
    good: int = 0
    rays_readable: int = 0
    finished: bool = False
    torn_bytes: int = 0
    damage: list[Damage] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        return {
            "portions": self.portions,
            "good": self.good,
            "damaged": [
                {"portion": d.portion, "offset": d.offset, "length": d.length, "reason": d.reason}
                for d in self.damage
            ],
            "rays_readable": self.rays_readable,
            "finished": self.finished,
            "torn_bytes": self.torn_bytes,
        }


def verify(ray_map: RayMap) -> Verification:
    """Check every byte of a map, or of all maps of which it is made; damage never raises here."""
    result = Verification(finished=ray_map.finished)
    shards = ray_map.shards
    if isinstance(ray_map, MixedMap):
        shards = [part for part, _, _ in ray_map.parts]
    for shard in shards:
        try:
            with RayMap(shard.path, on_damage="skip") as own:
                before = len(result.damage)
                _verify_file(own, result)
                if isinstance(own.path, Path):
                    sound = own.finished and len(result.damage) == before
                    (stamp if sound else forget)(own.path)
        except (RayMapError, *FOREIGN) as error:
            reason = f"it cannot be verified ({type(error).__name__}: {error})"
            result.damage.append(Damage(None, 0, shard.bytes, reason))
    return result


def _verify_file(ray_map: RayMap, result: Verification) -> None:
    merger = PathMerger()
    sound = True
    results = DetectorSums()
    for index, portion in enumerate(ray_map.portions):
        problem = portion_problem(portion)
        result.portions += 1
        if problem is None:
            result.good += 1
            result.rays_readable += portion.n_rays
            if portion.has_paths:
                merger.add(portion.paths())
                _compare_merged(ray_map, index)
            results.add(portion)
        else:
            sound = False
            ray_map.report_damage(portion.index, problem)
            if problem in FALSE_COUNTS:
                result.rays_readable += portion.n_rays
    result.portions += sum(d.portion is not None and d.length > 0 for d in _lost(ray_map))
    result.torn_bytes += ray_map.torn_bytes
    _check_others(ray_map)
    _check_index(ray_map)
    if sound:
        _check_results(ray_map, results)
    merged = ray_map.merged
    if merged is not None and sound and ray_map.footer_chunk is not None:
        unlike = difference(merged.paths, merger.dictionary())
        if unlike:
            chunk = ray_map.footer_chunk
            ray_map.note_damage(
                Damage(None, chunk.offset, chunk.header.size, f"merged dictionary: {unlike}")
            )
    result.damage += ray_map.damage


def _compare_merged(ray_map: RayMap, index: int) -> None:
    """Compare a portion's paths with those that the footer says it has."""
    merged, portion = ray_map.merged, ray_map.portions[index]
    local = None if merged is None else merged.local_to_global[index]
    if merged is not None and local is not None:
        with contextlib.suppress(FalseFooter):
            portion.compare(merged.paths, local)


def _check_index(ray_map: RayMap) -> None:
    """Compare what the footer lists and repeats with the chunks that are there."""
    footer = ray_map.footer_chunk
    if footer is None:
        return
    channel_sets: list[ChannelSet] = []
    runs: list[dict[str, Any]] = []
    found: list[int] = []
    sizes = {p.offset: (p.index.size, p.index.head_size) for p in ray_map.portions}
    sizes = {at: both for at, both in (ray_map.chunk_sizes | sizes).items() if all(both)}
    try:
        _check_copy(ray_map, footer)
        for item in ray_map.file.walk(FILE_HEADER_SIZE, footer.offset):
            if isinstance(item, Gap):
                raise FormatError(f"bytes {item.offset}–{item.end - 1} are no chunk")
            found.append(item.offset)
            here = item.header.size, item.header.head_size
            if sizes.get(item.offset, here) != here:
                raise FormatError(f"it gives the chunk at byte {item.offset} another size")
            if item.tag == CHANNELS:
                channel_sets.append(read_channel_set(ray_map.file, item))
            elif item.tag == RUN:
                runs.append(read_run(ray_map.file, item))
        listed = [portion.offset for portion in ray_map.portions]
        listed += [offset for offset, _ in ray_map.other_chunks]
        if sorted({*found[:1], *listed}) != found:
            raise FormatError("the index does not list the chunks that are there")
        if channel_sets != ray_map.own_channel_sets:
            raise FormatError("its channel sets are not those of the map")
        # A run that ended has more to say than when it began
        nothing: dict[str, Any] = {}
        for begun, ended in zip_longest(runs, ray_map.runs, fillvalue=nothing):
            if any(ended.get(key) != value for key, value in begun.items()):
                raise FormatError("its runs are not those of the map")
    except FormatError as error:
        size = footer.header.size
        ray_map.note_damage(Damage(None, footer.offset, size, f"footer: {error}"))


def _check_copy(ray_map: RayMap, footer: Chunk) -> None:
    """Compare the directory that the footer repeats with the one that the map begins with."""
    if f"{COPIED}json" not in footer.by_name:
        return
    first = ray_map.file.chunk_at(FILE_HEADER_SIZE, ray_map.bytes)
    own = read_directory(ray_map.file, first)
    if read_directory(ray_map.file, footer, COPIED) != own:
        raise FormatError("its copy of the directory is another one")


def _check_results(ray_map: RayMap, counted: DetectorSums) -> None:
    """Compare the sums that are kept of detectors with those of the rays."""
    stored = {portion.channel_set for portion in ray_map.portions if portion.n_rays}
    for (number, channel_set), sums in counted.sums.items():
        detector = ray_map.directory.detectors[number]
        if channel_set not in stored or is_pinhole(detector):
            continue
        stated = ray_map.detector_result(detector.name, channel_set)
        if stated is None:
            continue
        for mine, theirs in zip(sums, stated, strict=True):
            slack = 1e-7 * max(float(np.abs(mine).max(initial=0.0)), 1.0)
            if not np.allclose(mine, theirs, rtol=1e-6, atol=slack):
                offset = next(at for at, tag in ray_map.other_chunks if tag == DETECTOR)
                reason = f"sums of detector {detector.name!r} contradict the rays"
                ray_map.note_damage(Damage(None, offset, 0, reason))


def _lost(ray_map: RayMap) -> list[Damage]:
    """Damage of portions that are not in the list of portions any more."""
    listed = {portion.number for portion in ray_map.portions}
    return [d for d in ray_map.damage if d.portion is not None and d.portion not in listed]


def portion_problem(portion: StoredPortion) -> str | None:
    """What is wrong with a stored portion, None if it is sound in every byte."""
    try:
        for entry in portion.stream_table():
            decode_bytes(entry, portion.fetch(entry))
        content = portion.read()
        check_portion(content, portion.map.directory, portion.map.channel_sets[portion.channel_set])
        if portion.has_paths:
            sums = false_sums(portion)
            return FALSE_RAYS if portion.false_rays else sums or None
    except DamagedPortion as error:
        return error.reason or str(error)
    except (FormatError, InvalidPortion) as error:
        return str(error)
    except FOREIGN as error:
        return f"its values cannot be checked ({type(error).__name__}: {error})"
    return None


def _check_others(ray_map: RayMap) -> None:
    """Chunks that are no portions, and what of the directory is decoded when it is asked for."""
    try:
        ray_map.directory.object_columns.parse_further()
        ray_map.meshes  # noqa: B018
    except FormatError as error:
        ray_map.note_damage(Damage(None, FILE_HEADER_SIZE, 0, f"directory: {error}"))
    channels = [channel_set.n_channels for channel_set in ray_map.channel_sets]
    for offset, tag in ray_map.other_chunks:
        try:
            chunk = ray_map.file.chunk_at(offset, ray_map.bytes)
            if chunk.tag != tag:
                raise FormatError("another chunk lies in its place")
            for entry in chunk.header.streams:
                decode_bytes(entry, ray_map.file.stored(chunk, entry))
            if tag == DETECTOR:
                read_result(ray_map.file, chunk, ray_map.directory, channels)
        except FormatError as error:
            name = {CHANNELS: "channel set", RUN: "run", DETECTOR: "detector result"}.get(tag)
            ray_map.note_damage(Damage(None, offset, 0, f"{name or 'chunk'}: {error}"))
