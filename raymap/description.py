"""The chunks that describe a map: directory with display meshes, channel sets, runs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from raymap.chunks import Chunk, MapFile
from raymap.directory import ChannelSet, Directory, DisplayMesh
from raymap.errors import FormatError, LimitExceeded
from raymap.layout import CHANNELS, DIRECTORY, RUN, pack_chunk_header
from raymap.schema import TABLE_FLOOR, TABLE_PER_BYTE, affordable
from raymap.streams import StreamSet

__all__ = [
    "pack_channel_set",
    "pack_directory",
    "pack_run",
    "parse_channel_set",
    "read_channel_set",
    "read_directory",
    "read_mesh",
    "read_run",
]


def check_primitives(directory: Directory, stored: int) -> None:
    """Refuse more primitives than a directory of ``stored`` bytes can pay a table of quadrics for.

    Raises
    ------
    LimitExceeded
    """
    n = directory.n_in_table
    limit = affordable(stored, TABLE_FLOOR, TABLE_PER_BYTE)
    if n > limit:
        raise LimitExceeded(
            f"faces have a quadric for each of several primitives, among {n} primitives in all; a "
            f"directory of {stored} bytes may have {limit}"
        )


def pack_directory(directory: Directory, meshes: Mapping[int, DisplayMesh]) -> list[Any]:
    """The directory chunk as buffers."""
    streams = StreamSet()
    streams.add_bytes("json", directory.model_dump_json(exclude_defaults=True).encode())
    for number, mesh in sorted(meshes.items()):
        streams.add(f"mesh.{number}.vertices", np.asarray(mesh.vertices, np.float32))
        streams.add(f"mesh.{number}.triangles", np.asarray(mesh.triangles, np.int32))
        streams.add(f"mesh.{number}.face", np.asarray(mesh.face, np.int32))
    packed = [pack_chunk_header(DIRECTORY, b"", streams.entries), *streams.buffers]
    check_primitives(directory, sum(len(buffer) for buffer in packed))
    return packed


def read_directory(file: MapFile, chunk: Chunk) -> tuple[Directory, list[int]]:
    """The directory and the objects that have a display mesh."""
    data = file.text_of(chunk)
    try:
        directory = Directory.model_validate_json(data)
    except ValidationError as error:
        raise FormatError(f"directory is not sound: {_first(error)}") from None
    try:
        check_primitives(directory, chunk.header.size)
    except LimitExceeded as error:
        raise FormatError(str(error)) from None
    with_mesh = set()
    for entry in chunk.header.streams:
        parts = entry.name.split(".")
        if parts[0] == "mesh" and len(parts) == 3 and parts[1].isdigit():
            with_mesh.add(int(parts[1]))
    return directory, sorted(with_mesh)


def read_mesh(file: MapFile, chunk: Chunk, number: int) -> DisplayMesh:
    """The display mesh of one object."""
    vertices = file.column(chunk, f"mesh.{number}.vertices", None, np.float32, matrix=True)
    triangles = file.column(chunk, f"mesh.{number}.triangles", None, np.int32, matrix=True)
    face = file.column(chunk, f"mesh.{number}.face", None, np.int32)
    sound = not len(triangles) or (
        vertices.reshape(len(vertices), -1).shape[1] == 3
        and triangles.reshape(len(triangles), -1).shape[1] == 3
        and len(face) == len(triangles)
        and 0 <= int(triangles.min()) <= int(triangles.max()) < len(vertices)
    )
    if not sound:
        raise FormatError(f"display mesh of object {number} is not sound")
    return DisplayMesh(
        vertices=vertices.reshape(-1, 3), triangles=triangles.reshape(-1, 3), face=face
    )


def pack_channel_set(channel_set: ChannelSet) -> list[Any]:
    """A channel set chunk as buffers."""
    return _pack_json(CHANNELS, channel_set.model_dump_json(exclude_defaults=True))


def read_channel_set(file: MapFile, chunk: Chunk) -> ChannelSet:
    """The channel set of a chunk."""
    return parse_channel_set(file.text_of(chunk))


def parse_channel_set(data: bytes | dict[str, Any]) -> ChannelSet:
    """A channel set from JSON text or values."""
    try:
        if isinstance(data, bytes):
            return ChannelSet.model_validate_json(data)
        return ChannelSet.model_validate(data)
    except ValidationError as error:
        raise FormatError(f"channel set is not sound: {_first(error)}") from None


def pack_run(run: Mapping[str, Any]) -> list[Any]:
    """A run chunk as buffers."""
    return _pack_json(RUN, json.dumps(run))


def read_run(file: MapFile, chunk: Chunk) -> dict[str, Any]:
    """What a run chunk says."""
    try:
        return dict(json.loads(file.text_of(chunk)))
    except (ValueError, TypeError, RecursionError):
        raise FormatError("a run's description is no JSON object") from None


def _pack_json(tag: bytes, text: str) -> list[Any]:
    streams = StreamSet()
    streams.add_bytes("json", text.encode())
    return [pack_chunk_header(tag, b"", streams.entries), *streams.buffers]


def _first(error: ValidationError) -> str:
    problem = error.errors()[0]
    place = ".".join(str(part) for part in problem["loc"])
    return f"{place}: {problem['msg']}" if place else str(problem["msg"])
