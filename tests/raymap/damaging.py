"""Ways to damage a map, and the one rule that must hold afterwards."""

from __future__ import annotations

import struct

import xxhash

import raymap
from raymap.bytes.layout import CHUNK_HEADER_SIZE, FILE_HEADER_SIZE, header_size
from tests.strategies import assert_same_portion

__all__ = ["check_damaged", "chunk_offsets", "with_sound_header"]


def check_damaged(path, written, *, exact=True):
    """Open and read a damaged map: named errors or skipped portions, never a wrong ray.

    Parameters
    ----------
    written : portions by number, as they were handed in
    exact : portions that are served must equal what was written (not so for forged files)

    Returns
    -------
    served : numbers of the portions that were read in full, None where the file was refused
    """
    served = set()
    try:
        ray_map = raymap.open(path, on_damage="skip")
    except raymap.FormatError:
        return None
    with ray_map:
        assert ray_map.bytes <= path.stat().st_size
        try:
            ray_map.meshes  # noqa: B018
            ray_map.merged  # noqa: B018
            ray_map.detector_result("sensor")
        except raymap.FormatError:
            pass
        for stored in ray_map.portions:
            try:
                found = stored.read()
                stored.paths().sum_wc  # noqa: B018
                stored.ray_ids()
                stored.segments()
            except raymap.DamagedPortion:
                assert ray_map.damage
                continue
            if exact:
                assert_same_portion(written[stored.number], found)
            served.add(stored.number)
    return served


def chunk_offsets(data):
    """Offset of every chunk of a sound file."""
    offsets = []
    offset = FILE_HEADER_SIZE
    while offset < len(data):
        offsets.append(offset)
        (size,) = struct.unpack_from("<Q", data, offset + 16)
        offset += size
    return offsets


def with_sound_header(data, offset):
    """Forge the checksum of the chunk header at an offset, so that its lies are believed."""
    data = bytearray(data)
    end = offset + header_size(bytes(data[offset : offset + CHUNK_HEADER_SIZE]))
    head = bytes(data[offset : offset + 24])
    body = bytes(data[offset + CHUNK_HEADER_SIZE : end])
    data[offset + 24 : offset + 32] = struct.pack("<Q", xxhash.xxh3_64_intdigest(head + body))
    return bytes(data)
