"""The folder of a trace on many machines: held by one recording, begun, continued or replaced."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from raymap.bytes.address import Address
from raymap.bytes.locking import try_lock
from raymap.file.opening import open as open_map
from raymap.file.resume import scene_difference
from raymap.file.shards import SUFFIX, shard_paths
from raymap.model.errors import MapExists, MapLocked, NotARayMap, RayMapError, SceneMismatch
from tracer.run.running import DEFAULT_SEED
from tracer.run.trace import Trace

__all__ = ["begin_folder", "owned_folder"]


@contextmanager
def owned_folder(folder: Path | Address) -> Iterator[None]:
    """Hold a local folder for one recording at a time."""
    if isinstance(folder, Address):
        yield
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise MapExists(
            f"{str(folder)!r} is a file; an executor of many machines writes a folder of maps: "
            "choose another name"
        ) from None
    except OSError as error:
        raise RayMapError(f"folder {folder} cannot be made: {error.strerror}") from None
    if os.name == "nt":  # pragma: no cover
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        if not try_lock(descriptor):
            raise MapLocked(
                f"another program records into {folder}: wait until it ends, or name another folder"
            )
        yield
    finally:
        os.close(descriptor)


def begin_folder(
    folder: Path | Address, trace: Trace, *, append: bool, force: bool
) -> tuple[int, int]:
    """(first ray, seed where none is given); refuses or removes what is there."""
    there = _shards_in(folder)
    if not there:
        return 0, DEFAULT_SEED
    if append:
        with open_map(there, on_damage="skip") as known:
            difference = scene_difference(known.directory, trace.directory)
            if difference:
                raise SceneMismatch(f"{folder} was recorded from another scene: {difference}")
            after = max((p.last_ray + 1 for p in known.portions if p.n_rays), default=0)
            first = -(-after // trace.max_branches)
            seeds = [run["seed"] for run in known.runs if run.get("seed") is not None]
        return first, int(seeds[-1]) if seeds else DEFAULT_SEED
    if not force:
        raise MapExists(
            f"{str(folder)!r} holds {len(there)} maps and stays as it is; continue with --append, "
            "write over them with --force, or choose another name"
        )
    for each in there:
        _remove(each)
    return 0, DEFAULT_SEED


def _shards_in(folder: Path | Address) -> list[Path] | list[Address]:
    with suppress(NotARayMap):
        if isinstance(folder, Address):
            from raymap.bytes.remotebytes import map_addresses

            return map_addresses(folder, SUFFIX) or []
        return list(shard_paths(folder))
    return []


def _remove(shard: Path | Address) -> None:
    if isinstance(shard, Address):
        from raymap.bytes.remotebytes import file_system

        system, path = file_system(shard)
        system.rm(path)
    else:
        shard.unlink()
