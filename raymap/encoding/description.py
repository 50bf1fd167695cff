"""The chunks that describe a map: directory with display meshes, channel sets, runs."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Integral
from typing import Any

from pydantic import ValidationError

from raymap.bytes.chunks import Chunk, ChunkColumns, MapFile
from raymap.bytes.layout import CHANNELS, DIRECTORY, RUN
from raymap.bytes.streams import StreamSet
from raymap.encoding.meshstreams import add_meshes, meshes_of_version_1, read_meshes
from raymap.encoding.objectstreams import add_objects, read_objects
from raymap.model.directory import ChannelSet, Directory, DisplayMesh
from raymap.model.errors import FormatError, LimitExceeded
from raymap.model.jsontext import parse_json, whole_number, write_json
from raymap.model.limits import MAX_RAY
from raymap.model.sceneobjects import SceneObjects

__all__ = [
    "directory_streams",
    "pack_channel_set",
    "pack_directory",
    "pack_run",
    "parse_channel_set",
    "read_channel_set",
    "read_directory",
    "read_display_meshes",
    "read_run",
    "run_of",
]


def directory_streams(directory: Directory) -> StreamSet:
    """Everything that a directory says, without display meshes.

    Raises
    ------
    LimitExceeded
        It says more than can be read again.
    """
    streams = StreamSet()
    described = directory.model_dump(exclude_defaults=True, exclude={"objects"})
    text = write_json(described, "the directory")
    try:
        again = parse_json(text, dict, "directory")
        Directory.model_validate({**again, "objects": directory.objects})
    except ValidationError as error:
        raise LimitExceeded(f"the directory cannot be read again: {_first(error)}") from None
    streams.add_bytes("json", text)
    add_objects(streams, directory.object_columns)
    return streams


def pack_directory(directory: Directory, meshes: Mapping[int, DisplayMesh]) -> list[Any]:
    """The directory chunk as buffers.

    Raises
    ------
    LimitExceeded
        It says more than can be read again, or a display mesh is not sound.
    """
    streams = directory_streams(directory)
    add_meshes(streams, meshes, len(directory.objects))
    return streams.chunk(DIRECTORY)


def read_directory(file: MapFile, chunk: Chunk, prefix: str = "") -> Directory:
    """The directory, or the copy of it whose streams have a prefix.

    Raises
    ------
    FormatError
        It is damaged or contradicts itself.
    """
    data = file.text_of(chunk, f"{prefix}json")
    try:
        if file.major == 1 and not prefix:
            return Directory.model_validate_json(data)
        described = parse_json(data, dict, "directory")
        objects = SceneObjects(read_objects(ChunkColumns(file, chunk, prefix)))
        return Directory.model_validate({**described, "objects": objects})
    except ValidationError as error:
        raise FormatError(f"directory is not sound: {_first(error)}") from None


def read_display_meshes(file: MapFile, chunk: Chunk, n_objects: int) -> dict[int, DisplayMesh]:
    """The display meshes by object.

    Raises
    ------
    FormatError
        They are damaged or contradict each other.
    """
    if file.major == 1:
        return meshes_of_version_1(file, chunk, n_objects)
    return read_meshes(ChunkColumns(file, chunk), n_objects)


def pack_channel_set(channel_set: ChannelSet) -> list[Any]:
    """A channel set chunk as buffers."""
    return _pack_json(CHANNELS, channel_set.model_dump(exclude_defaults=True), "a channel set")


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
    return _pack_json(RUN, run_of(run), "the description of a run")


def read_run(file: MapFile, chunk: Chunk) -> dict[str, Any]:
    """What a run chunk says."""
    return run_of(parse_json(file.text_of(chunk), dict, "a run"))


def run_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """A run from JSON values: the numbers that count in it as numbers.

    Raises
    ------
    FormatError
        What it says is not of the kind that it must be.
    """
    if not isinstance(values, Mapping):
        raise FormatError("a run is no JSON object")
    run = {key: whole_number(value) if key in _COUNTED else value for key, value in values.items()}
    for key in _COUNTED:
        value = run.get(key)
        if value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, Integral):
            raise FormatError(f"{key} of a run is {value!r}, no whole number")
        run[key] = int(value)
    for key in ("first_portion", "first_ray"):
        if not 0 <= (run.get(key) or 0) <= MAX_RAY:
            raise FormatError(f"{key} of a run is {run[key]}, no number of a map")
    for key in ("parameters", "statistics"):
        if not isinstance(run.get(key) or {}, Mapping):
            raise FormatError(f"{key} of a run are no JSON object")
    return run


_COUNTED = ("seed", "first_portion", "first_ray")


def _pack_json(tag: bytes, values: Any, what: str) -> list[Any]:
    streams = StreamSet()
    streams.add_bytes("json", write_json(values, what))
    return streams.chunk(tag)


def _first(error: ValidationError) -> str:
    problem = error.errors()[0]
    where = ".".join(str(part) for part in problem["loc"])
    return f"{where}: {problem['msg']}" if where else str(problem["msg"])
