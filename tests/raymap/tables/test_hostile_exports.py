"""Tables of a map whose further keys lie."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raymap
from raymap.file.verify import verify
from tests.fuzz.fuzz_values import Seed, put_together
from tests.viewer.small_map import make_directory, make_meshes, make_portion, rgb_channels


def with_further(path: Path, keys: Any) -> Path:
    """A map whose first face has these keys besides."""
    plain = make_directory()
    faces = tuple(
        face.model_copy(update={"parameters": {"a": 1}}) for face in plain.objects[0].faces
    )
    first = plain.objects[0].model_copy(update={"faces": faces})
    directory = plain.model_copy(update={"objects": (first, *plain.objects[1:])})
    with raymap.RayMapWriter.create(path, directory, meshes=make_meshes()) as writer:
        writer.add_channel_set(rgb_channels())
        writer.append(make_portion(20))
        writer.finish()
    parts = Seed("", path).parts
    for part in parts:
        for stream in part.streams:
            if stream.name.endswith("face.further"):
                stream.values = np.frombuffer(json.dumps([[0, keys]]).encode(), "u1")
    path.write_bytes(put_together(parts))
    return path


def deep(levels: int) -> dict[str, Any]:
    value: dict[str, Any] = {}
    for _ in range(levels):
        value = {"a": value}
    return value


@pytest.mark.parametrize(
    "keys",
    [
        {"parameters": {"a": "\ud800"}}, {"\ud800": 1}, {"aliases": ["\ud800"]},
        {"parameters": {"a": 10**300}}, {"parameters": deep(90)},
        {"model_fields": 1, "__dict__": 2},
    ],
)  # fmt: skip
@pytest.mark.parametrize("suffix", [".parquet", ".arrow", ".csv"])
def test_strange_keys_are_exported(tmp_path: Path, keys: Any, suffix: str) -> None:
    path = with_further(tmp_path / "map.raymap", keys)
    with raymap.open(path, on_damage="skip") as opened:
        raymap.export(opened, tmp_path / f"out{suffix}")


def test_keys_that_nest_without_end_are_refused(tmp_path: Path) -> None:
    path = with_further(tmp_path / "map.raymap", {"parameters": deep(300)})
    with (
        raymap.open(path, on_damage="skip") as opened,
        pytest.raises(raymap.RayMapError, match="nests deeper than 128 levels"),
    ):
        raymap.export(opened, tmp_path / "out.parquet")


def test_vertices_that_are_nowhere_are_damage(tmp_path: Path) -> None:
    path = with_further(tmp_path / "map.raymap", {})
    parts = Seed("", path).parts
    for part in parts:
        for stream in part.streams:
            if stream.name == "mesh.vertex":
                stream.values = stream.values.copy()
                stream.values[3, 1] = np.inf
    path.write_bytes(put_together(parts))
    with raymap.open(path, on_damage="skip") as opened:
        assert any("mesh" in str(each.reason) for each in verify(opened).damage)
