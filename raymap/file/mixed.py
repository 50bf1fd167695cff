"""Maps of one scene that differ in their sources, mixed: one map in which each counts its factor.

A *mix* is a small JSON file that names the maps; nothing is copied. Rays of the maps get numbers of
their own: those of each map follow a round number.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.decoding import decodes
from raymap.encoding.dictionary import PathMerger
from raymap.encoding.paths import MergedPaths, PathDictionary
from raymap.encoding.pathstreams import Bounds
from raymap.file.plainpaths import PlainPaths
from raymap.file.reader import Damage, RayMap
from raymap.file.resume import scene_difference
from raymap.file.stored import StoredPortion
from raymap.file.views import PortionView
from raymap.model.directory import ChannelSet, DisplayMesh, Source
from raymap.model.errors import (
    FormatError,
    NotARayMap,
    RayMapError,
    RayNotFound,
    SceneMismatch,
)
from raymap.model.givenfile import given_bytes
from raymap.model.jsontext import parse_json
from raymap.model.replacing import refuse_existing, replacing

__all__ = ["MIX", "MixedMap", "opened_mix", "write_mix"]

MIX = ".raymix"
"""Suffix of mixes."""
_KEY = "raymap_mix"
_MOST_MAPS = 1000
_MOST_FACTOR = 1e30


class _Part:
    """One map of a mix.

    Attributes
    ----------
    map, factor : it, and by what its light counts
    sources : (n_sources of the map,) number of each in the mix, -1 of those that emitted nothing
    shift : what is added to its ray numbers
    sets : number of each of its channel sets in the mix
    """

    def __init__(self, map: RayMap, factor: float) -> None:
        self.map, self.factor = map, factor
        emitted = map.emitted if map.portions else np.zeros(len(map.directory.sources), np.int64)
        self.lit = [
            k
            for k, source in enumerate(map.directory.sources)
            if emitted[k] or (source.flux > 0.0 and source.parameters.get("on", True))
        ]
        self.sources = np.full(len(emitted), -1, np.int16)
        self.shift = 0
        self.sets: list[int] = []

    def spread(self, emitted: NDArray[np.int64], n: int) -> NDArray[np.int64]:
        """Emitted rays of the sources of a mix."""
        found = np.zeros(n, np.int64)
        found[self.sources[self.lit]] = emitted[self.lit]
        return found

    def paths(self, own: PathDictionary, n_sets: int) -> PathDictionary:
        """Paths as the mix numbers sources and channel sets."""
        sums = [np.zeros((own.n_paths, 0)) for _ in range(n_sets)]
        for place, each in zip(self.sets, own.sum_wc, strict=False):
            sums[place] = each
        return replace(own, source=self.sources[own.source], sum_wc=tuple(sums))


class _MixedPortion(PortionView):
    """A portion of one of the maps."""

    def __init__(self, own: StoredPortion, map: MixedMap, part: _Part, local: Any) -> None:
        super().__init__(own, map)
        self._part, self._local, self._mixed = part, local, map
        self.first_ray += part.shift
        self.last_ray += part.shift
        self.emitted = part.spread(own.emitted, len(map.directory.sources))
        self.channel_set = part.sets[own.channel_set]

    @decodes
    def paths(self) -> PathDictionary:
        """The dictionary, by the sources of the mix."""
        if not self.has_paths:
            return PlainPaths(self)
        return self._part.paths(self.own.paths(), len(self._mixed.channel_sets))

    def compare(self, merged: PathDictionary, local: Any) -> None:
        """Hold the map's own merged dictionary against the portion."""
        base = self._part.map.merged
        if base is None or self._local is None:
            return
        try:
            self.own.compare(base.paths, self._local)
        except FormatError:
            self._mixed.serve_no_merged()
            raise

    @decodes
    def _decoded(self, name: str) -> NDArray[Any] | None:
        column = self.own._decoded(name)
        if column is None or name not in ("source", "emission"):
            return column
        return self._part.sources[column] if name == "source" else column + self._part.shift

    def ray_ids(self) -> NDArray[np.int64]:
        """(n_rays,) ray numbers of the mix."""
        return self.own.ray_ids() + self._part.shift

    def index_of(self, ray_id: int) -> int:
        """Place of a ray in the portion."""
        try:
            return self.own.index_of(ray_id - self._part.shift)
        except RayNotFound:
            raise RayNotFound(f"{self._mixed.path} has no ray {ray_id}") from None


class MixedMap(RayMap):
    """Maps of one scene with other sources, as one map.

    Parameters
    ----------
    parts : open maps and the factors of their light; closed with the mix
    name : what it is called

    Raises
    ------
    SceneMismatch
        They differ in more than sources, or one of them is there twice.
    """

    def __init__(self, parts: Sequence[tuple[RayMap, float]], name: Path) -> None:
        self.path, self.on_damage = name, parts[0][0].on_damage
        self._parts = [_Part(map, factor) for map, factor in parts]
        self._check()
        first = parts[0][0]
        sources = self._sources()
        self.directory = first.directory.model_copy(
            update={"sources": tuple(sources), "scene_text": "", "scene_hash": ""}
        )
        self.bounds = Bounds.of(self.directory)
        self.channel_sets = self._united_channels(len(sources))
        last = max((p.last_ray for part in self._parts for p in part.map.portions), default=0)
        step = 10 ** len(str(max(last, 1)))
        for number, part in enumerate(self._parts):
            part.shift = number * step
        self.portions = []
        for part in self._parts:
            merged = part.map.merged
            for index, own in enumerate(part.map.portions):
                local = None if merged is None else merged.local_to_global[index]
                self.portions.append(_MixedPortion(own, self, part, local))
        self.finished = all(part.map.finished for part in self._parts)
        # Of which run a portion is says its own map: numbers of portions repeat here
        self.runs: list[Any] = []
        self.bytes = sum(part.map.bytes for part in self._parts)
        self.torn_bytes = sum(part.map.torn_bytes for part in self._parts)
        self._all: MergedPaths | None = None
        self._without = False

    def _check(self) -> None:
        known: set[Any] = set()
        first = self._parts[0].map
        for part in self._parts:
            part.map.need_rays()
            own = [part.map.directory, first.directory]
            mine, theirs = (
                each.model_copy(update={"sources": (), "scene_hash": ""}) for each in own
            )
            difference = scene_difference(theirs, mine)
            if difference:
                raise SceneMismatch(
                    f"{part.map.path} differs from {first.path} in more than its sources: "
                    f"{difference}"
                )
            for identity in part.map.identities:
                if identity in known:
                    raise SceneMismatch(f"{part.map.path} is in the mix twice: add up its factors")
                known.add(identity)

    def _sources(self) -> list[Source]:
        found: list[Source] = []
        for part in self._parts:
            for number in part.lit:
                entry = part.map.directory.sources[number]
                name, count = entry.name, 2
                while name in {each.name for each in found}:
                    name, count = f"{entry.name} ({count})", count + 1
                flux = entry.flux * part.factor
                part.sources[number] = len(found)
                found.append(entry.model_copy(update={"name": name, "flux": flux}))
        return found

    def _united_channels(self, n_sources: int) -> list[ChannelSet]:
        united: list[ChannelSet] = []
        for part in self._parts:
            for own in part.map.channel_sets:
                first = self._parts[0].map.channel_sets[0]
                if (own.kind, own.wavelengths_nm) != (first.kind, first.wavelengths_nm):
                    raise SceneMismatch(
                        f"{part.map.path} has other channels than {self._parts[0].map.path}: maps "
                        "of the same wavelengths can be mixed"
                    )
                colors = np.full((n_sources, own.n_channels), 1.0 / own.n_channels)
                if own.source_colors:
                    colors[part.sources[part.lit]] = np.asarray(own.source_colors)[part.lit]
                rows = tuple(tuple(row) for row in colors.tolist())
                part.sets.append(len(united))
                united.append(own.model_copy(update={"source_colors": rows}))
        return united

    # -- what a map offers ---------------------------------------------------------------------

    @property
    def parts(self) -> list[tuple[RayMap, float, list[str]]]:
        """Each map with its factor, and the names of its sources in the mix."""
        names = [source.name for source in self.directory.sources]
        return [
            (part.map, part.factor, [names[k] for k in part.sources[part.lit].tolist()])
            for part in self._parts
        ]

    @property
    def shared_seeds(self) -> list[int]:
        """Seeds of more than one map, which then share random numbers."""
        own = [{run.get("seed") for run in part.map.runs} for part in self._parts]
        every = [int(seed) for seeds in own for seed in seeds if seed is not None]
        return sorted({seed for seed in every if every.count(seed) > 1})

    @property
    def merged(self) -> MergedPaths | None:
        """The path dictionary of all maps, None if one of them has none."""
        if self._all is None and not self._without:
            merger = PathMerger()
            rows: list[NDArray[np.int32] | None] = []
            for part in self._parts:
                own = part.map.merged
                if own is None:
                    return None
                to_all = merger.add(part.paths(own.paths, len(self.channel_sets)))
                rows += [None if local is None else to_all[local] for local in own.local_to_global]
            self._all = MergedPaths(paths=merger.dictionary(), local_to_global=rows)
        return self._all

    def detector_result(self, name: str, channel_set: int = 0) -> None:
        """None: what detectors counted is counted anew, as each map counts its factor."""

    def serve_no_merged(self) -> None:
        """Ask portions what the dictionary of a map said falsely."""
        self._all, self._without = None, True

    @property
    def damage(self) -> list[Damage]:
        """Damage of all maps."""
        return [damage for part in self._parts for damage in part.map.damage]

    @property
    def verified(self) -> bool:
        """Whether all maps are."""
        return all(part.map.verified for part in self._parts)

    @property
    def bytes_read(self) -> int:
        """Bytes fetched from all files so far."""
        return sum(part.map.bytes_read for part in self._parts)

    @property
    def meshes(self) -> Mapping[int, DisplayMesh]:
        """Display meshes by object index."""
        return self._parts[0].map.meshes

    @property
    def identities(self) -> list[tuple[int, int]]:
        """Device and inode of each open file of this machine."""
        return [identity for part in self._parts for identity in part.map.identities]

    def refresh(self) -> bool:
        """A mix is of the rays that were there when it was opened."""
        return False

    def __enter__(self) -> MixedMap:
        return self

    def close(self) -> None:
        """Close all maps."""
        for part in self._parts:
            part.map.close()


def _factor(value: Any, what: str) -> float:
    sound = isinstance(value, int | float) and not isinstance(value, bool)
    if not sound or not math.isfinite(value) or not 0.0 <= value <= _MOST_FACTOR:
        raise RayMapError(f"{what}: a factor is a number from 0 on, not {value!r:.40}")
    return float(value)


def write_mix(
    path: str | os.PathLike[str],
    maps: Sequence[tuple[str | os.PathLike[str], float]],
    *,
    force: bool = False,
) -> None:
    """Write a mix, which opens as one map of all of them.

    Parameters
    ----------
    path : ends in ``.raymix``; maps beside it or below are named from there
    maps : each with the factor of its light
    force : replace an existing file

    Raises
    ------
    RayMapError, SceneMismatch, MapExists, NotWritten
        The maps cannot be mixed.
    """
    target = Path(path)
    if target.suffix != MIX:
        raise RayMapError(f"a mix is called something{MIX}, not {target.name!r}")
    if not maps:
        raise RayMapError("name the maps that are mixed, as a.raymap:0.3")
    refuse_existing(target, force=force)
    folder = target.resolve().parent
    rows = []
    for place, factor in maps:
        file = Path(place).resolve()
        name = file.relative_to(folder) if file.is_relative_to(folder) else file
        rows.append({"map": str(name), "factor": _factor(factor, str(place))})
    with _open_all(rows, folder, target, "raise"):
        pass
    text = json.dumps({_KEY: 1, "maps": rows}, indent=2, ensure_ascii=False) + "\n"
    with replacing(target) as temporary:
        Path(temporary).write_text(text, encoding="utf-8")


def opened_mix(path: Path, on_damage: Literal["raise", "skip"]) -> MixedMap:
    """Open a mix.

    Raises
    ------
    NotARayMap, SceneMismatch
    """
    said = parse_json(given_bytes(path, "mix of maps", NotARayMap), dict, str(path))
    rows = said.get("maps")
    sound = said.get(_KEY) == 1 and isinstance(rows, list) and 0 < len(rows) <= _MOST_MAPS
    if not sound or not all(
        isinstance(row, dict) and isinstance(row.get("map"), str) for row in rows
    ):
        raise NotARayMap(f"{path} is no mix of maps: write one with raymap mix")
    return _open_all(rows, path.resolve().parent, path, on_damage)


def _open_all(
    rows: list[dict[str, Any]], folder: Path, name: Path, on_damage: Literal["raise", "skip"]
) -> MixedMap:
    found: list[tuple[RayMap, float]] = []
    try:
        for row in rows:
            place = folder / row["map"]
            if place.is_dir():
                raise NotARayMap(f"{place} is a folder: name the maps in it one by one")
            factor = _factor(row.get("factor", 1.0), str(place))
            found.append((RayMap(place, on_damage=on_damage), factor))
        return MixedMap(found, name)
    except BaseException:
        for map, _ in found:
            map.close()
        raise
