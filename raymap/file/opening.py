"""The door to reading: one file, a folder of shards, or a list of them; also behind addresses."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from raymap.bytes.address import Address, place_of
from raymap.file.reader import RayMap
from raymap.model.errors import NotARayMap

__all__ = ["open"]

Place = str | os.PathLike[str] | Address


def open(
    path: Place | Sequence[Place],
    *,
    on_damage: Literal["raise", "skip"] = "raise",
    storage_options: Mapping[str, Any] | None = None,
) -> RayMap:
    """Open a ray map.

    Parameters
    ----------
    path : a map, a mix, a folder of maps, or a list of maps; several maps of one scene open as
        one. An
        address (``s3://bucket/lens.raymap``, ``https://…``, ``memory://…``) is read through fsspec,
        of which only the bytes that are needed are fetched
    on_damage : "raise" raises `DamagedPortion` at damage, "skip" leaves the damaged parts out of
        ``portions`` as far as they are known at opening and notes all damage in ``damage``
    storage_options : for the file system of addresses (keys, endpoint, headers, …)

    Raises
    ------
    NotARayMap, UnsupportedVersion, DamagedPortion, SceneMismatch
    MissingExtra
        fsspec, or what it needs for the protocol of an address, is not installed.
    """
    from raymap.file.mixed import MIX, opened_mix
    from raymap.file.shards import SUFFIX, ShardedMap, shard_paths

    if isinstance(path, str | os.PathLike | Address):
        place = place_of(path, storage_options)
        if isinstance(place, Address):
            from raymap.bytes.remotebytes import map_addresses

            addresses = map_addresses(place, SUFFIX)
            if addresses is not None:
                return ShardedMap(addresses, name=place, on_damage=on_damage)
        elif place.is_dir():
            return ShardedMap(shard_paths(place), name=place, on_damage=on_damage)
        elif place.suffix == MIX:
            return opened_mix(place, on_damage)
        return RayMap(place, on_damage=on_damage)
    if not path:
        raise NotARayMap("an empty list of maps was given")
    places = [place_of(each, storage_options) for each in path]
    return ShardedMap(places, on_damage=on_damage)
