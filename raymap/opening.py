"""The door to reading: one file, a folder of shards, or a list of them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from raymap.errors import NotARayMap
from raymap.reader import RayMap

__all__ = ["open"]

Paths = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


def open(path: Paths, *, on_damage: Literal["raise", "skip"] = "raise") -> RayMap:
    """Open a ray map.

    Parameters
    ----------
    path : a map, a folder of maps, or a list of maps; several maps of one scene open as one
    on_damage : "raise" raises `DamagedPortion` at damage, "skip" leaves the damaged parts out of
        ``portions`` as far as they are known at opening and notes all damage in ``damage``

    Raises
    ------
    NotARayMap, UnsupportedVersion, DamagedPortion, SceneMismatch
    """
    from raymap.shards import ShardedMap, shard_paths

    if isinstance(path, str | os.PathLike):
        place = Path(path)
        if place.is_dir():
            return ShardedMap(shard_paths(place), name=place, on_damage=on_damage)
        return RayMap(place, on_damage=on_damage)
    if not path:
        raise NotARayMap("an empty list of maps was given")
    return ShardedMap(list(path), on_damage=on_damage)
