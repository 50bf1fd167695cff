"""Continue a map: lock it, cut a torn tail, take up its index and its dictionary."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.appender import ChunkAppender
from raymap.bytes.layout import CHANNELS, FOOTER, RUN, VERSION
from raymap.encoding.dictionary import PathMerger
from raymap.file.footer import Footer
from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import FormatError, SceneMismatch
from raymap.model.jsontext import plain

__all__ = ["WriterState", "resume", "scene_difference"]

_SCENE = ("sources", "objects", "media", "surfaces", "detectors")


@dataclass
class WriterState:
    """What a writer knows of the map that it continues."""

    footer: Footer = field(default_factory=Footer)
    merger: PathMerger = field(default_factory=PathMerger)
    local_to_global: list[NDArray[np.int32] | None] = field(default_factory=list)
    channel_sets: list[ChannelSet] = field(default_factory=list)
    first_ray: int = 0
    version: tuple[int, int] = VERSION
    described: int = 0


def resume(path: Path, directory: Directory | None) -> tuple[ChunkAppender, Directory, WriterState]:
    """Lock the map and learn what it holds.

    Raises
    ------
    SceneMismatch, MapLocked, NotARayMap, DamagedPortion
    """
    from raymap.file.reader import RayMap

    appender = ChunkAppender.open(path)
    try:
        with RayMap(path, on_damage="skip") as ray_map:
            own = ray_map.directory
            if directory is not None:
                difference = scene_difference(own, directory)
                if difference:
                    raise SceneMismatch(
                        f"{path} was recorded from another scene: {difference}; "
                        "write a new map instead"
                    )
            state = WriterState(
                footer=Footer(
                    portions=[portion.index for portion in ray_map.portions],
                    chunks=ray_map.other_chunks,
                    sizes=ray_map.chunk_sizes,
                    runs=list(ray_map.runs),
                ),
                channel_sets=list(ray_map.channel_sets),
                version=(ray_map.file.major, 0),
                described=_described(ray_map),
            )
            _take_paths(ray_map, state)
            if ray_map.footer_chunk is not None:
                state.footer.chunks.append((ray_map.footer_chunk.offset, FOOTER))
        appender.cut(ray_map.bytes)
    except BaseException:
        appender.close()
        raise
    return appender, own, state


def _described(ray_map: Any) -> int:
    """Bytes of the chunks whose content the footer repeats."""
    sizes = ray_map.chunk_sizes
    return sum(
        sizes.get(offset, (0, 0))[0]
        for offset, tag in ray_map.other_chunks
        if tag in (CHANNELS, RUN)
    )


def _take_paths(ray_map: Any, state: WriterState) -> None:
    """The merged dictionary from the footer, else portion by portion."""
    merged = ray_map.merged
    if merged is not None:
        state.merger = PathMerger()
        state.merger.add(merged.paths)
        state.local_to_global = list(merged.local_to_global)
        return
    kept = []
    for portion, entry in zip(ray_map.portions, state.footer.portions, strict=True):
        try:
            numbers = state.merger.add(portion.paths()) if portion.has_paths else None
        except FormatError:
            # A damaged portion stays out of the index, as it cannot be served
            continue
        kept.append(entry)
        state.local_to_global.append(numbers)
    state.footer.portions = kept


def scene_difference(own: Directory, other: Directory) -> str:
    """In words, where two scenes differ first; empty if they are the same scene."""
    if own.scene_hash and own.scene_hash == other.scene_hash:
        return ""
    for name in ("length_unit", "flux_unit"):
        if getattr(own, name) != getattr(other, name):
            return f"its {name} is {getattr(own, name)!r}, not {getattr(other, name)!r}"
    for name in _SCENE:
        mine = {entry.name: entry for entry in getattr(own, name)}
        theirs = {entry.name: entry for entry in getattr(other, name)}
        for key in [*mine, *theirs]:
            if key not in theirs:
                return f"it has {name[:-1]} {key!r}, the other has not"
            if key not in mine:
                return f"it has no {name[:-1]} {key!r}"
            if mine[key] != theirs[key] and plain(mine[key]) != plain(theirs[key]):
                return f"{name[:-1]} {key!r} differs ({_field(mine[key], theirs[key])})"
        if list(mine) != list(theirs):
            return f"the {name} stand in another order"
    if own.bounding_sphere != other.bounding_sphere:
        return "its bounding sphere differs"
    if own.scene_hash != other.scene_hash:
        return "its scene hash differs"
    return ""


def _field(mine: Any, theirs: Any) -> str:
    a, b = mine.model_dump(), theirs.model_dump()
    for key in {**a, **b}:
        if a.get(key) != b.get(key):
            x, y = str(a.get(key)), str(b.get(key))
            return f"{key}: {x} here, {y} there" if len(x) + len(y) < 160 else key
    return "unknown keys"
