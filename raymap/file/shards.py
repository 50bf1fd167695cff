"""Several maps of one scene as one map."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.address import Address
from raymap.encoding.dictionary import PathMerger
from raymap.encoding.paths import MergedPaths, PathDictionary
from raymap.file.reader import Damage, RayMap
from raymap.file.resume import scene_difference
from raymap.file.stored import StoredPortion
from raymap.model.directory import ChannelSet, DisplayMesh
from raymap.model.errors import NotARayMap, SceneMismatch

__all__ = ["SUFFIX", "ShardedMap", "shard_paths"]

SUFFIX = ".raymap"


def shard_paths(folder: Path) -> list[Path]:
    """The maps in a folder of this machine, by name.

    Raises
    ------
    NotARayMap
        There are none.
    """
    paths = sorted(path for path in folder.iterdir() if path.suffix == SUFFIX and path.is_file())
    paths = [path for path in paths if not path.name.startswith(".")]
    if not paths:
        raise NotARayMap(f"folder {folder} holds no ray maps (files that end in {SUFFIX})")
    return paths


class ShardedMap(RayMap):
    """Maps of one scene, served as one; portions stand in order of their ray numbers."""

    def __init__(
        self,
        paths: Sequence[str | os.PathLike[str] | Address],
        *,
        name: Path | Address | None = None,
        on_damage: Literal["raise", "skip"] = "raise",
    ) -> None:
        self.on_damage = on_damage
        self._maps: list[RayMap] = []
        try:
            for path in paths:
                self._maps.append(RayMap(path, on_damage=on_damage))
            self.path = name or self._maps[0].path.parent
            self._combine()
        except BaseException:
            self.close()
            raise

    def _combine(self) -> None:
        first = self._maps[0]
        self.directory = first.directory
        for other in self._maps[1:]:
            difference = scene_difference(first.directory, other.directory)
            if difference:
                raise SceneMismatch(
                    f"{other.path} was recorded from another scene than {first.path}: {difference}"
                )
        self.bounds = first.bounds
        self.channel_sets = self._unite_channels()
        portions = [portion for shard in self._maps for portion in shard.portions]
        portions.sort(key=lambda portion: (portion.first_ray, portion.last_ray))
        self._refuse_overlaps(portions)
        self.portions = portions
        self.finished = all(shard.finished for shard in self._maps)
        self.runs = [run for shard in self._maps for run in shard.runs]
        self.bytes = sum(shard.bytes for shard in self._maps)
        self.torn_bytes = sum(shard.torn_bytes for shard in self._maps)
        self._all: MergedPaths | None = None

    def _unite_channels(self) -> list[ChannelSet]:
        """One list of channel sets; every shard's portions speak about it from here on."""
        united: list[ChannelSet] = []
        self._own_sets: list[list[int]] = []
        for shard in self._maps:
            places = []
            for channel_set in shard.own_channel_sets:
                if channel_set not in united:
                    united.append(channel_set)
                places.append(united.index(channel_set))
            self._own_sets.append(places)
        for shard, places in zip(self._maps, self._own_sets, strict=True):
            shard.channel_sets = united
            for portion in shard.portions:
                portion.channel_set = places[portion.index.meta.channel_set]
        return united

    def _refuse_overlaps(self, portions: list[StoredPortion]) -> None:
        seeds = {id(portion): _seed_of(portion) for portion in portions}
        last: dict[Any, StoredPortion] = {}
        for portion in portions:
            if not portion.n_rays:
                continue
            seed = seeds[id(portion)]
            before = last.get(seed)
            if before is not None and portion.first_ray <= before.last_ray:
                raise SceneMismatch(
                    f"{portion.map.path} and {before.map.path} both hold ray {portion.first_ray} "
                    f"of seed {seed}: they repeat each other; open only one of them, or record "
                    "shards with different seeds or ray numbers"
                )
            last[seed] = portion

    # -- what a map offers ---------------------------------------------------------------------

    @property
    def shards(self) -> Sequence[RayMap]:
        """The maps of which it is made."""
        return tuple(self._maps)

    @property
    def damage(self) -> list[Damage]:
        """Damage of all shards."""
        return [damage for shard in self._maps for damage in shard.damage]

    @property
    def verified(self) -> bool:
        """Whether all files are."""
        return all(shard.verified for shard in self._maps)

    @property
    def bytes_read(self) -> int:
        """Bytes fetched from all files so far."""
        return sum(shard.bytes_read for shard in self._maps)

    @property
    def meshes(self) -> Mapping[int, DisplayMesh]:
        """Display meshes by object index."""
        return next((shard.meshes for shard in self._maps if shard.meshes), {})

    @property
    def merged(self) -> MergedPaths | None:
        """The path dictionary of all shards, None if one of them has none."""
        parts = [shard.merged for shard in self._maps]
        if any(part is None for part in parts):
            return None
        if self._all is None:
            merger = PathMerger()
            numbers: dict[int, NDArray[np.int32] | None] = {}
            for shard, part, places in zip(self._maps, parts, self._own_sets, strict=True):
                assert part is not None
                to_all = merger.add(_with_channels(part.paths, places, len(self.channel_sets)))
                for portion, local in zip(shard.portions, part.local_to_global, strict=True):
                    numbers[id(portion)] = None if local is None else to_all[local]
            self._all = MergedPaths(
                paths=merger.dictionary(),
                local_to_global=[numbers[id(portion)] for portion in self.portions],
            )
        return self._all

    def detector_result(
        self, name: str, channel_set: int = 0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """What a detector counted over all shards; None where a shard's results are incomplete."""
        total: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
        for shard, places in zip(self._maps, self._own_sets, strict=True):
            if channel_set not in places:
                continue
            part = shard.detector_result(name, places.index(channel_set))
            if part is None:
                if any(p.n_rays and p.channel_set == channel_set for p in shard.portions):
                    return None
                continue
            total = part if total is None else (total[0] + part[0], total[1] + part[1])
        return total

    def refresh(self) -> bool:
        """Take in what was written since."""
        changed = [shard.refresh() for shard in self._maps]
        if any(changed):
            self._combine()
        return any(changed)

    @property
    def identities(self) -> list[tuple[int, int]]:
        """Device and inode of each open file of this machine, in the order of the maps."""
        return [identity for shard in self._maps for identity in shard.identities]

    def close(self) -> None:
        """Close all files."""
        for shard in self._maps:
            shard.close()


def _with_channels(paths: PathDictionary, places: list[int], n_sets: int) -> PathDictionary:
    sums = [np.zeros((paths.n_paths, 0)) for _ in range(n_sets)]
    for index, own in zip(places, paths.sum_wc, strict=False):
        sums[index] = own
    return dataclasses.replace(paths, sum_wc=tuple(sums))


def _seed_of(portion: StoredPortion) -> Any:
    """Seed of the run to which a portion belongs."""
    seed = None
    for run in portion.map.runs:
        if int(run.get("first_portion") or 0) <= portion.number:
            seed = run.get("seed")
    return seed
